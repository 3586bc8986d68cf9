"""Where a simulation and a recording differ: locate the mismatch, name the missing physics, verify it."""

from deatwin.ident.mismatch.advice import INPUT_FILE, Advice
from deatwin.ident.mismatch.advise import advise
from deatwin.ident.mismatch.base import Base, calibrate_base
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.candidate import Candidate
from deatwin.ident.mismatch.decide import Distance, Naming
from deatwin.ident.mismatch.detect import Detection, detect
from deatwin.ident.mismatch.diagnose import diagnose
from deatwin.ident.mismatch.diagnosis import Cause, Diagnosis, Interval, Verdict
from deatwin.ident.mismatch.evidence import CandidateSummary, Evidence
from deatwin.ident.mismatch.gate import Gate, gate
from deatwin.ident.mismatch.name import name_causes
from deatwin.ident.mismatch.verify import Verification, verify

__all__ = [
    "INPUT_FILE",
    "Advice",
    "Base",
    "Bench",
    "Candidate",
    "CandidateSummary",
    "Cause",
    "Detection",
    "Diagnosis",
    "Distance",
    "Evidence",
    "Gate",
    "Interval",
    "Naming",
    "Verdict",
    "Verification",
    "advise",
    "calibrate_base",
    "detect",
    "diagnose",
    "gate",
    "name_causes",
    "verify",
]
