"""Extended Kalman likelihood and smoother of a plant into which something unknown enters at one place.

The unknown quantity d starts from zero and is an Ornstein-Uhlenbeck process d_{k+1} = phi d_k + sqrt(1 - phi^2) a w_k,
phi = exp(-h/T), with the most likely amplitude a and memory T. Calibrated parameters are unknown again; the model error
wanders with a known size. The filter is linearised along the free run (Kristensen, Madsen, Jørgensen, Comput. Chem.
Eng. 28 (2004) 1431-1449).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from deatwin.ident.greybox.filter_foreign import linearise
from deatwin.ident.greybox.filter_linear import Floor, Linear
from deatwin.ident.greybox.filter_openings import Opening
from deatwin.ident.greybox.parts import Part
from deatwin.ident.kalman import Filtered, StateSpace, kalman_filter, kalman_smoother
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant

STEPS = 1500  # Most filter steps while amplitude and memory are estimated; samples are joined to keep to it
MEMORIES = 5  # Number of memories that are tried, from one step to three times the record
SHARES = (0.1, 0.5, 2.0)
"""Amplitudes that are tried, as the rms of their effect on the reading divided by the rms residual."""
REFINEMENTS = 25  # Likelihood evaluations for the refinement of amplitude and memory


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened:
    """A plant with an unknown input at one place, and the resulting likelihood of the recordings."""

    opening: Opening | None  # Place that is opened, if any
    amplitude: float  # Stationary standard deviation of the unknown input, SI
    memory: float  # Correlation time of the unknown input, s
    log_likelihood: float
    terms: Array  # shape (n,): Contribution of each filter step to the log likelihood, one part after another


@dataclass(frozen=True, kw_only=True, eq=False)
class Latent:
    """Smoothed estimate of a plant's unknown input, given all readings."""

    opening: Opening  # Place at which the unknown input enters
    timepts: Array  # shape (n,): Clock times at the ends of the samples, one part after another, s
    mean: Array  # shape (n,): Mean of the unknown input during each sample, SI (a pure number if it is a factor)
    deviation: Array
    states: Mapping[str, Array]
    counted: NDArray[np.bool_]  # shape (n,): True where a reading counts
    origin: NDArray[np.int_]  # shape (n,): Position of the part that a sample belongs to
    amplitude: float
    memory: float
    log_likelihood: float


def filter_likelihood(
    linears: Sequence[Linear],
    floor: Floor,
    opening: Opening | None = None,
    *,
    amplitude: float = 0.0,
    memory: float = 1.0,
) -> Opened:
    """Compute the likelihood of the readings with an unknown input at one place."""
    terms = []
    for linear in linears:
        filtered = _filtered(linear, floor, opening, amplitude, memory)
        variance, innovation = filtered.innovation_variances[0], filtered.innovations[0]
        square = -0.5 * (np.log(2 * np.pi * variance) + innovation**2 / variance)
        # Undo the scaling of innovations: that of a mean of readings was multiplied by the square root of their number.
        terms.append(np.where(linear.counted, square + 0.5 * np.log(np.maximum(linear.counts, 1)), 0.0))
    values = np.concatenate(terms)
    return Opened(opening=opening, amplitude=amplitude, memory=memory, log_likelihood=float(values.sum()), terms=values)


def open_place(linears: Sequence[Linear], floor: Floor, opening: Opening | None) -> Opened:
    """Add an unknown input at a place, with the amplitude and the memory that maximise the likelihood."""
    joined = _few_steps(linears)
    best = filter_likelihood(joined, floor)
    if opening is None:
        return best
    duration = sum(linear.interval * linear.residual.size for linear in joined)
    interval = joined[0].interval
    size = float(np.sqrt(np.nanmean(np.concatenate([linear.residual for linear in joined]) ** 2)))
    memories = np.geomspace(interval, 3 * duration, MEMORIES)
    gains = _gains(joined, opening, memories)
    tried = [
        filter_likelihood(joined, floor, opening, amplitude=share * size / gain, memory=float(memory))
        for memory, gain in zip(memories, gains, strict=True)
        if gain > 0
        for share in SHARES
    ]
    if not tried:
        return best  # the reading does not depend on this place
    first = max(tried, key=lambda o: o.log_likelihood)

    # Readings determine the intensity a²/T well and the memory badly: along these axes the likelihood has no narrow
    # ridge.
    def process(axes: Array) -> tuple[float, float]:
        return float(np.exp(axes[0] + axes[1] / 2)), float(np.exp(axes[1]))

    def value(axes: Array) -> float:
        amplitude, memory = process(axes)
        return -filter_likelihood(joined, floor, opening, amplitude=amplitude, memory=memory).log_likelihood

    start = np.array([np.log(first.amplitude) - np.log(first.memory) / 2, np.log(first.memory)])
    found = minimize(
        value,
        start,
        method="Nelder-Mead",
        bounds=[(None, None), (np.log(interval / 10), np.log(30 * duration))],
        options={
            "initial_simplex": start + np.array([[0.0, 0.0], [0.5, 0.0], [0.0, -1.0]]),
            "maxfev": REFINEMENTS,
            "fatol": 0.05,
            "xatol": 0.05,
        },
    )
    amplitude, memory = process(found.x)
    refined = filter_likelihood(joined, floor, opening, amplitude=amplitude, memory=memory)
    return max((best, first, refined), key=lambda o: o.log_likelihood)


