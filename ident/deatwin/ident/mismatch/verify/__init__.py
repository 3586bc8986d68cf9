"""Does an explanation hold on data that no fit has seen, against shams and in every part?"""

from deatwin.ident.mismatch.result import Ablation
from deatwin.ident.mismatch.verify.constancy import Constancy
from deatwin.ident.mismatch.verify.shams import Sham, ShamKind
from deatwin.ident.mismatch.verify.transfer import Transfer
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import verify

__all__ = ["Ablation", "Constancy", "Sham", "ShamKind", "Transfer", "Verification", "verify"]
