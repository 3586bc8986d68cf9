"""Forward regression by orthogonal least squares with error reduction ratios (FROLS)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, log
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from deatwin.ident.narx.identifier import NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Lags, Rule
from deatwin.plant.errors import ModelError, nearest

Array = NDArray[np.float64]

# A candidate whose squared norm has been reduced by this factor is taken as dependent on the chosen ones.
_DEPENDENT = 1e-12
# Squared norms and products are updated, not recomputed, until a candidate has lost this share of its squared
# norm; then the candidate itself is orthogonalised afresh, so that cancellation never costs more than two
# digits.
_REFRESH = 1e-2

CRITERIA: Mapping[str, Callable[[float, int, int], float]] = MappingProxyType(
    {
        # n samples, k terms, mean squared residual s
        "bic": lambda s, n, k: n * log(s) + k * log(n),
        "aic": lambda s, n, k: n * log(s) + 2 * k,
        "aicc": lambda s, n, k: n * log(s) + 2 * k + (2 * k * (k + 1) / (n - k - 1) if n > k + 1 else inf),
    }
)


class Frols(NarxIdentifier):
    """Choose terms one by one, each the one that explains most of what is left of the output.

    The error reduction ratio of a candidate p, orthogonalised against the chosen terms to w, is
    ``(w'y)^2 / (w'w y'y)``. Terms are added up to ``max_terms``; the number that an information criterion
    likes best is kept, and its parameters are estimated by least squares (QR).

    Parameters
    ----------
    output_lags, input_lags : int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples.
    degree : int
        Largest degree of a candidate.
    rule : callable, optional
        Takes a `Term` and says whether it is a candidate; see `deatwin.ident.narx.rules`.
    max_terms : int
        Largest number of terms.
    criterion : str
        "bic", "aic" or "aicc" choose the number of terms; "none" keeps ``max_terms``. None of them counts how
        many candidates competed, so that among hundreds of them false terms are kept too.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units; ``theta_cov`` is ``sigma^2 (P'P)^-1``.
    terms_ : tuple of Term
        Its terms in the order in which they were chosen.
    err_ : ndarray, shape (n_terms,)
        Error reduction ratio of each; dimensionless, their sum is the explained share of y'y.
    path_ : tuple of Term
        All terms that were tried, in order.
    criterion_ : ndarray, shape (n_path,)
        Criterion after each term of the path; empty for "none".

    References
    ----------
    Chen, Billings, Luo, "Orthogonal least squares methods and their application to non-linear system
    identification", Int. J. Control 50 (1989) 1873-1896, doi:10.1080/00207178908953472.
    """

    def __init__(
        self,
        *,
        output_lags: Lags = 2,
        input_lags: Lags = 2,
        degree: int = 2,
        rule: Rule | None = None,
        max_terms: int = 15,
        criterion: str = "bic",
    ) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule
        self.max_terms = max_terms
        self.criterion = criterion

    def _check(self) -> None:
        if self.criterion not in (*CRITERIA, "none"):
            raise ModelError(
                f"criterion = {self.criterion!r}{nearest(self.criterion, [*CRITERIA, 'none'])}; "
                f"known are {', '.join(CRITERIA)} and none"
            )
        if self.max_terms < 1:
            raise ModelError(f"max_terms = {self.max_terms}; it must be at least 1")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        if data.n_samples <= self.max_terms:
            raise ModelError(
                f"{data.n_samples} usable samples are too few for up to {self.max_terms} terms; "
                f"at least {self.max_terms + 1} are needed"
            )
        rows, target = data.matrix()
        path = forward_selection(rows, target, self.max_terms)
        count = self._count(path, target)
        chosen = path.chosen[:count]
        kept = data.only(chosen)
        theta, theta_cov, noise_variance = least_squares(*kept.matrix())
        model = kept.model(theta, theta_cov, noise_variance, identifier=self)
        self.terms_ = model.terms
        self.err_ = np.array(path.err[:count])
        self.path_ = tuple(data.table.terms[i] for i in path.chosen)
        return model

    def _count(self, path: SelectionPath, target: Array) -> int:
        """Return the number of terms that the criterion likes best, and note the criterion."""
        n = target.size
        if self.criterion == "none":
            self.criterion_ = np.empty(0)
            return len(path.chosen)
        # A residual at rounding level carries no information: let it not buy further terms.
        floor = float(np.finfo(float).eps) ** 2 * float(target @ target) / n
        measure = CRITERIA[self.criterion]
        self.criterion_ = np.array(
            [measure(max(square / n, floor), n, k) for k, square in enumerate(path.residual, start=1)]
        )
        return int(np.argmin(self.criterion_)) + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class SelectionPath:
    """The result of a forward selection.

    Parameters
    ----------
    chosen : tuple of int
        Candidates in the order of choice.
    err : tuple of float
        Error reduction ratio of each.
    residual : tuple of float
        Sum of squares of what is left after each.
    """

    chosen: tuple[int, ...]
    err: tuple[float, ...]
    residual: tuple[float, ...]


def forward_selection(rows: Array, target: Array, max_terms: int) -> SelectionPath:
    """Choose rows one by one by the error reduction ratio.

    Each step costs one product of the candidates with the new orthonormal direction. Chosen directions are
    orthogonalised twice; norms and products of the candidates are updated and refreshed before cancellation
    hurts.

    Parameters
    ----------
    rows : ndarray, shape (n_candidates, n_samples)
        Candidate regressors; used as working memory and overwritten.
    target : ndarray, shape (n_samples,)
        Output.
    max_terms : int
        Largest number to choose.

    Returns
    -------
    SelectionPath
    """
    limit = min(max_terms, *rows.shape)
    basis = np.empty((limit, target.size))
    left = target.copy()
    power = float(target @ target)
    norms = np.einsum("ij,ij->i", rows, rows)
    original, reference = norms.copy(), norms.copy()
    products = rows @ target
    chosen: list[int] = []
    err: list[float] = []
    residual: list[float] = []
    for step in range(limit):
        usable = norms > _DEPENDENT * original
        usable[chosen] = False
        if not usable.any() or power == 0.0:
            break
        gain = np.divide(products**2, norms, out=np.full(norms.size, -1.0), where=usable)
        best = int(np.argmax(gain))
        direction = _orthogonal(rows[best], basis[:step])
        basis[step] = direction / np.linalg.norm(direction)
        explained = float(basis[step] @ left)
        left -= explained * basis[step]
        chosen.append(best)
        err.append(explained**2 / power)
        residual.append(float(left @ left))

        along = rows @ basis[step]
        norms -= along**2
        products -= explained * along
        for j in np.flatnonzero(usable & (norms < _REFRESH * reference)):
            rows[j] = _orthogonal(rows[j], basis[: step + 1])
            norms[j] = reference[j] = rows[j] @ rows[j]
            products[j] = rows[j] @ left
    return SelectionPath(chosen=tuple(chosen), err=tuple(err), residual=tuple(residual))


def _orthogonal(vector: Array, basis: Array) -> Array:
    """Return the part of vector that is orthogonal to the orthonormal rows of basis; twice is enough."""
    once = vector - (basis @ vector) @ basis
    return once - (basis @ once) @ basis


def least_squares(rows: Array, target: Array) -> tuple[Array, Array, float]:
    """Estimate parameters by QR.

    Parameters
    ----------
    rows : ndarray, shape (n_terms, n_samples)
        Regressors, linearly independent.
    target : ndarray, shape (n_samples,)
        Output.

    Returns
    -------
    theta : ndarray, shape (n_terms,)
        Parameters.
    theta_cov : ndarray, shape (n_terms, n_terms)
        sigma^2 (P'P)^-1.
    noise_variance : float
        sigma^2, the residual sum of squares over (n_samples - n_terms).
    """
    norms = np.linalg.norm(rows, axis=1)
    q, r = np.linalg.qr((rows / norms[:, None]).T)
    theta = solve_triangular(r, q.T @ target) / norms
    residual = target - theta @ rows
    noise_variance = float(residual @ residual) / (target.size - norms.size)
    root = solve_triangular(r, np.eye(norms.size)) / norms[:, None]
    return theta, noise_variance * (root @ root.T), noise_variance
