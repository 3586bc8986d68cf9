"""Ridge and LASSO as least squares under a constraint, of two parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.ident.narx import Ridge
from deatwin.ident.narx.lasso import lasso_path
from deatwin.plant.arrays import Array

N, TRUE, CORRELATION, NOISE = 80, (1.0, 0.1), 0.6, 0.3
"""Samples, parameters, correlation of the two regressors, and standard deviation of the noise."""
SHARE = 0.6  # Share of the least-squares parameters' norm that the constraint allows
PENALTIES = np.geomspace(1e-3, 1e2, 200)


@dataclass(frozen=True, kw_only=True, eq=False)
class Constrained:
    """A minimum on a constraint, found on the constraint, and the same from the penalty that belongs to it."""

    size: float  # Norm that the constraint allows: Euclidean for ridge, sum of magnitudes for the LASSO
    point: Array  # shape (2,): The minimum on the constraint
    penalised: Array  # shape (2,): What the estimator answers to Lagrange's multiplier there as its penalty


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """The two-parameter example: mean squared error ``(theta - least)' gram (theta - least)`` plus a constant."""

    gram: Array  # shape (2, 2): Z'Z/n
    least: Array  # shape (2,): Least-squares parameters
    ridge: Constrained
    lasso: Constrained
    shares: Array  # shape (n_penalties,): Norm of the ridge parameters over that of the least-squares ones
    ridge_path: Array  # shape (2, n_penalties): Ridge parameters
    lasso_path: Array  # shape (2, n_knots): LASSO parameters at the knots of its path


def plane(rng: np.random.Generator) -> Plane:
    """Draw the two-parameter example and solve it both ways."""
    gram = np.array([[1.0, CORRELATION], [CORRELATION, 1.0]])
    orthogonal, _ = np.linalg.qr(rng.standard_normal((N, 2)))
    rows = np.sqrt(N) * (orthogonal @ np.linalg.cholesky(gram).T).T  # root mean square exactly 1
    target = np.array(TRUE) @ rows + NOISE * rng.standard_normal(N)
    moment = rows @ target / N
    least = np.linalg.solve(gram, moment)

    radius = SHARE * float(np.linalg.norm(least))
    on_circle = _on_circle(gram, least, radius)
    multiplier = float(on_circle @ (moment - gram @ on_circle)) / radius**2
    ridge = Constrained(size=radius, point=on_circle, penalised=Ridge(multiplier)(rows, target).theta)
    extent = SHARE * float(np.abs(least).sum())
    on_diamond = _on_diamond(gram, least, extent)
    push = float(np.abs(moment - gram @ on_diamond).max())
    size = float(np.sqrt(np.mean(target**2)))  # the path's own scale of the output
    _, penalties, coefficients = lasso_path(rows, target, centred=False, max_knots=20)
    knots = size * coefficients
    penalised = np.array([np.interp(push, size * penalties[::-1], knot[::-1]) for knot in knots])
    lasso = Constrained(size=extent, point=on_diamond, penalised=penalised)

    path = np.array([Ridge(float(penalty))(rows, target).theta for penalty in PENALTIES]).T
    return Plane(
        gram=gram,
        least=least,
        ridge=ridge,
        lasso=lasso,
        ridge_path=path,
        lasso_path=knots,
        shares=np.linalg.norm(path, axis=0) / np.linalg.norm(least),
    )


def _on_circle(gram: Array, least: Array, radius: float) -> Array:
    """The least error on a circle, by its angle alone."""
    from scipy.optimize import minimize_scalar

    def at(angle: float) -> Array:
        return radius * np.array([np.cos(angle), np.sin(angle)])

    def error(angle: float) -> float:
        return float((at(angle) - least) @ gram @ (at(angle) - least))

    angles = np.linspace(-np.pi, np.pi, 721)
    best = float(angles[np.argmin([error(angle) for angle in angles])])
    return at(minimize_scalar(error, bracket=(best - 0.01, best, best + 0.01), tol=1e-12).x)


def _on_diamond(gram: Array, least: Array, extent: float) -> Array:
    """The least error on a diamond: on each edge that of a parabola, cut at the corners."""
    corners = extent * np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
    found = []
    for start, stop in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = stop - start
        share = float(along @ gram @ (least - start)) / float(along @ gram @ along)
        found.append(start + np.clip(share, 0.0, 1.0) * along)
    errors = [(point - least) @ gram @ (point - least) for point in found]
    return np.asarray(found[int(np.argmin(errors))], dtype=np.float64)
