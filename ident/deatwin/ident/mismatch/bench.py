"""Hold what all steps of a diagnosis share."""

from __future__ import annotations

from dataclasses import dataclass, replace

from deatwin.ident.greybox.parts import Part, first_only
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """The plant, the effects and the recordings on the bench.

    Parameters
    ----------
    nominal : Plant
        As the user gave it, not calibrated.
    effects : tuple of Effect
        What may be missing.
    fitted, unseen, everything : tuple of Part
        What is fitted, what only judges, and both together.
    jobs : int
        Worker processes.
    stated_error : float
        Model error that the user's rig states, SI.
    expected_error : float
        What that is for the motion seen, SI.
    """

    nominal: Plant
    effects: tuple[Effect, ...]
    fitted: tuple[Part, ...]
    unseen: tuple[Part, ...]
    everything: tuple[Part, ...]
    jobs: int
    stated_error: float
    expected_error: float

    @property
    def of_first(self) -> Bench:
        """Return the same bench with the first reading only."""
        fitted, unseen, everything = map(first_only, (self.fitted, self.unseen, self.everything))
        return replace(self, fitted=fitted, unseen=unseen, everything=everything)
