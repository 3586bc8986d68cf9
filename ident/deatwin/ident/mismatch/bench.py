"""Hold what all steps of a diagnosis share."""

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
class Bench:
    """Diagnosis problem: plant, effects and recordings, prepared for all steps.

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
    elsewhere : tuple of Effect
        Effects at further places, to be tried in the place of what was found.
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
        """Return the logarithm of the share of the prior of effects that falls to these places: each takes as much.

        Parameters
        ----------
        names : collection of str
            Names of effects, at their places.

        Returns
        -------
        float
        """
        places = Counter(effect.cause for effect in self.everywhere)
        chosen = (effect for effect in self.everywhere if effect.name in names)
        return -sum(log(places[effect.cause]) for effect in chosen)

    def log_size(self, names: Collection[str], plant: Plant) -> float:
        """Return how much less likely the shares by which effects at further places act are than usual ones.

        Of what reads alike, the strength is known as a share of itself: its prior is that of the logarithm, z φ(z).
        Typical strengths with a unit are those of a film's rig, and say nothing of another one.

        Parameters
        ----------
        names : collection of str
            Names of effects, at their places.
        plant : Plant
            With these effects, as fitted.

        Returns
        -------
        float
            In nats; 0 for those that are no larger than usual.
        """
        found = [effect for effect in self.everywhere if effect.name in names and effect.placed_at]
        sizes = [
            abs(plant.parameters[f"{effect.name}.{effect.strength}"].value) / strength_deviation(effect)
            for effect in found
            if effect.described(effect.strength).unit == "1"
        ]
        return sum(log(size) - (size**2 - 1) / 2 for size in sizes if size > 1)

    @property
    def of_first(self) -> Bench:
        """Return the same bench with the first reading only."""
        fitted, unseen, everything = map(first_only, (self.fitted, self.unseen, self.everything))
        return replace(self, fitted=fitted, unseen=unseen, everything=everything)
