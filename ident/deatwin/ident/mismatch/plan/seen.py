r"""Detectability of effects in readings that were not recorded.

Let c be the change of the readings by an effect of unit strength. Let G be the derivatives by the nuisance parameters,
which are the plant's parameters and its repeatable error, in units of their prior deviations. Both are whitened by the
fast model error and the noise. After a fit of the nuisance parameters, the product of two changes is

.. math:: \langle a, b \rangle = a^T b - a^T G (G^T G + I)^{-1} G^T b

and contains all information in the readings. A strength s has the expected evidence
:math:`\tfrac12 s^2 \langle c, c \rangle - \tfrac12 \log(1 + s_0^2 \langle c, c \rangle)` over no effect, where
:math:`s_0` is the prior deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from deatwin.ident.mismatch.likelihood.beforehand import PRIORS
from deatwin.ident.mismatch.likelihood.several import OwnErrors, taken_up
from deatwin.ident.mismatch.thresholds import CREDIBLE


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """Change of the readings by an effect of one shape at unit strength, SI; its prior and typical strength."""

    effect: str
    readings: np.ndarray  # shape (n,)
    typical: float
    deviation: float
    one_sided: bool


def products(error: OwnErrors, derivatives: np.ndarray, changes: Sequence[Change]) -> np.ndarray:
    """Return the products of changes, (k, k); `derivatives` (n, p) are in prior deviations, SI."""
    rows = np.vstack([derivatives.T, *(change.readings for change in changes)])
    return taken_up(error.products(rows), derivatives.shape[1])


def smallest(square: float, deviation: float, catalogue: int) -> float:
    """Return the smallest strength that is expected to be named; infinite if the effect is invisible.

    `square` is the product of its change with itself, `catalogue` the number of effects that share the prior.
    """
    if square <= 0.0:
        return float(np.inf)
    odds = np.log(CREDIBLE / (1.0 - CREDIBLE)) + np.log(PRIORS[0] / (PRIORS[1] / catalogue))
    return float(np.sqrt((2.0 * odds + np.log1p(deviation**2 * square)) / square))


def distances(changes: Sequence[Change], among: np.ndarray, numbers: Sequence[int]) -> np.ndarray:
    """Return d² from some changes at their typical strengths to each effect, (numbers, effects)."""
    # Each effect is represented by the nearest sum, with weights of one sign, of its changes for all shapes.
    squares, axes = np.linalg.eigh(among)
    seen = (axes * np.sqrt(np.maximum(squares, 0.0))).T  # columns with the same products
    names = list(dict.fromkeys(change.effect for change in changes))
    typical = np.array([change.typical for change in changes])
    found = np.empty((len(numbers), len(names)))
    for j, name in enumerate(names):
        own = [k for k, change in enumerate(changes) if change.effect == name]
        ways = (1.0,) if changes[own[0]].one_sided else (1.0, -1.0)
        for i, k in enumerate(numbers):
            found[i, j] = min(nnls(way * seen[:, own], typical[k] * seen[:, k])[1] for way in ways)
    return found**2
