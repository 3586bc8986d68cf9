"""Placebo effects: changes of the readings as large and as smooth as a named effect's, with its physics spoilt.

Whatever explains a mismatch because it is flexible, or slow, or comes with the input, explains it as well when its
memory runs backwards in time, its strength has the wrong sign, or its phases are drawn anew. What explains it because
it happened does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import ClassVar

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.problem import Problem
from deatwin.plant.datasets import Metadata, variable
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

DISTINCT = 0.5
"""A sham that would take up more than this share of the true effect is no sham of it: nothing can be learned."""
AS_GOOD = 0.8
"""A sham that gains this share of what the named effect gains is as good as it."""
NEARLY_LINEAR = 0.5
"""Smallest share of the refit's gain that first order must show for changes of the readings to add up."""
DRAWS = 19
"""Sets of random phases; the best of 19 is the upper 5 % of what phases alone can do."""
RESOLVED = 1e-6
"""Directions of the parameters that the readings hardly know are no way out."""


class PlaceboKind(Enum):
    """Way in which a placebo effect differs from the effect; the text says it."""

    BACKWARDS = "backwards in time"
    OPPOSITE = "with the opposite sign"
    RANDOM_PHASES = "with random phases"


@dataclass(frozen=True, kw_only=True)
class Placebo:
    """Gain of a placebo effect beside that of the effect, on the held-out data.

    Parameters
    ----------
    effect : str
        Canonical name.
    kind : PlaceboKind
        How it was spoilt.
    share : float or None
        Gain of the sham in squared residual, to first order, relative to that of the effect itself: likewise to first
        order, but the opposite sign, which cannot gain where the effect does, relative to what the refit gained, and
        random phases, whose strength is all that a refit could change, relative to the greater of the two. None if it
        was skipped.
    expected : float or None
        What it would gain if the effect were the truth, relative to that: what the two have in common.
    skipped : str
        Why nothing can be learned of it; empty if it was judged.
    """

    effect: str
    kind: PlaceboKind
    share: float | None = field(default=None, metadata=variable(about="gain relative to that of the effect"))
    expected: float | None = field(default=None, metadata=variable(about="the same were the effect the truth"))
    skipped: str = ""

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "rejected": variable(),
    }

    @property
    def rejected(self) -> bool:
        """Return whether it explains less than the effect, as it should; also true if it was skipped."""
        return self.share is None or self.share < AS_GOOD


