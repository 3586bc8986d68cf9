"""Benchmark systems whose parameters are known at every instant, and estimates of parameters that vary.

A walk of likeliest variances follows whatever the structure lacks, and reproduces only the record that it was fitted to.
So how much the parameters may vary is chosen, and judged, on held-out blocks of samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Fixed, NarxModel, Recording, Term, TermTable, ThetaSmoother, ThetaTrajectory, refine
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.recursive import regressor_sizes
from deatwin.ident.narx.regression import Regression
from deatwin.plant.arrays import Array, root_mean_square
from deatwin.plant.excitation import band_limited_noise

STEP = 0.05  # Sampling time of the benchmark systems, s
DURATION = 300.0  # Length of their recordings, s, in which the parameters go there and back once
NOISE = 0.01  # Standard deviation of the equation's noise, in the unit of the output


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownSystem:
    """A NARX model whose parameters are given functions of time."""

    name: str
    terms: Mapping[str, Callable[[Array], Array]]  # Parameter of each term by the phase of the cycle, 0 to 1
    amplitude: float  # Standard deviation of its excitation
    band: float  # Highest frequency of its excitation, Hz

    @property
    def structure(self) -> tuple[Term, ...]:
        """Terms of the model."""
        return tuple(Term.parse(text) for text in self.terms)

    @property
    def is_linear(self) -> bool:
        """True if no term has a higher degree than one."""
        return all(term.degree <= 1 for term in self.structure)

    def truth(self, speed: float = 1.0, duration: float = DURATION) -> ThetaTrajectory:
        """The parameters along time."""
        timepts = STEP * np.arange(round(duration / STEP), dtype=np.float64)
        phase = np.asarray((speed * timepts / DURATION) % 1.0, dtype=np.float64)
        return _exact(list(self.terms), timepts, np.stack([course(phase) for course in self.terms.values()]))

    def excitation(self, rng: np.random.Generator, duration: float = DURATION) -> Array:
        """Draw an input. Shapes: returns (n,)."""
        return band_limited_noise(
            rng, duration, STEP, mean=0.0, variance=self.amplitude**2, band=self.band, lower=-np.inf, upper=np.inf
        )


def recorded(truth: ThetaTrajectory, inputs: Array, noise: Array) -> Recording:
    """Record a system whose noise is part of the equation. Shapes: `inputs`, `noise` (n,)."""
    step, start = truth.model.sample_time, float(truth.timepts[0])
    disturbed = _exact([*map(str, truth.terms), "u2(k)"], truth.timepts, np.vstack([truth.theta, np.ones(inputs.size)]))
    driven = Recording.from_arrays(np.stack([inputs, noise]), np.zeros(inputs.size), step, start=start)
    run = disturbed.simulate(driven)

    return Recording.from_arrays(
        inputs, run.outputs, step, start=start, input_names=("input",), output_names=("output",)
    )


def drawn_walk(
    start: Mapping[str, float], wander: Sequence[float], n: int, rng: np.random.Generator
) -> ThetaTrajectory:
    """Draw parameters that follow random walks."""
    steps = rng.standard_normal((len(start), n)) * np.asarray(wander)[:, None] / np.sqrt(n)
    steps[:, 0] = list(start.values())
    return _exact(list(start), STEP * np.arange(n), np.cumsum(steps, axis=1))


def _exact(terms: Sequence[str], timepts: NDArray[Any], theta: Array) -> ThetaTrajectory:
    model = NarxModel.from_terms(dict(zip(terms, theta[:, -1], strict=True)), sample_time=STEP)
    m, n = theta.shape
    return ThetaTrajectory(
        model=model, timepts=timepts, theta=theta, theta_cov=np.zeros((n, m, m)), drift_variance=np.zeros(m)
    )


def _swing(low: float, high: float) -> Callable[[Array], Array]:
    """Return a smooth course from low to high and back."""
    return lambda phase: low + (high - low) * 0.5 * (1 - np.cos(2 * np.pi * phase))


def _resonance(phase: Array) -> Array:
    """Return 2 r cos(w T) of a pole whose frequency moves from 1 to 3 Hz and back."""
    return 2 * _DAMPED * np.cos(2 * np.pi * _swing(1.0, 3.0)(phase) * STEP)


_DAMPED = 0.92  # magnitude of the resonance's poles

RESONANCE = KnownSystem(
    name="travelling resonance",
    terms=MappingProxyType(
        {"y(k-1)": _resonance, "y(k-2)": lambda phase: np.full_like(phase, -(_DAMPED**2)), "u(k-1)": _swing(0.5, 0.3)}
    ),
    amplitude=0.3,
    band=6.0,
)
"""Linear system y = a(t) y(k-1) - 0.85 y(k-2) + b(t) u(k-1) + e, whose resonance moves from 1 to 3 Hz and back."""

MOVING_DC = KnownSystem(
    name="moving DC",
    terms=MappingProxyType(
        {
            "1": _swing(0.0, 0.5),
            "y(k-1)": lambda phase: np.full_like(phase, 0.7),
            "u(k-1)": lambda phase: np.full_like(phase, 0.5),
            "y(k-1)^2": lambda phase: np.full_like(phase, -0.15),
        }
    ),
    amplitude=0.2,
    band=3.0,
)
"""Quadratic system y = c(t) + 0.7 y(k-1) + 0.5 u(k-1) - 0.15 y(k-1)² + e. Only the constant changes, and with it the
equilibrium, from 0 to 1.1 and back, and the response of every order."""

SYSTEMS = (RESONANCE, MOVING_DC)


Structure = tuple[Term, ...]
Recordings = Sequence[Recording]
BLOCK = 20.0  # Length of a block of the record, s: some twenty correlation times, a hundredth of the slowest histories'
CYCLE = 4  # Blocks in a cycle, of which one is for choosing and one for judging
CHOOSING, JUDGING = 2, 0
SHARES = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Shares of the reading's standard deviation by which each term's contribution may wander over the whole record."""

