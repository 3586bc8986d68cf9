"""The question for the next experiment: the remaining explanations, their posteriors, and existing information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part, free_run_residuals, simulated
from deatwin.ident.greybox.problem import Problem, Response
from deatwin.ident.mismatch.advise.difference import Difference
from deatwin.ident.mismatch.advise.distance import Memory, directions, distance_squared
from deatwin.ident.mismatch.advise.waveforms import Limits, bears, limits_of, safe_limits, used_range, waveform
from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import MOST
from deatwin.ident.parallel import run_jobs
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

DRAWS = 2
"""Number of plants that are drawn from each posterior, besides the fitted one."""
HALVED = 8
"""Largest number of times a draw is halved until its first-order change of the readings is accurate enough."""
STEPS = 2
"""Number of steps of an alternative's refit with simulations; there are many refits."""
NEAREST = 2
"""Number of the nearest pairs of each explanation for which the alternative is refitted with simulations."""
CALMED = 3
"""Largest number of times the range is reduced for an input that moves the plant too far."""
PROBE = 100
"""Number of samples for which a drawn plant must bear the extremes of the recorded commands, as the real plant did."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """The question which of several explanations is right."""

    problem: DiagnosisProblem
    fits: tuple[Calibration, ...]  # fits to the fitted data, the best first
    noise: float  # standard deviation of the sensor's noise, SI
    # For each fit, coordinates of posterior plants minus its own; the first is 0
    shifts: tuple[tuple[np.ndarray, ...], ...]
    pairs: tuple[tuple[int, int], ...]  # numbers of the truth and of the alternative
    memories: tuple[Memory, ...]  # for each pair, the information in the existing recordings
    seed: int  # seed of random waveforms; a longer waveform continues a shorter one

    @classmethod
    def of(cls, problem: DiagnosisProblem, fits: Sequence[Calibration], noise: float, rng: np.random.Generator) -> Self:
        """Draw plants from the posteriors of two explanations or more, and pair the explanations; `noise` is in SI."""
        number = {id(fit): k for k, fit in enumerate(fits)}
        couples = [(one, other) for k, one in enumerate(fits) for other in fits[k + 1 :]]
        pairs = tuple(
            (number[id(truth)], number[id(alternative)])
            for couple in couples
            for truth, alternative in directions(*couple)
        )
        return cls(
            problem=problem,
            fits=tuple(fits),
            noise=noise,
            pairs=pairs,
            shifts=tuple((np.zeros(len(fit.names)), *_draws(problem, fit, noise, rng)) for fit in fits),
            memories=tuple(Memory.of(fits[truth], fits[alternative], problem.fitted) for truth, alternative in pairs),
            seed=int(rng.integers(2**32)),
        )

    @property
    def before(self) -> np.ndarray:
        """Return the first-order d² from each explanation to the nearest one, on the existing recordings."""
        return self._nearest(self._before)

    @cached_property
    def _before(self) -> np.ndarray:
        """Return d² for each pair, to first order, on the existing recordings."""
        return np.array([memory.refitted.squared_distance(self.noise) for memory in self.memories])

    def before_told(self, known: Mapping[frozenset[int], float]) -> np.ndarray:
        """Return `before`, (n_fits,), or smaller distances where refits gave these: `known` has d² of pairs."""
        told = np.array([known.get(frozenset(pair), np.inf) for pair in self.pairs])
        return self._nearest(np.minimum(self._before, told))

    @property
    def sample_time(self) -> float:
        """Return the sample time of the recordings, s."""
        return self.problem.nominal.rig.sample_time

    @cached_property
    def limits(self) -> Limits | None:
        """Return the range of commands that all posterior plants tolerate; None if there is none."""
        return safe_limits(self.posterior, limits_of(self.problem.nominal, self.problem.everything))

    @cached_property
    def posterior(self) -> tuple[Plant, ...]:
        """Return all posterior plants."""
        return tuple(_moved(fit, x) for fit, shifts in zip(self.fits, self.shifts, strict=True) for x in shifts)

    def with_mass(self, mass: float) -> Question:
        """Return the question under another load than that of the existing recordings; `mass` is in kg."""
        return replace(self, fits=tuple(replace(f, plant=f.plant.with_values({"mass": mass})) for f in self.fits))

    def commands(self, name: str, count: int) -> np.ndarray | None:
        """Return a waveform, (count,), within the limits; None if they do not allow it."""
        # A waveform usually covers the whole working range. If that moved the plant so far that the larger model error
        # would hide the mismatch of the existing recordings, the range is reduced to that of these recordings, near the
        # command farthest from rest.
        limits, share = self.limits, 1.0
        made = None if limits is None else self._made(name, count, limits)
        if made is None or limits is None:
            return None
        error = self._error_of(made)
        for _ in range(1 + CALMED):
            calmer = self._made(name, count, self._near_the_farthest(limits, share)) if error > self._hidden else None
            if calmer is None or (calmed := self._error_of(calmer)) > error:
                break
            made, error = calmer, calmed
            share *= self._hidden / error if error > 0 else 1.0  # without an error nothing moves in this range
        return made

    def _near_the_farthest(self, limits: Limits, share: float) -> Limits:
        """Return a part of the recordings' range of commands, at the end that is farther from rest."""
        least, most = used_range(self.problem.everything)
        low, high = np.clip([min(limits.rest, least), max(limits.rest, most)], limits.lowest, limits.highest)
        if high - limits.rest >= limits.rest - low:
            return replace(limits, bottom=high - share * (high - low), top=high)
        return replace(limits, bottom=low, top=low + share * (high - low))

    def _made(self, name: str, count: int, limits: Limits) -> np.ndarray | None:
        rng = np.random.default_rng(self.seed)
        return waveform(name, limits, count * self.sample_time, self.sample_time, rng)

    def _error_of(self, commands: np.ndarray) -> float:
        """Return the model error on an input, SI; that on the existing recordings if it cannot be simulated."""
        rig, readings = self.problem.nominal.rig, simulated(self.fits[0].plant, self.parts(commands))
        return rig.model_error if readings is None else rig.for_motion(float(readings.std())).model_error

    @property
    def _hidden(self) -> float:
        """Return the smallest rms excess that counts on the existing recordings, SI."""
        return practical_size(self.noise, self.problem.nominal.rig.model_error)

    def recording(self, commands: np.ndarray) -> Recording:
        """Return commands, (n,), as the record of a separate experiment, without readings.

        Its clock starts at 0 or, if an explanation contains an event, which is not undone, after the existing
        recordings.
        """
        events = any(effect.event for fit in self.fits for effect in fit.plant.effects)
        start = max(part.experiment.end for part in self.problem.everything) if events else 0.0
        rig = self.problem.nominal.rig
        return Recording.from_arrays(
            commands,
            np.empty((0, commands.size)),
            self.sample_time,
            start=start,
            input_names=(rig.input_name,),
            input_units=(rig.input_unit,),
            output_names=(),
            output_units=(),
        )

    def parts(self, commands: np.ndarray) -> list[Part]:
        """Wrap commands, (n,), as parts of a fit, with readings of zero."""
        rig, silent = self.problem.nominal.rig, np.zeros((1, commands.size))
        record = replace(
            self.recording(commands), outputs=silent, output_names=(rig.output_name,), output_units=(rig.output_unit,)
        )
        return [Part.whole(Experiment(recordings=(record,)))]

    def is_safe(self, commands: np.ndarray) -> bool:
        """Return whether all plants of all posteriors bear the commands, (n,)."""
        rest = self.problem.nominal.rig.start.rest_command
        return all(run_jobs(bears, [(plant, commands, rest) for plant in self.posterior], workers=self.problem.jobs))

    def first_order(self, commands: np.ndarray) -> np.ndarray:
        """Return first-order d², (n_fits,), to the nearest explanation after recordings of `commands`, (n,).

        An explanation that cannot be simulated has a distance of 0.
        """
        return self._nearest(self._distances(commands))

    def _distances(self, commands: np.ndarray) -> np.ndarray:
        """Return d² for each pair."""
        parts, responses = self.parts(commands), [r for r in self._responses(commands) if r is not None]
        if len(responses) < len(self.fits):
            return np.zeros(len(self.pairs))
        distances = []
        for (truth, alternative), memory in zip(self.pairs, self.memories, strict=True):
            readings = -responses[truth][0]  # measured is zero, so the residual is minus the reading
            left = readings + responses[alternative][0]
            known = Difference.between(self.fits[truth].plant, self.fits[alternative].plant, readings, left, parts)
            both = Memory(known=known, jacobian=responses[alternative][1]).beside(memory)
            distances.append(both.refitted.squared_distance(self.noise))
        return np.array(distances)

    def _responses(self, commands: np.ndarray) -> list[Response | None]:
        """Return the response of each explanation to an input; those to the last one are kept, as all draws need them."""
        made = commands.tobytes()
        if made not in self._last_responses:
            jobs = [(fit, tuple(self.parts(commands))) for fit in self.fits]
            self._last_responses.clear()
            self._last_responses[made] = run_jobs(_response, jobs, workers=self.problem.jobs)
        return self._last_responses[made]

    @cached_property
    def _last_responses(self) -> dict[bytes, list[Response | None]]:
        return {}

    def refitted(self, commands: np.ndarray, draw: int = 0) -> np.ndarray:
        """Return d², (n_fits,), to the nearest explanation, with each alternative refitted to the truth's response.

        The truth under `commands`, (n,), is the posterior plant number `draw`, 0 for the fitted one. Infinite if no
        alternative can be simulated; raise SimulationError if a truth cannot.
        """
        parts, responses, contested = self.parts(commands), self._responses(commands), self._contested(commands)
        jobs: list[tuple[Any, ...]] = []
        for k in contested:
            (truth, alternative), memory = self.pairs[k], self.memories[k]
            fit, shift = self.fits[truth], self.shifts[truth][draw % len(self.shifts[truth])]
            change = fit.jacobian @ shift
            known = replace(memory.known, readings=memory.known.readings + change, left=memory.known.left + change)
            memory = replace(memory, known=known)
            others = (self.fits[alternative], parts, self.noise, memory, STEPS, responses[alternative])
            jobs.append((_moved(fit, shift), *others))
        distances = np.full(len(self.pairs), np.inf)
        distances[contested] = run_jobs(distance_squared, jobs, workers=self.problem.jobs)
        return self._nearest(distances)

    def _contested(self, commands: np.ndarray) -> list[int]:
        """Return the nearest pairs to first order, some for each explanation; all pairs if there are few."""
        if len(self.pairs) <= NEAREST * len(self.fits):
            return list(range(len(self.pairs)))
        rough = self._distances(commands)
        return sorted({int(k) for involved in self._involved for k in involved[np.argsort(rough[involved])[:NEAREST]]})

    def _nearest(self, distances: np.ndarray) -> np.ndarray:
        """Reduce values of pairs to the smallest value of each explanation, in either direction."""
        return np.array([distances[involved].min() for involved in self._involved])

    @cached_property
    def _involved(self) -> tuple[np.ndarray, ...]:
        """Return, for each explanation, the pairs that contain it."""
        return tuple(np.flatnonzero([k in pair for pair in self.pairs]) for k in range(len(self.fits)))


