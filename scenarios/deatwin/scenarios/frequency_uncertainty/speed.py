"""What propagation costs, beside draws that say as much."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import process_time

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.uncertainty.beside_draws import DRAWS, departure, symbol_of
from deatwin.ident.frequency.uncertainty.propagate import UncertaintyWarning, propagate
from deatwin.ident.frequency.uncertainty.sampling import sample
from deatwin.scenarios.frequency_uncertainty.systems import Case

Array = NDArray[np.float64]

CHUNKS = 40
"""Of `spread.DRAWS` draws each, against which the error of the law is measured."""
CALLS = 7
"""Of propagation, of which the shortest counts."""
LOOP = 100
"""Draws that are computed one by one."""


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Propagation and draws of one response."""

    label: str
    propagated: float  # Processor time of propagation, of 20,000 draws all at once, and of as many one by one, s
    drawn: float
    alone: float
    error: float
    drawn_error: float
    equal: float

    @property
    def ratio(self) -> float:
        """Time of draws of equal accuracy, computed all at once, over that of propagation."""
        return self.drawn * self.equal / DRAWS / self.propagated


def speed(case: Case, order: int, seed: tuple[int, ...]) -> Speed:
    """Measure what propagation costs and how accurate it is."""
    rng = np.random.default_rng(seed)
    model, quantity = case.identify(rng), case.response(order)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)
        propagated = propagate(model, quantity).covariance
        own = min(_timed(lambda: propagate(model, quantity).covariance) for _ in range(CALLS))
    begun = process_time()
    drawn = np.array([sample(model, quantity, rng, DRAWS).covariance for _ in range(CHUNKS)])
    together = (process_time() - begun) / CHUNKS
    pooled: Array = drawn.mean(axis=0)
    error = departure(pooled, propagated)
    drawn_error = float(np.mean([departure(pooled, one) for one in drawn]))
    floor = drawn_error / np.sqrt(CHUNKS)  # as far all draws together depart by themselves
    equal = DRAWS * (drawn_error / np.sqrt(max(error**2 - floor**2, floor**2))) ** 2
    thetas = rng.multivariate_normal(model.theta, model.theta_cov, LOOP)
    alone = _timed(lambda: [quantity(replace(model, theta=theta)) for theta in thetas]) / LOOP
    return Speed(
        label=f"{symbol_of(quantity(model))} of {case.name.split(',')[0]}",
        propagated=own,
        drawn=together,
        alone=alone * DRAWS,
        error=error,
        drawn_error=drawn_error,
        equal=float(equal),
    )


def _timed(work: Callable[[], object]) -> float:
    begun = process_time()
    work()
    return process_time() - begun
