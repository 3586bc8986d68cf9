"""Where a simulation and a recording differ: locate the mismatch, name the missing physics, verify it."""

from deatwin.ident.mismatch.diagnose import diagnose
from deatwin.ident.mismatch.diagnosis import Cause, Diagnosis, Interval, Verdict
from deatwin.ident.mismatch.evidence import CandidateSummary, Evidence

__all__ = ["CandidateSummary", "Cause", "Diagnosis", "Evidence", "Interval", "Verdict", "diagnose"]
