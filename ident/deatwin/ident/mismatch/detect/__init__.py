"""Step 2 of a diagnosis: is anything missing, could it be seen, and is it the plant's?"""

from deatwin.ident.mismatch.detect.detect import detect, detect_in
from deatwin.ident.mismatch.detect.detection import Curves, Detection
from deatwin.ident.mismatch.detect.leftover import Leftover, leftover_of
from deatwin.ident.mismatch.detect.origin import Origin, OriginEvidence, origin_of
from deatwin.ident.mismatch.result import Statistic

__all__ = [
    "Curves",
    "Detection",
    "Leftover",
    "Origin",
    "OriginEvidence",
    "Statistic",
    "detect",
    "detect_in",
    "leftover_of",
    "origin_of",
]
