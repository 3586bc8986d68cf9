"""Ridge, LASSO and the choice of a subset on orthogonal regressors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.lasso import lasso_path
from deatwin.ident.narx.shrinkage import Ridge

Array = NDArray[np.float64]

RULES = ("ridge", "LASSO", "subset")
N, M, NOISE = 64, 9, 1.0
PENALTY, THRESHOLD = 0.5, 0.7
"""Penalty of ridge and LASSO, and the magnitude below which a term does not pay in the subset."""
LEVEL = 1.5
"""Threshold of the risks, in standard errors of a parameter."""
DRAWS = 20_000


def rule(name: str, least: Array, level: float) -> Array:
    """Apply a rule to a least-squares parameter, in closed form."""
    if name == "ridge":
        return least / (1 + level)
    if name == "LASSO":
        return np.sign(least) * np.maximum(np.abs(least) - level, 0.0)
    return np.where(np.abs(least) > level, least, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Orthogonal:
    """Estimates on an orthogonal design."""

    least: Array  # shape (m,): Least-squares parameters
    found: Mapping[str, Array]  # shape (m,): What each of `RULES` estimates
    expected: Mapping[str, Array]  # shape (m,): The closed forms

    @property
    def worst(self) -> float:
        """Largest difference of all."""
        return max(float(np.abs(self.found[name] - self.expected[name]).max()) for name in RULES)


def orthogonal(rng: np.random.Generator) -> Orthogonal:
    """Estimate by ridge, by the LASSO and by trying all subsets."""
    basis, _ = np.linalg.qr(rng.standard_normal((N, M)))
    rows = np.sqrt(N) * basis.T
    target = np.linspace(-2.0, 2.0, M) @ rows + NOISE * rng.standard_normal(N)
    least = rows @ target / N
    size = float(np.sqrt(np.mean(target**2)))
    taken, penalties, knots = lasso_path(rows, target, centred=False, max_knots=100)
    lasso = np.zeros(M)
    lasso[taken] = [np.interp(PENALTY, size * penalties[::-1], size * knot[::-1]) for knot in knots]
    found = {"ridge": Ridge(PENALTY)(rows, target).theta, "LASSO": lasso, "subset": _best_subset(rows, target)}
    levels = {"ridge": PENALTY, "LASSO": PENALTY, "subset": THRESHOLD}
    return Orthogonal(least=least, found=found, expected={n: rule(n, least, levels[n]) for n in RULES})


def _best_subset(rows: Array, target: Array) -> Array:
    """The subset of least mean squared error plus ``THRESHOLD**2`` a term, among all."""
    best, least = np.inf, np.zeros(len(rows))
    for chosen in chain.from_iterable(combinations(range(len(rows)), size) for size in range(len(rows) + 1)):
        theta = np.zeros(len(rows))
        theta[list(chosen)] = np.linalg.lstsq(rows[list(chosen)].T, target, rcond=None)[0]
        cost = float(np.mean((target - theta @ rows) ** 2)) + THRESHOLD**2 * len(chosen)
        if cost < best:
            best, least = cost, theta
    return least


@dataclass(frozen=True, kw_only=True, eq=False)
class Risks:
    """Expected squared errors of one parameter by its true size, both in standard errors of least squares."""

    sizes: Array  # shape (n,): True parameter
    expected: Mapping[str, Array]  # shape (n,): Closed form, Monte Carlo, and its standard error
    drawn: Mapping[str, Array]
    errors: Mapping[str, Array]
    zeros: Array  # shape (n,): Share of draws that the LASSO sets to zero, its standard error, and the closed form
    zero_errors: Array
    zeros_expected: Array

    @property
    def worst(self) -> float:
        """Largest departure of the Monte Carlo risks, in their standard errors."""
        return max(float((np.abs(self.drawn[n] - self.expected[n]) / self.errors[n]).max()) for n in RULES)

    @property
    def worst_zeros(self) -> float:
        """Largest departure of the shares of zeros, in their standard errors."""
        return float((np.abs(self.zeros - self.zeros_expected) / self.zero_errors).max())


def risks(rng: np.random.Generator) -> Risks:
    """Compute the risks in closed form and by Monte Carlo."""
    sizes = np.linspace(0.0, 6.0, 25)
    least = sizes[:, None] + rng.standard_normal((sizes.size, DRAWS))
    squares = {name: (rule(name, least, LEVEL) - sizes[:, None]) ** 2 for name in RULES}
    zeros, expected = np.mean(rule("LASSO", least, LEVEL) == 0, axis=1), zero_share(sizes, LEVEL)
    return Risks(
        sizes=sizes,
        expected={name: _risk(name, sizes, LEVEL) for name in RULES},
        drawn={name: square.mean(axis=1) for name, square in squares.items()},
        errors={name: square.std(axis=1) / np.sqrt(DRAWS) for name, square in squares.items()},
        zeros=zeros,
        zero_errors=np.sqrt(np.maximum(expected * (1 - expected), 1 / DRAWS) / DRAWS),
        zeros_expected=expected,
    )


def zero_share(size: Array, level: float) -> Array:
    """Probability that a threshold sets an estimate N(size, 1) to zero."""
    from scipy.stats import norm

    return np.asarray(norm.cdf(level - size) - norm.cdf(-level - size))


def _risk(name: str, size: Array, level: float) -> Array:
    """E (rule(z) - size)^2 for z ~ N(size, 1); Donoho and Johnstone, Biometrika 81 (1994) 425-455, appendix."""
    from scipy.stats import norm

    if name == "ridge":
        return np.asarray((1 + level**2 * size**2) / (1 + level) ** 2)
    zero = zero_share(size, level)
    up, down = norm.pdf(level - size), norm.pdf(level + size)
    if name == "LASSO":
        kept = 1 + level**2 + (size**2 - level**2 - 1) * zero
        return np.asarray(kept - (level - size) * down - (level + size) * up)
    return np.asarray(size**2 * zero + 1 - zero + (level - size) * up + (level + size) * down)
