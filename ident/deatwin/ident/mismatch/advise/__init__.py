"""Which input would tell rival explanations apart."""

from deatwin.ident.mismatch.advise.advice import INPUT_FILE, Advice
from deatwin.ident.mismatch.advise.advise import advise

__all__ = ["INPUT_FILE", "Advice", "advise"]
