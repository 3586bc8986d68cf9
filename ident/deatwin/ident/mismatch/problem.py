"""The data that all steps of a diagnosis share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, replace
from math import log

from deatwin.ident.greybox.parts import Part, first_only
from deatwin.ident.mismatch.likelihood.beforehand import strength_deviation
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant


@dataclass(frozen=True, kw_only=True, eq=False)
class DiagnosisProblem:
    """Diagnosis problem: plant, effects and recordings, prepared for all steps.

    Parameters
    ----------
    nominal : Plant
        Plant as the user gave it, not calibrated.
    effects : tuple of Effect
        Effects that may be missing.
    fitted, unseen, everything : tuple of Part
        Fitted data, held-out data, and all data.
    jobs : int
        Number of worker processes.
    stated_error : float
        Model error that the user's rig states, SI.
    expected_error : float
        Stated model error, scaled to the recorded motion, SI.
    elsewhere : tuple of Effect
        Effects at other places, tried in place of the effect that was found.
    """

    nominal: Plant
    effects: tuple[Effect, ...]
    fitted: tuple[Part, ...]
    unseen: tuple[Part, ...]
    everything: tuple[Part, ...]
    jobs: int
    stated_error: float
    expected_error: float
    elsewhere: tuple[Effect, ...] = ()

    @property
    def everywhere(self) -> tuple[Effect, ...]:
        """Return all effects that may be missing, at all places."""
        return (*self.effects, *self.elsewhere)

    def log_share(self, names: Collection[str]) -> float:
        """Return the logarithm of the prior share of these places: each place has the same share.

        Parameters
        ----------
        names : collection of str
            Names of effects with their places.

        Returns
        -------
        float
        """
        places = Counter(effect.cause for effect in self.everywhere)
        chosen = (effect for effect in self.everywhere if effect.name in names)
        return -sum(log(places[effect.cause]) for effect in chosen)

    def log_size(self, names: Collection[str], plant: Plant) -> float:
        """Return by how much the strengths of effects at other places are less likely than typical ones.

        Let z be the strength of an effect, divided by the half width of its prior. If effects change the reading alike,
        only their relative strength is known. The prior is therefore that of ln z, proportional to z exp(-z²/2),
        relative to its largest value, at z = 1. Effects with a smaller z, and strengths with a unit, do not count,
        because typical strengths with a unit apply to film rigs only.

        Parameters
        ----------
        names : collection of str
            Names of effects with their places.
        plant : Plant
            Fitted plant with these effects.

        Returns
        -------
        float
            Log-prior in nats; 0 if no z is above 1.
        """
        found = [effect for effect in self.everywhere if effect.name in names and effect.placed_at]
        sizes = [
            abs(plant.parameters[f"{effect.name}.{effect.strength}"].value) / strength_deviation(effect)
            for effect in found
            if effect.described(effect.strength).unit == "1"
        ]
        return sum(log(size) - (size**2 - 1) / 2 for size in sizes if size > 1)

    @property
    def of_first(self) -> DiagnosisProblem:
        """Return the same problem with the first reading only."""
        fitted, unseen, everything = map(first_only, (self.fitted, self.unseen, self.everything))
        return replace(self, fitted=fitted, unseen=unseen, everything=everything)
