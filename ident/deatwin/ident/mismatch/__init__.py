"""Locate where a simulation and a recording differ, name the missing physics, and verify it."""

from deatwin.ident.mismatch.advise.advice import INPUT_FILE, Advice
from deatwin.ident.mismatch.advise.advise import advise
from deatwin.ident.mismatch.advise.offer import PricedReading
from deatwin.ident.mismatch.certainty import how_sure, next_step
from deatwin.ident.mismatch.detect.detect import detect
from deatwin.ident.mismatch.detect.detection import Detection
from deatwin.ident.mismatch.diagnose import diagnose
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.discover.discover import discover
from deatwin.ident.mismatch.discover.discovery import Discovery
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.layout import Readings
from deatwin.ident.mismatch.locate.location import Location, locate
from deatwin.ident.mismatch.locate.track import readings
from deatwin.ident.mismatch.located import LocationSummary, Unexplained
from deatwin.ident.mismatch.naming.candidate import Candidate, Distance
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.name import name_causes
from deatwin.ident.mismatch.naming.screen import LinearisedResponse, linearised_responses
from deatwin.ident.mismatch.plan.plan import plan_experiment
from deatwin.ident.mismatch.plan.result import ExperimentPlan, Foreseen, TellingReading
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.quality import DataQuality, check_quality, confirm
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
from deatwin.ident.mismatch.verdict import CandidateSummary, Cause, Explanation, FittedParameter, Interval, Verdict
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import verify

__all__ = [
    "INPUT_FILE",
    "Advice",
    "AdviceSummary",
    "Base",
    "Candidate",
    "CandidateSummary",
    "Cause",
    "DataQuality",
    "Detection",
    "DetectionSummary",
    "Diagnosis",
    "DiagnosisProblem",
    "Discovery",
    "Distance",
    "ExperimentPlan",
    "Explanation",
    "Findings",
    "FitSummary",
    "FittedParameter",
    "Foreseen",
    "FreeFormSummary",
    "Interval",
    "LinearisedResponse",
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
    "check_quality",
    "confirm",
    "detect",
    "diagnose",
    "discover",
    "how_sure",
    "linearised_responses",
    "locate",
    "name_causes",
    "next_step",
    "plan_experiment",
    "prepare",
    "readings",
    "say",
    "verify",
]
