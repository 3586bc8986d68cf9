"""The sampler beside variational Bayes, on draws of S4."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.bayes import Statistics
from deatwin.ident.narx.regression import Regression
from deatwin.scenarios.svb_benchmark.gibbs import SpikeSlab, Structures, sample_structures
from deatwin.scenarios.svb_benchmark.trials import LEVEL, draw_of, system_of, try_out

Array = NDArray[np.float64]
FLIPS, BURN_IN, DRAWS = 20_000, 2_000, 20_000
"""Of each chain, and the parameters that are drawn at its end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What the two say of a draw."""

    number: int
    terms: tuple[str, ...]  # All candidates
    inclusion: Array
    other_inclusion: Array
    sampled: tuple[str, ...]  # Terms that the first chain holds for more likely in than out
    chosen: tuple[str, ...]  # Terms that variational Bayes keeps
    theta: Array
    low: Array
    high: Array
    sampled_low: Array
    sampled_high: Array
    mass: Array
    mass_given: Array
    seconds: float  # Processor times of variational Bayes and of one chain
    sampled_seconds: float

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The comparison of plain data."""
        names = {key: tuple(data[key]) for key in ("terms", "sampled", "chosen")}
        numbers = {k: np.array(v, dtype=float) for k, v in data.items() if isinstance(v, list) and k not in names}
        return cls(**{**data, **numbers, **names})

    @property
    def common(self) -> tuple[str, ...]:
        """The terms that both keep."""
        return tuple(term for term in self.chosen if term in self.sampled)

    @property
    def agrees(self) -> bool:
        """Whether both keep the same terms."""
        return set(self.sampled) == set(self.chosen)

    @property
    def unsettled(self) -> float:
        """Largest difference of a term's probability between the two chains."""
        return float(np.abs(self.inclusion - self.other_inclusion).max())


def compare(name: str, method: str, seed: int, number: int) -> Comparison:
    """Sample the structures of a draw, and let a method choose one."""
    system = system_of(name)
    record = draw_of(system, seed, number).recording
    trial = try_out(name, method, seed, number)
    rng = np.random.default_rng([seed, number])
    begin = time.process_time()
    data = Regression.of(record, output_lags=system.output_lags, input_lags=system.input_lags, degree=system.degree)
    gram, moment, power = data.gram()
    posterior = SpikeSlab(data=Statistics(gram=gram, moment=moment, power=power, n_samples=data.n_samples))
    found = sample_structures(posterior, rng, flips=FLIPS, burn_in=BURN_IN)
    seconds = time.process_time() - begin
    crowd = frozenset(rng.choice(posterior.n_terms, 20, replace=False).tolist())
    other = sample_structures(posterior, rng, flips=FLIPS, burn_in=BURN_IN, start=crowd)
    terms = tuple(map(str, data.table.terms))
    sampled = tuple(terms[i] for i in sorted(found.median))
    common = [term for term in trial.terms if term in sampled]
    kept, places = [trial.terms.index(term) for term in common], [terms.index(term) for term in common]
    low, high = np.array(trial.low)[kept], np.array(trial.high)[kept]
    scales = data.term_scales[places]
    averaged = _present(found.parameters(posterior, DRAWS, rng)[:, places] * scales)
    alone = Structures(inclusion=found.inclusion, weights={frozenset(terms.index(t) for t in trial.terms): 1.0})
    given = _present(alone.parameters(posterior, DRAWS, rng)[:, places] * scales)
    return Comparison(
        number=number,
        terms=terms,
        inclusion=found.inclusion,
        other_inclusion=other.inclusion,
        sampled=sampled,
        chosen=trial.terms,
        theta=np.array(trial.theta)[kept],
        low=low,
        high=high,
        sampled_low=np.nanquantile(averaged, 0.5 * (1 - LEVEL), axis=0),
        sampled_high=np.nanquantile(averaged, 0.5 * (1 + LEVEL), axis=0),
        mass=_mass(averaged, low, high),
        mass_given=_mass(given, low, high),
        seconds=trial.seconds,
        sampled_seconds=seconds,
    )


def _present(theta: Array) -> Array:
    """Return drawn parameters with NaN where the term is out."""
    return np.where(theta != 0, theta, np.nan)


def _mass(theta: Array, low: Array, high: Array) -> Array:
    """Return the share of the draws, with the term in, that lies in each interval."""
    inside = np.sum((low <= theta) & (theta <= high), axis=0)
    return np.asarray(inside / np.sum(~np.isnan(theta), axis=0), dtype=np.float64)
