"""One draw, one method: which terms it keeps, with which parameters."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem, Draw
from deatwin.plant.errors import DeatwinError
from deatwin.scenarios.svb_benchmark.methods import METHODS

Array = NDArray[np.float64]
LEVEL = 0.95
"""Of all intervals."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """How often something happened."""

    hits: int  # How often, and out of how many
    count: int

    @classmethod
    def of(cls, happened: Iterable[bool]) -> Rate:
        """Count."""
        flags = list(happened)
        return cls(hits=sum(map(bool, flags)), count=len(flags))

    @property
    def share(self) -> float:
        """Hits over count."""
        return self.hits / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of Clopper and Pearson (Biometrika 26 (1934) 404), which never covers less."""
        from scipy.stats import beta

        out, rest = 0.5 * (1 - LEVEL), self.count - self.hits
        low = float(beta.ppf(out, self.hits, rest + 1)) if self.hits else 0.0
        high = float(beta.ppf(1 - out, self.hits + 1, rest)) if rest else 1.0
        return low, high

    def __str__(self) -> str:
        low, high = (100 * end for end in self.interval)
        return f"{100 * self.share:.4g} % ({low:.3g} to {high:.3g})"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What a method made of a draw."""

    system: str  # Their names
    method: str
    number: int
    redraws: int  # Runs that diverged before it
    terms: tuple[str, ...]  # That were kept; none if the method failed
    theta: tuple[float, ...]  # Their parameters and 95 % intervals
    low: tuple[float, ...]
    high: tuple[float, ...]
    missed: int  # True terms that were not kept, and false ones that were
    false: int
    seconds: float  # Processor time of the fit
    failure: str = ""  # What the method complained of

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The trial of plain data, as `dataclasses.asdict` makes it and as a file gives it back."""
        fields: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
        return cls(**fields)

    @property
    def kept(self) -> bool:
        """Whether every true term was kept."""
        return self.missed == 0

    @property
    def exact(self) -> bool:
        """Whether the terms are the true ones."""
        return self.missed == self.false == 0


def system_of(name: str, noise_variance: float | None = None) -> BenchmarkSystem:
    """A benchmark system, with other noise if wanted."""
    system = SYSTEMS[name]
    return system if noise_variance is None else replace(system, noise_std=noise_variance**0.5)


def draw_of(system: BenchmarkSystem, seed: int, number: int) -> Draw:
    """The same draw for the same numbers, whatever else is drawn."""
    place = list(SYSTEMS).index(system.name)
    return system.draw(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(place, number))))


def intervals(model: NarxModel) -> tuple[Array, Array]:
    """Ends of the 95 % intervals of a model's parameters. Shapes: returns (n_terms,)."""
    from scipy.stats import norm, t

    variance, dof = np.diag(model.theta_cov), model.theta_dof
    if np.isinf(dof):
        reach = norm.ppf(0.5 * (1 + LEVEL)) * np.sqrt(variance)
    else:
        reach = t.ppf(0.5 * (1 + LEVEL), dof) * np.sqrt(variance * (dof - 2) / dof)
    return model.theta - reach, model.theta + reach


def try_out(name: str, method: str, seed: int, number: int, noise_variance: float | None = None) -> Trial:
    """Let a method identify a draw."""
    system = system_of(name, noise_variance)
    draw = draw_of(system, seed, number)
    identifier = METHODS[method].make(system)
    begin = time.process_time()
    try:
        model, failure = identifier.fit(draw.recording).model_, ""
    except DeatwinError as error:
        model, failure = None, str(error)
    seconds = time.process_time() - begin
    if not failure and not identifier.status_.ok:
        raise KeyboardInterrupt  # the method has kept its best so far, which is no result of the study
    terms = () if model is None else model.terms
    low, high = ((), ()) if model is None else (tuple(end.tolist()) for end in intervals(model))
    return Trial(
        system=name,
        method=method,
        number=number,
        redraws=draw.redraws,
        terms=tuple(map(str, terms)),
        theta=() if model is None else tuple(model.theta.tolist()),
        low=low,
        high=high,
        missed=len(set(system.terms) - set(terms)),
        false=len(set(terms) - set(system.terms)),
        seconds=seconds,
        failure=failure,
    )


def as_csv(trials: Iterable[Trial]) -> str:
    """A line for each trial."""
    lines = ["system,method,draw,redraws,missed,false,terms"]
    for t in trials:
        lines.append(f"{t.system},{t.method},{t.number},{t.redraws},{t.missed},{t.false},{' + '.join(t.terms)}")
    return "\n".join(lines) + "\n"
