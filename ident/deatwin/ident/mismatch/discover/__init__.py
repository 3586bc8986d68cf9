"""A free form of what no effect of the catalogue explains."""

from deatwin.ident.mismatch.discover.discover import discover
from deatwin.ident.mismatch.discover.discovery import Discovery, FoundTerm

__all__ = ["Discovery", "FoundTerm", "discover"]