CONSTANT, REFINED, VARYING, LIKELIEST = "constant", "constant, least free-run error", "varying", "varying, likeliest"
PAST = 5  # Blocks before the first forecast
KEPT_EVERY = 1.0  # Interval at which a trajectory is kept, s


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Parameters of an actuator along time, and free-run errors divided by the standard deviation of the reading."""

    name: str
    recording: Recording  # Whole recording, thinned
    share: float  # Chosen one of `SHARES`
    seen: Mapping[str, float]  # Errors on the fitted record, by method
    unseen: Mapping[str, float]  # Errors on the blocks for judging, with parameters from all others
    ahead: Mapping[str, float]  # Errors of `CONSTANT` and `VARYING` on each block, with parameters from earlier ones
    trajectory: ThetaTrajectory  # Trajectory fitted to the whole record, kept every second
    held: ThetaTrajectory  # Trajectory fitted without the blocks for judging
    held_constant: NarxModel  # Model by least squares without the blocks for judging
    judged: tuple[Recording, ...]  # The blocks for judging


def follow_actuator(name: str, recording: Recording, structure: Structure) -> Track:
    """Choose how much the parameters may vary, estimate them along time, and judge the result."""

    def error(model: NarxModel | ThetaTrajectory, sections: Recordings) -> float:
        return root_mean_square(free_run_errors(model, sections)) / float(recording.outputs.std())

    without = stretches(recording, (JUDGING,))
    judged = _within(blocks_of(recording, JUDGING), without)
    share = SHARES[int(np.argmin(_choice_errors(structure, recording)))]
    smoother = walked(structure, [recording], share, recording)
    constants, held_constants = _constants(structure, [recording]), _constants(structure, without)
    held, likeliest = walked(structure, without, share, recording).trajectory_, _likeliest(structure, without)
    seen: dict[str, NarxModel | ThetaTrajectory] = {**constants, VARYING: smoother.trajectory_}
    unseen: dict[str, NarxModel | ThetaTrajectory] = {**held_constants, VARYING: held, LIKELIEST: likeliest}
    standing = walked(structure, [recording], 0.0, recording)
    step = max(1, round(KEPT_EVERY / recording.sample_time))
    return Track(
        name=name,
        recording=recording,
        share=share,
        seen={key: error(model, [recording]) for key, model in seen.items()} | {LIKELIEST: error(likeliest, without)},
        unseen={key: error(model, judged) for key, model in unseen.items()},
        ahead={
            CONSTANT: _ahead(standing.filtered_, recording) / float(recording.outputs.std()),
            VARYING: _ahead(smoother.filtered_, recording) / float(recording.outputs.std()),
        },
        trajectory=smoother.trajectory_.thinned(step),
        held=held.thinned(step),
        held_constant=held_constants[CONSTANT],
        judged=tuple(judged),
    )


def _choice_errors(structure: Structure, recording: Recording) -> Array:
    """Return the error of each of `SHARES` on the blocks for choosing, which no fit uses."""
    training = stretches(recording, (CHOOSING, JUDGING))
    blocks = _within(blocks_of(recording, CHOOSING), training)
    walks = (walked(structure, training, share, recording).trajectory_ for share in SHARES)
    return np.array([root_mean_square(free_run_errors(walk, blocks)) for walk in walks])


def walked(structure: Structure, training: Recordings, share: float, whole: Recording) -> ThetaSmoother:
    """Filter and smooth parameters that may vary by a given share."""
    regression = Regression.on(whole, TermTable(structure))
    sizes = regressor_sizes(regression.matrix()[0]) * regression.output_scale / regression.term_scales
    wander = share * float(whole.outputs.std()) / sizes
    residual = Fixed(terms=structure).fit(list(training)).model_.noise_variance
    return ThetaSmoother(
        terms=structure, noise_variance=float(residual), drift_variance=wander**2 / whole.n_samples
    ).fit(list(training))


def _constants(structure: Structure, training: Recordings) -> dict[str, NarxModel]:
    """Return constant parameters of the smallest free-run error, started from least squares."""
    constant = Fixed(terms=structure).fit(list(training)).model_
    sound = all(constant.simulate(section).status.ok for section in training)
    return {CONSTANT: constant, REFINED: refine(constant, list(training)) if sound else constant}


def _likeliest(structure: Structure, training: Recordings) -> ThetaTrajectory:
    """Return the parameters for the most likely variances of the walk."""
    smoother = ThetaSmoother(terms=structure, drift="common").fit(list(training))
    if smoother.status_ is FitStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return smoother.trajectory_


def free_run_errors(model: NarxModel | ThetaTrajectory, sections: Recordings) -> Array:
    """Return errors of free runs, each started from the first samples of its section. Shapes: returns (n,)."""
    errors = []
    for section in sections:
        run = model.simulate(section)
        errors.append(run.residuals[0] if run.status.ok else np.full(section.n_samples - run.first, np.inf))
    return np.concatenate(errors)


def _ahead(filtered: ThetaTrajectory, recording: Recording) -> float:
    """Return the error on each block of a model trained on earlier samples only, in the output's unit."""
    every = _cut(recording)[PAST:]
    runs = [free_run_errors(filtered.at(block.start - block.sample_time), [block]) for block in every]
    return root_mean_square(np.concatenate(runs))


def blocks_of(recording: Recording, kind: int) -> list[Recording]:
    """Return every fourth block of a record."""
    return [block for number, block in enumerate(_cut(recording)) if number % CYCLE == kind]


def stretches(recording: Recording, left_out: Sequence[int]) -> list[Recording]:
    """Return the stretches of a record that remain without some kinds of blocks, with neighbours joined."""
    size, count = _block_size(recording), len(_cut(recording))
    kept = np.array([number % CYCLE not in left_out for number in range(count)])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(int), [0]])))
    return [recording.section(a * size, b * size) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _cut(recording: Recording) -> list[Recording]:
    """Return the complete blocks; a remainder at the end is not used."""
    size = _block_size(recording)
    return [recording.section(k * size, (k + 1) * size) for k in range(recording.n_samples // size)]


def _block_size(recording: Recording) -> int:
    """Return the number of samples in a block, an even number."""
    return 2 * round(BLOCK / recording.sample_time / 2)


def _within(blocks: Iterable[Recording], training: Recordings) -> list[Recording]:
    """Return the blocks between the first and the last training sample, where parameters are known."""
    return [b for b in blocks if b.start > training[0].start and b.end < training[-1].end]
