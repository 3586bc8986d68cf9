"""Where a simulation and a recording differ: locate the mismatch, name the missing physics, verify it."""

from deatwin.ident.mismatch.advise import INPUT_FILE, Advice, advise
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.detect import Detection, detect
from deatwin.ident.mismatch.diagnose import diagnose
from deatwin.ident.mismatch.diagnosis import Cause, Diagnosis, Interval, Verdict
from deatwin.ident.mismatch.discover import Discovery, discover
from deatwin.ident.mismatch.evidence import CandidateSummary, Evidence
from deatwin.ident.mismatch.gate import Gate, confirm, gate
from deatwin.ident.mismatch.locate import Location, locate
from deatwin.ident.mismatch.naming import Candidate, Distance, Footprint, Naming, footprints, name_causes
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.refit import Base, calibrate_base
from deatwin.ident.mismatch.say import say
from deatwin.ident.mismatch.steps import Step
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
    "Discovery",
    "Distance",
    "Evidence",
    "Footprint",
    "Gate",
    "Interval",
    "Location",
    "Naming",
    "Step",
    "Verdict",
    "Verification",
    "advise",
    "calibrate_base",
    "confirm",
    "detect",
    "diagnose",
    "discover",
    "footprints",
    "gate",
    "locate",
    "name_causes",
    "prepare",
    "say",
    "verify",
]
