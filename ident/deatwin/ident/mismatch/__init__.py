"""Locate where a simulation and a recording differ, name the missing physics, and verify it."""

from deatwin.ident.mismatch.advise.advice import INPUT_FILE, Advice
from deatwin.ident.mismatch.advise.advise import advise
from deatwin.ident.mismatch.advise.offer import PricedReading
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.detect.detect import detect
from deatwin.ident.mismatch.detect.detection import Detection
from deatwin.ident.mismatch.diagnose import diagnose
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.discover.discover import discover
from deatwin.ident.mismatch.discover.discovery import Discovery
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.gate.gate import Gate, confirm, gate
from deatwin.ident.mismatch.layout import Readings
from deatwin.ident.mismatch.locate.location import Location, locate
from deatwin.ident.mismatch.locate.track import readings
from deatwin.ident.mismatch.located import LocationSummary, Unexplained
from deatwin.ident.mismatch.naming.candidate import Candidate, Distance
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.name import name_causes
from deatwin.ident.mismatch.naming.screen import Footprint, footprints
from deatwin.ident.mismatch.plan.plan import plan_experiment
from deatwin.ident.mismatch.plan.result import ExperimentPlan, Foreseen, TellingReading
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.refit import Base, calibrate_base
from deatwin.ident.mismatch.result import (
    AdviceSummary,
    DetectionSummary,
    FitSummary,
    FreeFormSummary,
    ReadingSummary,
    VerificationSummary,
)
from deatwin.ident.mismatch.say import say
from deatwin.ident.mismatch.steps import Step
from deatwin.ident.mismatch.verdict import CandidateSummary, Cause, FittedParameter, Interval, Verdict
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import verify

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
    "PricedReading",
    "ReadingSummary",
    "Readings",
    "Step",
    "TellingReading",
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
    "readings",
    "say",
    "verify",
]
