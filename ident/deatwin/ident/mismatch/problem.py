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
    """Diagnosis problem: plant, effects and recordings, prepared for all steps of a diagnosis.

    Parameters
    ----------
    nominal : Plant
        Plant that the user gave, before calibration.
    effects : tuple of Effect
        Effects that may be missing.
    fitted, unseen, everything : tuple of Part
        Fitted data, held-out data, and both together.
    jobs : int
        Number of worker processes.
    stated_error : float
        Model error that the rig states, rms, SI.
    expected_error : float
        Model error that is expected for these recordings: the stated one, scaled to the recorded motion, rms, SI.
    elsewhere : tuple of Effect
        Copies of the effects that act at other places of the plant. They are tried in place of an effect that was
        found.
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
        """All effects that may be missing, at all places: ``effects``, then ``elsewhere``."""
        return (*self.effects, *self.elsewhere)

    def log_share(self, names: Collection[str]) -> float:
        """Return the logarithm of the prior probability of the places at which effects act.

        The places at which an effect may act are equally probable.

        Parameters
        ----------
        names : collection of str
            Names of the effects; a name identifies the place, too.

        Returns
        -------
        float
        """
        places = Counter(effect.cause for effect in self.everywhere)
        chosen = (effect for effect in self.everywhere if effect.name in names)
        return -sum(log(places[effect.cause]) for effect in chosen)

    def log_size(self, names: Collection[str], plant: Plant) -> float:
        """Return the log-prior of the strengths of effects that do not act at their usual place.

        Let z be the fitted strength of an effect, divided by the scale of its prior. The prior density of ln z is
        proportional to z exp(-z²/2) and largest at z = 1. For z > 1, the log-prior is the logarithm of this density
        relative to its maximum; otherwise it is 0. It is also 0 for strengths that are not dimensionless. If there are
        several effects, their log-priors are added.

        Parameters
        ----------
        names : collection of str
            Names of the effects; a name identifies the place, too.
        plant : Plant
            Fitted plant with these effects.

        Returns
        -------
        float
            Log-prior, nats; 0 or less.
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
