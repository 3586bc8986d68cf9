"""Summarise the responses of a fleet: spread, measured and true differences, spread predicted from tolerances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from deatwin.ident.frequency.comparison.bands import BandMean
from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.ident.frequency.comparison.equality import equality
from deatwin.plant.arrays import Array

Means = tuple[BandMean, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Contrast:
    """Measured and true difference of two actuators in one order and band, relative to the gain."""

    measured: float  # Measured difference, along the direction of the true one
    true: float  # Magnitude of the true difference
    error: float  # Standard error of the measured difference
    inside: bool  # True if the complex true difference lies in the 95 % region of the measured one


def contrast(measured: tuple[BandMean, BandMean], true: tuple[BandMean, BandMean]) -> Contrast:
    """Compare a measured difference with the true one."""
    gain = float(np.hypot(true[0].gain, true[1].gain) / np.sqrt(2))
    away, apart = (pair[0].value - pair[1].value for pair in (measured, true))
    along = apart / max(float(np.linalg.norm(apart)), np.finfo(float).tiny)
    scale = sum(mean.scatter.scale for mean in measured)
    test = equality(away - apart, [mean.scatter for mean in measured])
    return Contrast(
        measured=float(along @ away) / gain,
        true=float(np.linalg.norm(apart)) / gain,
        error=float(np.sqrt(along @ scale @ along)) / gain,
        inside=test.p_value > 0.05,
    )


def spread_of_means(group: Iterable[Means]) -> Array:
    """Return the relative standard deviation (n_columns,) of a group, without the estimates' own scatter."""
    found = []
    for column in zip(*group, strict=True):
        values = np.array([mean.value for mean in column])
        scatter = np.mean([np.trace(m.scatter.scale) * (1.0 + 2.0 / (m.scatter.dof - 2.0)) for m in column])
        variance = values.var(axis=0, ddof=1).sum() - scatter
        gain = np.sqrt(np.mean([mean.gain**2 for mean in column]))
        found.append(np.sqrt(max(0.0, variance)) / gain)
    return np.array(found)


def shares_of(wished: Means, off: Mapping[str, Means]) -> dict[str, Array]:
    """Return the spread (n_columns,) due to each tolerance alone; `off` has the responses at the tolerances' ends."""
    return {
        name: np.array(
            [np.linalg.norm(a.value - b.value) / (np.sqrt(3) * b.gain) for a, b in zip(made, wished, strict=True)]
        )
        for name, made in off.items()
    }


def share_of(table: Comparison, agreement: Agreement) -> Array:
    """Return the share of a table's pairs with a given agreement. Shapes: returns (n_columns,)."""
    flags = np.array([d.agreement is agreement for d in table.differences])
    return np.asarray(flags.reshape(len(table.pairs), len(table.columns)).mean(axis=0))
