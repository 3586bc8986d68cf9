"""Free-run bands of models of simulated data sets, and the readings of new recordings that they contain."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.stats import binom

from deatwin.ident.narx import PredictiveBand


def require_hold(bands: Iterable[PredictiveBand]) -> None:
    """Assert that 95 % bands, each of a model of its own data set, hold new readings.

    Readings of one set share an error of the parameters: each set gives one independent reading, the last.
    """
    covered, inside = [], []
    for band in bands:
        covered.append(float(band.coverage[0]))
        inside.append(bool(band.lower[0, -1] <= band.measured[0, -1] <= band.upper[0, -1]))
    print(f"{100 * np.mean(covered):.1f} % of readings; last reading {sum(inside)} of {len(inside)}")
    require_share(sum(inside), len(inside))
    assert 0.92 - 0.06 / np.sqrt(len(covered)) < np.mean(covered) < 0.98 + 0.06 / np.sqrt(len(covered))


def require_share(held: int, sets: int) -> None:
    """Assert that 95 % intervals hold the truth in a number of independent sets that the binomial law allows."""
    assert min(binom.cdf(held, sets, 0.95), binom.sf(held - 1, sets, 0.95)) > 1e-3
