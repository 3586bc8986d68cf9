"""Models that differ from a chosen one by a single term, all refitted together by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from deatwin.ident.narx.regression import Regression
from deatwin.plant.arrays import Array, Integers

_DEPENDENT = 1e-12  # share of its squared norm beyond the chosen terms below which a candidate depends on them
_BY_MODEL = ("candidate", "chosen", "theta", "squares", "f_ratio")  # arrays of `Neighbours` with a row for each model


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """Models that differ from a chosen one by a single term."""

    candidate: Integers
    chosen: Integers  # shape (n_models, n_terms): Terms of each model
    theta: Array  # shape (n_models, n_terms): Least-squares parameters
    squares: Array  # shape (n_models,): Sums of squared one-step errors, square of the scaled output
    f_ratio: Array
    freedom: int  # Number of samples minus terms of the larger model

    def only(self, kept: NDArray[np.bool_]) -> Neighbours:
        """Return the models selected by a mask `kept` (n_models,)."""
        return Neighbours(**{name: getattr(self, name)[kept] for name in _BY_MODEL}, freedom=self.freedom)


@dataclass(frozen=True, kw_only=True, eq=False)
class CompressedRegression:
    """Regression rotated to few rows by an orthogonal matrix, with the same least-squares solutions for any terms."""

    rows: Array  # shape (n_terms, n_rows): Regressors, at most n_terms + 1 numbers each
    target: Array  # shape (n_rows,): Output
    n_samples: int  # Number of samples before the compression

    @classmethod
    def of(cls, data: Regression) -> CompressedRegression:
        """Compress by QR, block by block, which loses no digits to a Gram matrix."""
        triangle: Array = np.empty((0, len(data.table.terms) + 1))
        for rows, target in data.blocks():
            triangle = _triangle(np.vstack([triangle, np.column_stack([rows.T, target])]))
        columns = np.ascontiguousarray(triangle.T)
        return cls(rows=columns[:-1], target=columns[-1], n_samples=data.n_samples)

    def fit(self, chosen: Sequence[int]) -> tuple[Array, float]:
        """Return the parameters of a model, shape (n_terms,), and its sum of squared one-step errors."""
        basis, triangle = np.linalg.qr(self.rows[list(chosen)].T)
        moments = basis.T @ self.target
        left = self.target - basis @ moments
        return solve_triangular(triangle, moments), max(float(left @ left), self._rounding)

    def larger(self, chosen: Sequence[int]) -> Neighbours:
        """Return the models with one more independent candidate p = Q c + w, w orthogonal to the terms Q R: its
        parameter is w'y/w'w, and the others solve R theta = Q'y - c w'y/w'w."""
        basis, triangle = np.linalg.qr(self.rows[list(chosen)].T)
        along = self.rows @ basis
        across = self.rows - along @ basis.T
        across -= (across @ basis) @ basis.T
        norms = np.einsum("ij,ij->i", across, across)
        free = norms > _DEPENDENT * np.einsum("ij,ij->i", self.rows, self.rows)
        free[list(chosen)] = False
        candidate = np.flatnonzero(free)
        added = (across[free] @ self.target) / norms[free]
        moments = basis.T @ self.target
        others = solve_triangular(triangle, moments[:, None] - along[free].T * added) if len(chosen) else along[free].T
        left = self.target - basis @ moments
        freedom = self.n_samples - len(chosen) - 1
        falls = added**2 * norms[free]
        squares = np.maximum(left @ left - falls, self._rounding)
        return Neighbours(
            candidate=candidate,
            chosen=np.column_stack([np.tile(np.asarray(chosen, dtype=np.int64), (candidate.size, 1)), candidate]),
            theta=np.column_stack([others.T, added]),
            squares=squares,
            f_ratio=falls * freedom / squares,
            freedom=freedom,
        )

    def smaller(self, chosen: Sequence[int]) -> Neighbours:
        """Return the models without one chosen term: with G = (R'R)^-1, removing i gives theta - G_i theta_i / G_ii."""
        basis, triangle = np.linalg.qr(self.rows[list(chosen)].T)
        moments = basis.T @ self.target
        theta = solve_triangular(triangle, moments)
        root = solve_triangular(triangle, np.eye(len(chosen)))
        inverse = root @ root.T
        left = self.target - basis @ moments
        squares = max(float(left @ left), self._rounding)
        freedom = self.n_samples - len(chosen)
        rises = theta**2 / np.diag(inverse)
        without = ~np.eye(len(chosen), dtype=bool)
        shape = (len(chosen), len(chosen) - 1)
        return Neighbours(
            candidate=np.array(chosen, dtype=np.int64),
            chosen=np.tile(np.asarray(chosen, dtype=np.int64), (len(chosen), 1))[without].reshape(shape),
            theta=(theta - inverse / np.diag(inverse)[:, None] * theta[:, None])[without].reshape(shape),
            squares=squares + rises,
            f_ratio=rises * freedom / squares,
            freedom=freedom,
        )

    def exchanged(self, chosen: Sequence[int]) -> Neighbours:
        """Return the models with one chosen term exchanged for a candidate, named by the candidate."""
        rests = [[other for other in chosen if other != term] for term in chosen]
        found = [self.larger(rest) for rest in rests]
        parts = [models.only(models.candidate != term) for models, term in zip(found, chosen, strict=True)]
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_MODEL}
        return Neighbours(**joined, freedom=parts[0].freedom)

    @property
    def _rounding(self) -> float:
        """Sum of squared errors that rounding alone may cause."""
        return float((np.finfo(float).eps * len(self.rows)) ** 2 * (self.target @ self.target)) or 1.0


def _triangle(matrix: Array) -> Array:
    """Return R of the QR decomposition."""
    (triangle,) = qr(matrix, mode="r", overwrite_a=True, check_finite=False)
    return np.asarray(triangle[: matrix.shape[1]], dtype=np.float64)
