"""Results of the steps of a diagnosis, from which its conclusion is made."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.advise.advice import Advice
from deatwin.ident.mismatch.detect.detection import Detection
from deatwin.ident.mismatch.discover.discovery import Discovery
from deatwin.ident.mismatch.locate.location import Location
from deatwin.ident.mismatch.model_error import with_own_errors
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.quality import DataQuality
from deatwin.ident.mismatch.refit.base import Base
from deatwin.ident.mismatch.verdict import Verdict
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.plant.amplitudes import amplitude_unit


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """Results of the steps of a diagnosis, in SI units.

    Parameters
    ----------
    problem : DiagnosisProblem
        Plant, effects and recordings.
    checked : DataQuality
        Recordings with their faults marked.
    base : Base
        The calibrated base plant.
    detection : Detection
        Test for missing physics.
    location : Location or None
        Location of the mismatch; None if nothing is missing.
    naming : Naming
        Candidates that were tried, and the choice among them.
    verification : Verification
        Tests of the best explanation on held-out data.
    advice : Advice or None
        Experiment that would distinguish the remaining explanations; None if none is needed.
    discovery : Discovery or None
        Free form: a force that has no physical name and describes a mismatch that no effect explains; None if there is
        none.
    verdict : Verdict
        Conclusion of the diagnosis.
    answer : Candidate
        Best explanation; the base plant if there is none.
    final : Calibration
        The answer, calibrated on all samples without a fault.
    left : Location or None
        Location of the mismatch that the answer leaves; None unless the verdict is `partly`.
    elsewhere : tuple of Candidate
        Candidates with the effects of the answer at other places, which the recordings cannot rule out.
    restated : tuple of Candidate
        The base plant with one number of the rig changed, for each number with which the recordings could also be
        explained without any effect.
    """

    problem: DiagnosisProblem
    checked: DataQuality
    base: Base
    detection: Detection
    location: Location | None
    naming: Naming
    verification: Verification
    advice: Advice | None
    discovery: Discovery | None
    verdict: Verdict
    answer: Candidate
    final: Calibration
    left: Location | None = None
    elsewhere: tuple[Candidate, ...] = ()
    restated: tuple[Candidate, ...] = ()

    @property
    def named(self) -> bool:
        """True if the answer contains effects."""
        return bool(self.answer.effects)

    @property
    def calibrated(self) -> Calibration:
        """The reported base plant: calibrated on the fitted data, or on all data if this removes the mismatch."""
        return self.base.chosen.calibration if self.detection.taken_up is None else self.final

    @cached_property
    def intervals(self) -> Calibration:
        """``final`` with a covariance that also includes the plant's model error."""
        return with_own_errors(self.final, self.problem, self.base.noise)

    @cached_property
    def base_intervals(self) -> Calibration:
        """``calibrated`` with a covariance that also includes the plant's model error."""
        known = self.calibrated
        return self.intervals if known is self.final else with_own_errors(known, self.problem, self.base.noise)

    @property
    def unit(self) -> tuple[str, float]:
        """Unit in which the diagnosis reports amplitudes, and its size in SI."""
        return amplitude_unit(self.final.plant.rig.output_unit)
