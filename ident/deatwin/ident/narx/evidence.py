"""Compute the exact evidence of regression structures, and find one that no small change makes more probable.

The prior is p(tau) ~ 1/tau, theta | tau ~ N(theta^, n/tau (Phi'Phi)^-1), with the least-squares estimate theta^ of the
terms Phi and n samples: a unit-information prior (Kass, Wasserman, J. Am. Stat. Assoc. 90 (1995) 928-934,
doi:10.1080/01621459.1995.10476592), which depends on no choice, nor on units. The evidence is Schwarz's criterion with
ln(1 + n) for ln n. A width learned from all effects would ask more of a small term beside large ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.special import gammaln

from deatwin.ident.narx.bayes import Statistics
from deatwin.plant.arrays import Array, Indices

# Share of a candidate's squares below which the part orthogonal to the chosen terms is zero: the candidate is a
# combination of them.
_DEPENDENT = 1e-10
# Least share of the squares that counts as residual: a residual at rounding level carries no information and must not
# justify further terms.
_LEAST_SHARE = 1e-14


def log_evidence(share: Array | float, n_terms: int, n_samples: int) -> Array:
    """Return ln p(y | structure) - ln p(y | no term), nats, unit-information prior; `share` is left of the squares."""
    return np.asarray(-0.5 * n_terms * log(1 + n_samples) - 0.5 * n_samples * np.log(np.maximum(share, _LEAST_SHARE)))


def log_prior(n_terms: int, n_candidates: int) -> float:
    """Return ln p(structure), nats, by equally probable sizes (Scott, Berger, Ann. Statist. 38 (2010) 2587)."""
    m = n_candidates
    k = min(n_terms, m // 2)
    return float(gammaln(k + 1) + gammaln(m - k + 1) - gammaln(m + 1)) - log(m + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Move:
    """A structure on the way to the most probable one."""

    chosen: Indices  # shape (n_terms,): Increasing positions among the candidates
    log_odds: float  # ln p(structure | y) minus that of the structure without any term, nats


def log_odds(data: Statistics, chosen: Indices) -> float:
    """Return ln p(structure | y) - ln p(no term | y). Shapes: `chosen` (n_terms,)."""
    try:
        return float(_posterior(data, _Fit.of(data, chosen).left, chosen.size))
    except LinAlgError:
        return -np.inf


def climb(data: Statistics, start: Indices) -> Iterator[Move]:
    """Move to the most probable neighbour, by one term, until none is more probable; yield the moves."""
    move = Move(chosen=np.sort(start), log_odds=log_odds(data, start))
    yield move
    while move.log_odds > -np.inf:
        best = _best_neighbour(data, move.chosen)
        # A gain at rounding level does not count: it could send the search in circles.
        if best.log_odds <= move.log_odds + 1e-9 * abs(move.log_odds):
            return
        move = best
        yield move


def _best_neighbour(data: Statistics, chosen: Indices) -> Move:
    """Return the most probable structure that differs by one term, or by one exchange."""
    fit = _Fit.of(data, chosen)
    more = _posterior(data, fit.left - fit.gains(), chosen.size + 1)
    fewer = _posterior(data, fit.left_without, chosen.size - 1)
    exchanged = _posterior(data, fit.left_without[:, None] - fit.gains_without(), chosen.size)
    best = max(more.max(), fewer.max(), exchanged.max())
    if best == more.max():
        removed, added = None, int(np.argmax(more))
    elif best == fewer.max():
        removed, added = int(chosen[np.argmax(fewer)]), None
    else:
        place, added = (int(i) for i in np.unravel_index(np.argmax(exchanged), exchanged.shape))
        removed = int(chosen[place])
    rest = chosen[chosen != removed]
    structure = rest if added is None else np.sort(np.append(rest, added))
    return Move(chosen=structure, log_odds=float(best))


def _posterior(data: Statistics, left: Array | float, n_terms: int) -> Array:
    """Return ln p(structure | y) - ln p(no term | y) from sums of squares of structures of n_terms terms."""
    candidates = data.moment.size
    if not 0 < n_terms < min(data.n_samples, candidates + 1):
        return np.full(np.shape(left), -np.inf)
    prior = log_prior(n_terms, candidates) - log_prior(0, candidates)
    odds = log_evidence(np.asarray(left) / data.power, n_terms, data.n_samples) + prior
    return np.where(np.isfinite(left), odds, -np.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """Least-squares fit of some terms, with the part of every candidate that is orthogonal to them."""

    theta: Array  # shape (n_terms,): Parameters
    inverse: Array  # shape (n_terms,): Diagonal of (Phi'Phi)^-1
    left: float  # Residual sum of squares
    shares: Array  # shape (n_terms, n_candidates): Coefficients of each candidate's projection onto the terms
    beyond: Array  # shape (n_candidates,): Sum of squares of each candidate's part orthogonal to the terms
    moment: Array  # shape (n_candidates,): Product of that part with y
    squares: Array  # shape (n_candidates,): Sum of squares of each candidate

    @classmethod
    def of(cls, data: Statistics, chosen: Indices) -> _Fit:
        """Fit some terms; LinAlgError if they are linearly dependent."""
        cross, squares = data.gram[chosen], np.diag(data.gram)
        lower = cholesky(cross[:, chosen], lower=True)
        if np.any(np.diag(lower) ** 2 <= _DEPENDENT * squares[chosen]):
            raise LinAlgError("the terms are linearly dependent")
        own = solve_triangular(lower, data.moment[chosen], lower=True)
        parts = solve_triangular(lower, cross, lower=True)
        root = solve_triangular(lower, np.eye(chosen.size), lower=True)
        return cls(
            theta=root.T @ own,
            inverse=np.einsum("ij,ij->j", root, root),
            left=data.power - float(own @ own),
            shares=root.T @ parts,
            beyond=squares - np.einsum("ij,ij->j", parts, parts),
            moment=data.moment - own @ parts,
            squares=squares,
        )

    @property
    def left_without(self) -> Array:
        """Return the residual sum of squares without each term, shape (n_terms,)."""
        return np.asarray(self.left + self.theta**2 / self.inverse)

    def gains(self) -> Array:
        """Return by how much each candidate reduces the residual sum of squares, shape (n_candidates,)."""
        return self._gains(self.moment, self.beyond)

    def gains_without(self) -> Array:
        """Return the gain of each candidate once a term is removed, (n_terms, n_candidates)."""
        back = self.shares / self.inverse[:, None]
        return self._gains(self.moment + back * self.theta[:, None], self.beyond + back * self.shares)

    def _gains(self, moment: Array, beyond: Array) -> Array:
        """Return gains; minus infinity for a candidate that depends linearly on the terms."""
        new = beyond > _DEPENDENT * self.squares
        return np.divide(moment**2, beyond, out=np.full(beyond.shape, -np.inf), where=new)
