"""Systems of known structure on which identifiers of NARX models are compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_MOST_REDRAWS = 100  # most redraws of a recording: a system that needs more has no stable runs worth the name


@dataclass(frozen=True, kw_only=True, eq=False)
class Draw:
    """A recording of a system."""

    recording: Recording
    redraws: int  # Number of earlier runs that diverged and were discarded with their input and noise


@dataclass(frozen=True, eq=False)
class BenchmarkSystem:
    """A NARX or NARMAX system with its input and noise, and the candidates among which it is to be found."""

    name: str  # Short name, such as "S3"
    equation: Mapping[str, float]  # Parameter of each term, including noise terms e(k-l); e(k) itself is always added
    draw_input: Callable[[np.random.Generator, int], Array]
    noise_std: float  # Standard deviation of the white normal e(k)
    n_samples: int = 500  # Usual length of a recording
    output_lags: int = 4
    input_lags: int = 4
    degree: int = 3
    source: str = ""  # Origin of the system, and the choices made here
    sample_time: float = 1.0  # s

    @cached_property
    def model(self) -> NarxModel:
        """The system itself, including noise terms."""
        return NarxModel.from_terms(self.equation, sample_time=self.sample_time, noise_variance=self.noise_std**2)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The true terms without noise, in the order of ``equation``."""
        return tuple(Term.parse(text) for text in self._known)

    @cached_property
    def theta(self) -> Array:
        """Parameters of the true terms, shape (n_terms,)."""
        values = np.array(list(self._known.values()))
        values.setflags(write=False)
        return values

    @cached_property
    def noise_terms(self) -> tuple[Term, ...]:
        """The true terms with noise, in the order of ``equation``; empty if the noise is white."""
        return tuple(Term.parse(text) for text in self.equation if text not in self._known)

    def draw(self, rng: np.random.Generator, n_samples: int | None = None) -> Draw:
        """Record the system from rest, y = 0 before the run, with new input and noise."""
        n = n_samples or self.n_samples
        for redraws in range(_MOST_REDRAWS):
            inputs = self.draw_input(rng, n)
            noise = self.noise_std * rng.standard_normal(n)
            run = self._driven.simulate(Recording.from_arrays([inputs, noise], np.zeros(n), self.sample_time))
            if run.status.ok:
                recording = Recording.from_arrays(
                    inputs,
                    run.outputs,
                    self.sample_time,
                    input_names=("u",),
                    output_names=("y",),
                    provenance={"system": self.name},
                )
                return Draw(recording=recording, redraws=redraws)
        raise ModelError(f"{_MOST_REDRAWS} runs of {self.name} diverged one after the other: there is none to record")

    @property
    def _known(self) -> dict[str, float]:
        return {text: value for text, value in self.equation.items() if "e(" not in text}

    @cached_property
    def _driven(self) -> NarxModel:
        """Return the system with its noise as a second input, so that one free run serves both cases."""
        as_input = {text.replace("u(", "u1(").replace("e(", "u2("): value for text, value in self.equation.items()}
        return NarxModel.from_terms(as_input | {"u2(k)": 1.0}, sample_time=self.sample_time)


def _uniform(largest: float) -> Callable[[np.random.Generator, int], Array]:
    return lambda rng, n: rng.uniform(-largest, largest, n)


def _normal(std: float) -> Callable[[np.random.Generator, int], Array]:
    return lambda rng, n: std * rng.standard_normal(n)


def _noisy_sine(rng: np.random.Generator, n: int) -> Array:
    """Return 5 sin(2 pi 4.5 t), sampled at 20 Hz, and white noise of 0.1 on it."""
    return np.asarray(5 * np.sin(2 * np.pi * 4.5 * np.arange(n) / 20) + 0.1 * rng.standard_normal(n))


_BOOK = "W. R. Lacerda Junior, Nonlinear System Identification (SysIdentPy), chapter 4, and arXiv:2109.09917"
_MAO_BILLINGS = {"y(k-2)": -0.5, "y(k-1)u(k-1)": 0.7, "u(k-2)^2": 0.6, "y(k-1)^3": 0.2, "y(k-2)u(k-2)^2": -0.7}
_BALDACCHINO = {"y(k-1)u(k-1)": 0.7, "y(k-2)": -0.5, "u(k-2)^2": 0.6, "y(k-2)u(k-2)^2": -0.7}

_SYSTEMS = (
    BenchmarkSystem(
        "S1", {"y(k-1)": -1.7, "y(k-2)": -0.8, "u(k-1)": 1.0, "u(k-2)": 0.81}, _uniform(2.0), 0.01, source=_BOOK
    ),
    BenchmarkSystem(
        "S2", {"y(k-1)": 0.8, "u(k-1)": 0.4, "u(k-1)^2": 0.4, "u(k-1)^3": 0.4}, _normal(0.3), 0.01, source=_BOOK
    ),
    BenchmarkSystem("S3", _MAO_BILLINGS, _uniform(1.0), 0.01, source=f"{_BOOK}; the system of E1"),
    BenchmarkSystem("S4", _BALDACCHINO, _uniform(1.0), 0.04, source=f"{_BOOK}, there after Baldacchino et al. (2013)"),
    BenchmarkSystem(
        "S5",
        _BALDACCHINO | {"e(k-1)": 0.2, "u(k-1)e(k-2)": -0.3},
        _uniform(1.0),
        0.02,
        source=f"{_BOOK}; S4 with coloured noise",
    ),
    BenchmarkSystem(
        "S6",
        {"y(k-2)": 0.75, "u(k-1)": 0.25, "y(k-2)u(k-1)": -0.2},
        _normal(0.25),
        0.02,
        source=f"{_BOOK}; its equation 57 has u(k-2) where its table 12 has u(k-1), which is taken here",
    ),
    BenchmarkSystem(
        "E0",
        {"y(k-1)": 0.3, "u(k-1)": 0.1, "y(k-1)y(k-2)": 0.4},
        _uniform(5.0),
        0.1,
        source="W. R. Jacobs, Identification and Frequency Response Analysis with Application to Soft Smart "
        "Actuators (thesis, Sheffield), section 6.4.2; its input is not known: uniform in ±5 is chosen, so that "
        "500 samples tell the product of outputs from nothing (|t| about 10; in ±1 it would be 1.4)",
    ),
    BenchmarkSystem(
        "E1",
        _MAO_BILLINGS,
        _uniform(1.0),
        0.004**0.5,
        n_samples=1000,
        degree=4,
        source="W. R. Jacobs, thesis as E0, section 6.5.1; locally stable only",
    ),
    BenchmarkSystem(
        "WK",
        {"y(k-1)": 0.5, "y(k-2)": -0.3, "u(k-2)": 0.1, "u(k-1)u(k-2)": 0.4},
        _noisy_sine,
        0.2,
        sample_time=0.05,
        source="R. N. Watanabe, Nonlinear-System-Identification-and-Frequency-Analysis, examples/example.py, with "
        "u and y exchanged; the input is one sine and a little noise, so that many candidates are nearly collinear",
    ),
)
SYSTEMS: Mapping[str, BenchmarkSystem] = MappingProxyType({system.name: system for system in _SYSTEMS})
"""Benchmark systems by name."""
