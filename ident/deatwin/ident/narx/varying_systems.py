"""Benchmark systems whose parameters are known at every instant, and their recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import NarxModel, Term, ThetaTrajectory
from deatwin.plant.arrays import Array
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.recording import Recording

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
