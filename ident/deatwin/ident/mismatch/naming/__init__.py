"""Which effects of the catalogue explain a mismatch."""

from deatwin.ident.mismatch.naming.candidate import Candidate, Distance
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.name import name_causes
from deatwin.ident.mismatch.naming.screen import Footprint, footprints

__all__ = ["Candidate", "Distance", "Footprint", "Naming", "footprints", "name_causes"]
