"""Benchmark systems whose equations are known, and what of them is looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import gfrf
from deatwin.ident.frequency.uncertainty.parameters import Quantity
from deatwin.ident.narx import Fixed, NarxModel
from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem

Array = NDArray[np.float64]

POINTS = 40
"""Frequencies of a response."""
AT = 0.0
"""Operating input of all systems."""
LOWEST = 0.02
"""Of half the sampling rate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A system, the recordings that it is identified from, and the orders of its response."""

    name: str
    system: BenchmarkSystem  # With its input and noise
    n_samples: int
    orders: tuple[int, ...]

    def identify(self, rng: np.random.Generator) -> NarxModel:
        """Estimate the true terms by least squares from a new recording."""
        return Fixed(terms=self.system.terms).fit(self.system.draw(rng, self.n_samples).recording).model_

    @property
    def truth(self) -> NarxModel:
        """The system itself."""
        return self.system.model

    def omega(self, order: int, points: int = POINTS) -> Array:
        """Frequencies at which a response is looked at: all tones equal, their sum up to half the sampling rate.
        Shapes: returns (points,), rad/s.
        """
        harmonic = np.pi / self.system.sample_time * np.linspace(LOWEST, 1 - LOWEST, points)
        return harmonic if order == 1 else np.repeat(harmonic[:, None] / order, order, axis=1)

    def response(self, order: int, points: int = POINTS) -> Quantity:
        """What `propagate` takes."""
        return partial(gfrf, order=order, omega=self.omega(order, points), operating_input=AT)


def _case(name: str, system: BenchmarkSystem, noise: float, n_samples: int, orders: tuple[int, ...]) -> Case:
    return Case(name=name, system=replace(system, noise_std=noise), n_samples=n_samples, orders=orders)


_NOTCH = BenchmarkSystem(
    name="notch",
    equation={"y(k-1)": 1.2, "y(k-2)": -0.5, "u(k-1)": 1.0, "u(k-2)": -0.72, "u(k-3)": 1.0},
    draw_input=lambda rng, n: rng.uniform(-1, 1, n),
    noise_std=0.3,
    source="made for this page: its zeros lie on the unit circle at 1.2 rad a sample",
)

CASES: Mapping[str, Case] = MappingProxyType(
    {
        case.name: case
        for case in (
            _case("S1, linear", SYSTEMS["S1"], 0.1, 500, (1,)),
            _case("S2, powers of the input", SYSTEMS["S2"], 0.01, 500, (1, 2, 3)),
            _case("S6, bilinear", SYSTEMS["S6"], 0.01, 4000, (1, 2, 3)),
            _case("E0, product of outputs", SYSTEMS["E0"], 0.1, 4000, (1, 2, 3)),
        )
    }
)
"""Those whose parameters are known well enough that the law of propagation, which is linear, should hold."""
LINEAR, POWERS, BILINEAR, PRODUCT = CASES
NOTCH = _case("notch", _NOTCH, 0.3, 300, (1,))
SHORT = _case("S6, from a short record", SYSTEMS["S6"], 0.05, 200, (1, 2, 3))
"""Where the law fails: near zero gain, and where the parameters are hardly known."""
