"""Placebo effects: changes of the readings as large and as smooth as a named effect's, but with wrong physics.

An effect may explain a mismatch only because it is flexible, slow or correlated with the input. Then it explains the
mismatch equally well if its memory runs backwards in time, its strength has the wrong sign, or its phases are random.
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
from deatwin.ident.mismatch.thresholds import ACCURACY, CLEARLY_LESS, MOST
from deatwin.plant.datasets import Metadata, variable
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

DRAWS = 19
"""Number of sets of random phases; chance alone exceeds the best of 19 in 5 % of all cases."""


class PlaceboKind(Enum):
    """Difference between a placebo effect and the effect; the value is its text."""

    BACKWARDS = "backwards in time"
    OPPOSITE = "with the opposite sign"
    RANDOM_PHASES = "with random phases"


@dataclass(frozen=True, kw_only=True)
class Placebo:
    """Gain of a placebo effect beside that of the effect, on the held-out data."""

    effect: str
    kind: PlaceboKind  # how it differs from the effect
    # Both gains are to first order, but the effect's is that of the refit beside the opposite sign, and the larger of
    # the two beside random phases; None if skipped
    share: float | None = field(
        default=None,
        metadata=variable(about="reduction of the squared error by the placebo, relative to that by the effect"),
    )
    expected: float | None = field(
        default=None, metadata=variable(about="value of `share` that would be expected if the effect were real")
    )
    skipped: str = ""  # reason why it shows nothing; empty if it was judged

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "rejected": variable(),
    }

    @property
    def rejected(self) -> bool:
        """Return whether it explains less than the effect, as it should; also true if it was skipped."""
        return self.share is None or self.share < CLEARLY_LESS


@dataclass(frozen=True, kw_only=True, eq=False)
class _Case:
    """A named effect and the mismatch that it explains, without what the plant's parameters can imitate."""

    name: str
    gain: float  # fall of the held-out mean square due to the refit with the effect, SI
    residual: np.ndarray  # (n,), without the effect
    change: np.ndarray  # (n,), of the readings by the effect
    jacobian: np.ndarray  # (n, p), of the plant without the effect, columns of unit length
    fitted: np.ndarray  # (n,), bool, False for held-out samples

    def left(self, change: np.ndarray) -> np.ndarray:
        """Return the remainder of a change, everywhere, after a first-order refit to the fitted data."""
        solution = np.linalg.lstsq(self.jacobian[self.fitted], change[self.fitted], rcond=ACCURACY)[0]
        return change - self.jacobian @ solution

    @cached_property
    def mismatch(self) -> np.ndarray:
        """Return the remainder of the residual, (n,)."""
        return self.left(self.residual)

    @cached_property
    def named(self) -> np.ndarray:
        """Return the remainder of the effect's change, (n,)."""
        return self.left(self.change)

    def gained(self, by: np.ndarray, of: np.ndarray) -> float:
        """Return by how much the held-out mean square of `of` falls if `by` is fitted to it with an amplitude >= 0."""
        # Both are remainders as returned by `left`.
        energy = float(by[self.fitted] @ by[self.fitted])
        amplitude = max(float(by[self.fitted] @ of[self.fitted]) / energy, 0.0) if energy > 0 else 0.0
        return self.unseen_power(of) - self.unseen_power(of - amplitude * by)

    def unseen_power(self, change: np.ndarray) -> float:
        """Return the mean square of a change in the held-out data."""
        return float(np.mean(change[~self.fitted] ** 2))

    def opposite(self) -> Placebo:
        """Judge the effect with the wrong sign, relative to the refit: to first order only one of both signs can gain."""
        share = self.gained(-self.named, self.mismatch) / self.gain
        return Placebo(effect=self.name, kind=PlaceboKind.OPPOSITE, share=share, expected=0.0)

    def random_phases(self, changes: Sequence[np.ndarray]) -> Placebo:
        """Judge signals with the effect's spectrum, relative to the larger of its first-order gain and the refit's."""
        # These signals are added to the readings, so their first-order gain is exact; that of the effect is not. The
        # refit's gain counts beyond that of the parameters alone.
        by_parameters = self.unseen_power(self.residual) - self.unseen_power(self.mismatch)
        return self.best(PlaceboKind.RANDOM_PHASES, changes, at_least=self.gain - by_parameters)

    def best(self, kind: PlaceboKind, changes: Sequence[np.ndarray], at_least: float = 0.0) -> Placebo:
        """Judge the best of several placebo effects that differ from the effect, whose gain is at least `at_least`, SI."""
        own, whole = (self.gained(self.named, of) for of in (self.mismatch, self.named))
        if own < MOST * self.gain:
            return _skipped(self.name, kind, "the readings do not change linearly with the effect")
        placebos, against = [self.left(change) for change in changes], max(own, at_least)
        pairs = [
            (self.gained(placebo, self.mismatch) / against, self.gained(placebo, self.named) / whole)
            for placebo in placebos
        ]
        distinct = [pair for pair in pairs if pair[1] <= MOST]
        if 2 * len(distinct) <= len(pairs):
            return _skipped(self.name, kind, "with these inputs the placebo hardly differs from the real effect")
        share, expected = max(distinct)
        return Placebo(effect=self.name, kind=kind, share=share, expected=expected)


