"""Where a simulation and a recording differ: locate the mismatch, name the missing physics, verify it."""

from deatwin.ident.mismatch.advise import INPUT_FILE, Advice, advise
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.detect import Detection, detect
from deatwin.ident.mismatch.diagnose import diagnose
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.discover import Discovery, discover
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.gate import Gate, confirm, gate
from deatwin.ident.mismatch.layout import Readings
from deatwin.ident.mismatch.locate import Location, locate
from deatwin.ident.mismatch.located import LocationSummary, Unexplained
from deatwin.ident.mismatch.naming import Candidate, Distance, Footprint, Naming, footprints, name_causes
from deatwin.ident.mismatch.plan.plan import plan_experiment
from deatwin.ident.mismatch.plan.result import ExperimentPlan, Foreseen
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.refit import Base, calibrate_base
from deatwin.ident.mismatch.result import (
    AdviceSummary,
    DetectionSummary,
    FitSummary,
    FreeFormSummary,
    VerificationSummary,
)
from deatwin.ident.mismatch.say import say
from deatwin.ident.mismatch.steps import Step
from deatwin.ident.mismatch.verdict import CandidateSummary, Cause, FittedParameter, Interval, Verdict
from deatwin.ident.mismatch.verify import Verification, verify

__all__ = [
    "INPUT_FILE",
    "Advice",
    "AdviceSummary",
    "Base",
    "Bench",
    "Candidate",
    "CandidateSummary",
    "Cause",
    "Detection",
    "DetectionSummary",
    "Diagnosis",
    "Discovery",
    "Distance",
    "ExperimentPlan",
    "Findings",
    "FitSummary",
    "FittedParameter",
    "Footprint",
    "Foreseen",
    "FreeFormSummary",
    "Gate",
    "Interval",
    "Location",
    "LocationSummary",
    "Naming",
    "Readings",
    "Step",
    "Unexplained",
    "Verdict",
    "Verification",
    "VerificationSummary",
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
    "plan_experiment",
    "prepare",
    "say",
    "verify",
]
