"""Choose the number of terms: information criteria, free-run error on held-out samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import log
from types import MappingProxyType

import numpy as np

from deatwin.ident.narx.evidence import log_prior
from deatwin.ident.narx.forward import SelectionStep
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.response import DIVERGED
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

CRITERIA: Mapping[str, Callable[[float, int, int, int], float]] = MappingProxyType(
    {
        # s mean squared residual, n samples, k terms, p candidates
        "ebic": lambda s, n, k, p: n * log(s) + k * log(n) - 2 * log_prior(k, p),
        "bic": lambda s, n, k, p: n * log(s) + k * log(n),
        "aic": lambda s, n, k, p: n * log(s) + 2 * k,
    }
)
"""Criteria of a selection path, all on the scale of n ln(mean square); the smallest value is best."""


def criterion_values(name: str, steps: Sequence[SelectionStep], target: Array, candidates: int) -> Array:
    """Return the value of a criterion after each selection step. Shapes: `target` (n_samples,); returns (n_steps,)."""
    n = target.size
    # A residual at rounding level carries no information and must not justify further terms.
    floor = float(np.finfo(float).eps ** 2 * (target @ target)) / n
    return np.array(
        [CRITERIA[name](max(step.residual / n, floor), n, k, candidates) for k, step in enumerate(steps, start=1)]
    )


def split(
    recordings: Sequence[Recording], share: float, first: int
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Split recordings into a first part for training and a last for testing, each longer than `first` lags."""
    training, held_out = [], []
    for number, record in enumerate(recordings, start=1):
        cut = record.n_samples - round(share * record.n_samples)
        if min(cut, record.n_samples - cut) <= first:
            raise ModelError(
                f"recording {number} has {record.n_samples} samples: with held_out = {share:g} one of its parts is "
                f"too short for lags up to {first}"
            )
        training.append(record.section(0, cut))
        held_out.append(record.section(cut, record.n_samples))
    return tuple(training), tuple(held_out)


def free_run_errors(data: Regression, recordings: Sequence[Recording], theta: Array) -> Array:
    """Return mean squared free-run errors (n_models,) of one equation; other outputs are taken as measured."""
    chosen = np.tile(np.arange(theta.shape[1]), (len(theta), 1))
    errors = march_over(data, recordings).squared_errors(chosen, theta, limit=DIVERGED)
    return errors.sum(axis=1) / sum(record.n_samples - data.first for record in recordings)


def march_over(data: Regression, recordings: Sequence[Recording]) -> March:
    """Return the march of one equation over recordings, with other outputs as measured."""
    inputs, outputs = (
        np.concatenate(each, axis=1) for each in zip(*(data.scaled(record) for record in recordings), strict=True)
    )
    return March.of(
        data.scaled_table.terms,
        {"u": inputs, "y": outputs},
        "y",
        outputs[[data.output]],
        first=data.first,
        alone=data.output,
        ends=np.cumsum([record.n_samples for record in recordings]),
    )