def _skipped(effect: str, kind: PlaceboKind, reason: str) -> Placebo:
    return Placebo(effect=effect, kind=kind, skipped=reason)


def placebo_effects(
    without: Calibration,
    effect: Effect,
    gain: float,
    fitted: Sequence[Part],
    everything: Sequence[Part],
    rng: np.random.Generator,
) -> tuple[Placebo, ...]:
    """Compare a named effect with placebo effects of each kind; `gain` is the held-out mean square's fall by it, SI."""
    # The plant fitted without the effect is simulated with and without it, for the commands and for the reversed
    # commands. The changes of the readings are used as regressors. Each is fitted to the fitted data together with the
    # plant's parameters, to first order, and judged on the held-out data. A placebo effect is skipped if it would
    # explain most of the mismatch even if the named effect were the truth: an effect without memory does not change if
    # time is reversed, and a tone with a random phase is still a tone.
    problem = Problem(plant=without.plant, parts=tuple(everything), names=without.names)
    evaluated, change = problem.evaluate(problem.start()), _change(without.plant, effect, everything)
    if evaluated is None or change is None:
        reason = "the model cannot be simulated without the effect, or with the placebo effect"
        return tuple(_skipped(effect.name, kind, reason) for kind in PlaceboKind)
    if gain <= 0:
        reason = "the effect does not lower the error, so there is nothing to compare"
        return tuple(_skipped(effect.name, kind, reason) for kind in PlaceboKind)
    residual, jacobian = evaluated
    length = np.linalg.norm(jacobian, axis=0)
    case = _Case(
        name=effect.name,
        gain=gain,
        residual=residual,
        change=_counted(change, everything),
        jacobian=jacobian / np.where(length > 0, length, 1.0),
        fitted=_fitted(fitted, everything),
    )
    drawn = [[[phase_randomised(y, rng) for y in each] for each in change] for _ in range(DRAWS)]
    return (
        _judged_backwards(case, without.plant, effect, everything),
        case.opposite(),
        case.random_phases([_counted(each, everything) for each in drawn]),
    )


def _judged_backwards(case: _Case, plant: Plant, effect: Effect, parts: Sequence[Part]) -> Placebo:
    """Judge an effect with reversed commands if it has a memory; `plant` is without it."""
    # Reversed commands also reverse the memory of all else in the plant, which says nothing about the effect.
    if not _has_memory(effect, plant):
        return _skipped(
            effect.name, PlaceboKind.BACKWARDS, "the effect has no memory, so it is the same backwards in time"
        )
    turned = _change(plant, effect, [_backwards(part) for part in parts])
    if turned is None:
        return _skipped(effect.name, PlaceboKind.BACKWARDS, "the model cannot be simulated with reversed commands")
    return case.best(PlaceboKind.BACKWARDS, [_counted(_forwards(turned), parts)])


def _has_memory(effect: Effect, plant: Plant) -> bool:
    """Return whether an effect adds states to a plant, or depends on the time; true if the equations are unknown."""
    timed = any(parameter.unit in ("s", "Hz") for parameter in effect.describe())
    if timed or not plant.rig.equations_known:
        return True
    return len(plant.with_effects(effect).equations.states) > len(plant.equations.states)


def backwards(experiment: Experiment) -> Experiment:
    """Return an experiment with reversed commands, which begins at the same time."""
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
    """Return a signal, (n,), with the same mean and amplitude spectrum, but random phases."""
    # Theiler et al., Physica D 58 (1992) 77, doi:10.1016/0167-2789(92)90102-S.
    spectrum = np.fft.rfft(signal)
    phases = rng.uniform(0, 2 * np.pi, spectrum.size)
    phases[0] = 0.0
    return np.fft.irfft(np.abs(spectrum) * np.exp(1j * phases) * np.sign(spectrum[0].real or 1.0), signal.size)


def _change(plant: Plant, effect: Effect, parts: Sequence[Part]) -> list[list[np.ndarray]] | None:
    """Return the effect's change of the reading in each record of each part, SI, in the units of the part's residuals."""
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
    """Return the counted samples, concatenated."""
    pairs = zip(changes, parts, strict=True)
    return np.concatenate([y[m] for each, part in pairs for y, m in zip(each, part.masks, strict=True)])


def _fitted(fitted: Sequence[Part], everything: Sequence[Part]) -> np.ndarray:
    """Return a mask of the fitted samples among all counted ones."""
    pairs = zip(fitted, everything, strict=True)
    return np.concatenate([f[m] for some, whole in pairs for f, m in zip(some.masks, whole.masks, strict=True)])


def _forwards(changes: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
    """Return the changes of reversed experiments in the original order."""
    return [[y[::-1] for y in reversed(each)] for each in changes]