def latent(
    plant: Plant, parts: Sequence[Part], opening: Opening, *, floor: Floor | None = None, opened: Opened | None = None
) -> Latent:
    """Estimate the unknown input of a plant at one place, by smoothing."""
    linears = linearise(plant, parts, (opening,))
    known = Floor.of(linears) if floor is None else floor
    process = open_place(linears, known, opening) if opened is None else opened
    return smoothed(linears, known, process)


def smoothed(linears: Sequence[Linear], floor: Floor, process: Opened) -> Latent:
    """Estimate the unknown input by smoothing, for a plant that is already linearised."""
    opening = process.opening
    if opening is None or not process.amplitude > 0:
        raise ModelError("nothing enters where nothing is opened: the readings are as likely without")
    means, deviations, states, total = [], [], [], 0.0
    for linear in linears:
        filtered = _filtered(linear, floor, opening, process.amplitude, process.memory)
        result = kalman_smoother(filtered)
        total += result.log_likelihood
        means.append(result.states[:, -1])
        deviations.append(result.std[:, -1])
        moved = {name: linear.states[name] + result.states[:, k] for k, name in enumerate(linear.state_names)}
        states.append({**linear.states, **moved})
    return Latent(
        opening=opening,
        timepts=np.concatenate([linear.timepts for linear in linears]),
        mean=np.concatenate(means),
        deviation=np.concatenate(deviations),
        states={name: np.concatenate([s[name] for s in states]) for name in states[0]},
        counted=np.concatenate([linear.counted for linear in linears]),
        origin=np.repeat(np.arange(len(linears)), [linear.residual.size for linear in linears]),
        amplitude=process.amplitude,
        memory=process.memory,
        log_likelihood=total,
    )


def _few_steps(linears: Sequence[Linear]) -> tuple[Linear, ...]:
    size = -(-sum(linear.residual.size for linear in linears) // STEPS)
    return tuple(linear.joined(size) for linear in linears)


def _gains(linears: Sequence[Linear], opening: Opening, memories: Array) -> Array:
    """Return the rms of the readings divided by the rms of an unknown input, a sine of one radian per memory."""
    squares, count = np.zeros(memories.size), 0
    for linear in linears:
        elapsed = linear.timepts - linear.timepts[0]
        waves = np.sqrt(2) * np.sin(elapsed[:, None] / memories)
        answers = linear.response(linear.openings.index(opening), waves)[linear.counted]
        squares += (answers**2).sum(axis=0)
        count += len(answers)
    return np.asarray(np.sqrt(squares / max(count, 1)))


def _filtered(linear: Linear, floor: Floor, opening: Opening | None, amplitude: float, memory: float) -> Filtered:
    """Run the filter over states, constant parameters, model error and unknown input, in this order."""
    n, (n_x, n_p) = linear.residual.size, linear.start_by_parameter.shape
    m = n_x + n_p + 2
    error, entering = m - 2, m - 1
    transition = np.zeros((n, m, m))
    transition[:, range(m), range(m)] = 1.0
    transition[:, :n_x, :n_x] = linear.transition
    transition[:, :n_x, n_x:error] = linear.by_parameter
    rows = np.zeros((n, m))
    rows[:, :n_x], rows[:, n_x:error], rows[:, error] = linear.rows, linear.rows_by_parameter, 1.0
    process = np.zeros((m, m))
    process[error, error] = _wander(transition, error, floor.model_error, floor.memory, linear.interval)
    if opening is not None:
        number = _number(linear, opening)
        transition[:, :n_x, entering] = linear.entering[:, :, number]
        rows[:, entering] = linear.rows_entering[:, number]
        process[entering, entering] = _wander(transition, entering, amplitude, memory, linear.interval)
    start = np.zeros((m, m))
    spread = np.vstack([linear.start_by_parameter, np.eye(n_p)]) * np.sqrt(linear.prior)
    start[:error, :error] = spread @ spread.T
    weight = np.sqrt(linear.counts)
    model = StateSpace(
        rows=rows * weight[:, None],
        noise_variance=np.array(floor.noise**2),
        start=np.zeros(m),
        start_cov=start,
        transition=transition[:-1],
        process_cov=process,
    )
    return kalman_filter(model, linear.residual * weight)


def _wander(transition: Array, state: int, amplitude: float, memory: float, interval: float) -> float:
    """Make a state forget a part of its past in each step; return the variance that a step adds."""
    if not memory > 0:
        raise ModelError(f"a memory of {memory:g} s: it must be positive")
    kept = exp(-interval / memory)
    transition[:, state, state] = kept
    return amplitude**2 * (1 - kept**2)


def _number(linear: Linear, opening: Opening) -> int:
    if opening not in linear.openings:
        known = ", ".join(o.name for o in linear.openings)
        raise ModelError(f"{opening.name} cannot be opened: the plant was linearised for {known}")
    return linear.openings.index(opening)