@dataclass(frozen=True, kw_only=True, eq=False)
class _Court:
    """Changes of the readings compete here, after the plant's parameters took up what they can.

    Parameters
    ----------
    jacobian : ndarray, shape (n, p)
        Of the plant without the effect, columns of length one.
    fitted : ndarray of bool, shape (n,)
        Samples that were fitted; the others judge.
    """

    jacobian: np.ndarray
    fitted: np.ndarray

    def left(self, change: np.ndarray) -> np.ndarray:
        """Return what a refit on the fitted part leaves of a change, everywhere, to first order."""
        solution = np.linalg.lstsq(self.jacobian[self.fitted], change[self.fitted], rcond=RESOLVED)[0]
        return change - self.jacobian @ solution

    def gain(self, by: np.ndarray, of: np.ndarray) -> float:
        """Fall of the unseen mean square of `of` when `by`, both as `left` leaves them, is fitted to it.

        Its amplitude is not negative: an effect keeps its sign.
        """
        energy = float(by[self.fitted] @ by[self.fitted])
        amplitude = max(float(by[self.fitted] @ of[self.fitted]) / energy, 0.0) if energy > 0 else 0.0
        return self.unseen_power(of) - self.unseen_power(of - amplitude * by)

    def unseen_power(self, change: np.ndarray) -> float:
        """Mean square of a change on the held-out part."""
        return float(np.mean(change[~self.fitted] ** 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Case:
    """A named effect, and the mismatch that it is to explain, as the court sees them.

    Parameters
    ----------
    court : _Court
        Where it competes.
    name : str
        Canonical name.
    gain : float
        What the refit with the effect gained, SI.
    residual : ndarray, shape (n,)
        Without the effect.
    named : ndarray, shape (n,)
        The effect's change of the readings, less what the parameters take up.
    """

    court: _Court
    name: str
    gain: float
    residual: np.ndarray
    named: np.ndarray

    @cached_property
    def mismatch(self) -> np.ndarray:
        """The residual less what the parameters take up, shape (n,)."""
        return self.court.left(self.residual)

    @property
    def gain_beyond(self) -> float:
        """Return what the refit with the effect gained beyond what the parameters alone would, to first order, SI."""
        return self.gain - (self.court.unseen_power(self.residual) - self.court.unseen_power(self.mismatch))

    def opposite(self) -> Placebo:
        """The effect with the wrong sign; relative to the refit, since to first order only one of the two can gain."""
        share = self.court.gain(-self.named, self.mismatch) / self.gain
        return Placebo(effect=self.name, kind=PlaceboKind.OPPOSITE, share=share, expected=0.0)

    def backwards(self, change: np.ndarray) -> Placebo:
        """The effect on commands that run backwards, relative to the effect to first order: both might be refitted."""
        return self._best(PlaceboKind.BACKWARDS, [change], at_least=0.0)

    def random_phases(self, changes: Sequence[np.ndarray]) -> Placebo:
        """Signals of the effect's spectrum, relative to what the refit gained beyond the parameters alone, too.

        They are added to the readings, so that of their strength first order is all there is; of the effect it is not.
        """
        return self._best(PlaceboKind.RANDOM_PHASES, changes, at_least=self.gain_beyond)

    def _best(self, kind: PlaceboKind, changes: Sequence[np.ndarray], at_least: float) -> Placebo:
        """The best of several shams, of those that differ from the effect, which gains `at_least` so much, SI."""
        own, whole = (self.court.gain(self.named, of) for of in (self.mismatch, self.named))
        if own < NEARLY_LINEAR * self.gain:
            return self.skipped(kind, "the readings are too far from linear in the effect")
        shams, against = [self.court.left(change) for change in changes], max(own, at_least)
        pairs = [
            (self.court.gain(sham, self.mismatch) / against, self.court.gain(sham, self.named) / whole)
            for sham in shams
        ]
        distinct = [pair for pair in pairs if pair[1] <= DISTINCT]
        if 2 * len(distinct) <= len(pairs):
            return self.skipped(kind, "with these inputs it hardly differs from the real effect")
        share, expected = max(distinct)
        return Placebo(effect=self.name, kind=kind, share=share, expected=expected)

    def skipped(self, kind: PlaceboKind, reason: str) -> Placebo:
        """Nothing can be learned."""
        return Placebo(effect=self.name, kind=kind, skipped=reason)


def _none_judged(name: str, reason: str) -> tuple[Placebo, ...]:
    """No kind of sham has anything to say of an effect."""
    return tuple(Placebo(effect=name, kind=kind, skipped=reason) for kind in PlaceboKind)


def placebo_effects(
    without: Calibration,
    effect: Effect,
    gain: float,
    fitted: Sequence[Part],
    everything: Sequence[Part],
    rng: np.random.Generator,
) -> tuple[Placebo, ...]:
    """Let the shams of a named effect compete with it.

    The plant without the effect is simulated with and without it, on the commands and on the commands backwards. The
    changes of the readings compete as regressors, each fitted to the fitted part together with the plant's parameters
    to first order, and are judged on the held-out part. A sham is skipped where it would explain most of the mismatch
    even if the named effect were the truth: an effect without memory is the same backwards, and a tone of random phase
    is a tone.

    Parameters
    ----------
    without : Calibration
        Of the plant without the effect, on the fitted part.
    effect : Effect
        The named effect with its fitted parameters.
    gain : float
        By which the mean square on the held-out part falls with it, SI.
    fitted, everything : sequence of Part
        What was fitted, and that together with what judges.
    rng : numpy.random.Generator
        Of the random phases.

    Returns
    -------
    tuple of Placebo
        One of each kind; skipped where the effect gains nothing or cannot be simulated in the plant without it.
    """
    problem = Problem(plant=without.plant, parts=tuple(everything), names=without.names)
    evaluated, change = problem.evaluate(problem.start()), _change(without.plant, effect, everything)
    if evaluated is None or change is None:
        return _none_judged(effect.name, "the plant cannot be simulated without the effect, or with the placebo effect")
    if gain <= 0:
        return _none_judged(effect.name, "the effect gains nothing, so there is nothing to compare")
    residual, jacobian = evaluated
    length = np.linalg.norm(jacobian, axis=0)
    court = _Court(jacobian=jacobian / np.where(length > 0, length, 1.0), fitted=_fitted(fitted, everything))
    case = _Case(
        court=court, name=effect.name, gain=gain, residual=residual, named=court.left(_counted(change, everything))
    )
    drawn = [[[phase_randomised(y, rng) for y in each] for each in change] for _ in range(DRAWS)]
    turned = _change(without.plant, effect, [_backwards(part) for part in everything])
    return (
        case.skipped(PlaceboKind.BACKWARDS, "the plant cannot be simulated with reversed commands")
        if turned is None
        else case.backwards(_counted(_forwards(turned), everything)),
        case.opposite(),
        case.random_phases([_counted(each, everything) for each in drawn]),
    )


def backwards(experiment: Experiment) -> Experiment:
    """The commands of an experiment, the last first.

    Parameters
    ----------
    experiment : Experiment
        Recordings on one clock.

    Returns
    -------
    Experiment
        It begins at the same time; its first record is the last one, backwards.
    """
    return Experiment(
        recordings=tuple(
            replace(
                record,
                inputs=record.inputs[:, ::-1],
                outputs=record.outputs[:, ::-1],
                extras={name: values[::-1] for name, values in record.extras.items()},
                start=experiment.start + (experiment.end - record.end),
            )
            for record in reversed(experiment.recordings)
        )
    )


def phase_randomised(signal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A signal of the same mean and spectrum with phases drawn anew.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Any.
    rng : numpy.random.Generator
        Of the phases.

    Returns
    -------
    ndarray, shape (n,)

    References
    ----------
    Theiler et al., Physica D 58 (1992) 77, doi:10.1016/0167-2789(92)90102-S.
    """
    spectrum = np.fft.rfft(signal)
    phases = rng.uniform(0, 2 * np.pi, spectrum.size)
    phases[0] = 0.0
    return np.fft.irfft(np.abs(spectrum) * np.exp(1j * phases) * np.sign(spectrum[0].real or 1.0), signal.size)


def _change(plant: Plant, effect: Effect, parts: Sequence[Part]) -> list[list[np.ndarray]] | None:
    """Return what the effect does to the reading of each record of each part, SI, in the units of its residuals."""
    changes, known = [], {}
    amended = plant.with_effects(effect)
    for part in parts:
        if part.history not in known:
            known[part.history] = amended.simulate(part.experiment), plant.simulate(part.experiment)
        with_it, without = known[part.history]
        if not (with_it.status.ok and without.status.ok):
            return None
        row = part.row(plant.rig)
        pairs = zip(with_it.outputs, without.outputs, strict=True)
        levels = part.levels or (1.0,) * len(part.masks)
        changes.append([part.weight * (y[row] - x[row]) / level for (y, x), level in zip(pairs, levels, strict=True)])
    return changes


def _backwards(part: Part) -> Part:
    levels = None if part.levels is None else tuple(level[::-1] for level in reversed(part.levels))
    masks = tuple(mask[::-1] for mask in reversed(part.masks))
    return replace(part, experiment=backwards(part.experiment), masks=masks, levels=levels)


def _counted(changes: Sequence[Sequence[np.ndarray]], parts: Sequence[Part]) -> np.ndarray:
    """The samples that count, one after another."""
    pairs = zip(changes, parts, strict=True)
    return np.concatenate([y[m] for each, part in pairs for y, m in zip(each, part.masks, strict=True)])


def _fitted(fitted: Sequence[Part], everything: Sequence[Part]) -> np.ndarray:
    """Return which of all samples that count were fitted."""
    pairs = zip(fitted, everything, strict=True)
    return np.concatenate([f[m] for some, whole in pairs for f, m in zip(some.masks, whole.masks, strict=True)])


def _forwards(changes: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
    """Changes of backward experiments on the clock of the forward ones."""
    return [[y[::-1] for y in reversed(each)] for each in changes]