def _response(fit: Calibration, parts: tuple[Part, ...]) -> Response | None:
    """Return the response of an explanation at its fitted parameters."""
    fitting = Problem(plant=fit.plant, parts=parts, names=fit.names)
    return fitting.evaluate(fitting.start())


def _draws(problem: DiagnosisProblem, fit: Calibration, noise: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Draw differences of coordinates from the covariance, within the physical range and the range of the first order."""
    fitting = Problem(plant=fit.plant, parts=(), names=fit.names)
    start, (lower, upper) = fitting.start(), fitting.bounds()
    variances, axes = np.linalg.eigh(fit.covariance)
    root = axes * np.sqrt(np.maximum(variances, 0.0))
    probe = np.repeat(used_range(problem.everything), PROBE)
    shifts = [np.clip(start + root @ rng.standard_normal(start.size), lower, upper) - start for _ in range(DRAWS)]
    shifts = [near for shift in shifts if (near := _in_first_order(problem, fit, shift, noise)) is not None]
    return [shift for shift in shifts if bears(_moved(fit, shift), probe, 0.0, headroom=1.0)]


def _in_first_order(problem: DiagnosisProblem, fit: Calibration, shift: np.ndarray, noise: float) -> np.ndarray | None:
    """Halve a shift until its first-order change of the fitted readings is accurate; None if it never is."""
    # A covariance is a first-order result. Where parameters are hardly known, a draw may lie so far away that its plant
    # contradicts the recordings; alternatives are then not refitted to it in a few steps, and seem to be distinguished.
    for halved in 0.5 ** np.arange(1 + HALVED):
        left, change = free_run_residuals(_moved(fit, halved * shift), problem.fitted), fit.jacobian @ (halved * shift)
        if left is None:
            continue
        error, size = (float(np.linalg.norm(one)) for one in (fit.residuals - left - change, change))
        if error <= max(MOST * size, noise):  # an error of this length is within the noise
            return np.asarray(halved * shift)
    return None


def _moved(fit: Calibration, shift: np.ndarray) -> Plant:
    """Return the plant at shifted coordinates."""
    if not shift.any():
        return fit.plant
    fitting = Problem(plant=fit.plant, parts=(), names=fit.names)
    return fit.plant.with_values(fitting.values(fitting.start() + shift))
