"""Estimators of the parameters of given regressors: least squares, total least squares, ridge, Bayesian.

Each is a small immutable object that is called with regressors and outputs, so that it can be handed to an identifier:
``Frols(estimator=Ridge())``.

>>> import numpy as np
>>> rows = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 3.0]])
>>> TotalLeastSquares()(rows, np.array([1.0, 3.0, 5.0, 7.0])).theta.round(12).tolist()
[1.0, 2.0]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.estimate import Centred, Estimate
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TotalLeastSquares:
    """Estimator of given terms by total least squares, for equal errors in regressors and output.

    The errors are assumed independent and of equal variance. The estimate theta is the vector for which ``P theta = y``
    holds after the smallest change of the regressors P and the output y; it follows from the singular value
    decomposition of [P y]. A constant regressor is taken as exact. With n samples and the variance s^2 of each single
    error, ``noise_variance`` is the variance ``(1 + |theta|^2) s^2`` of the equation's error, and ``theta_cov`` is the
    first-order approximation ``(1 + |theta|^2) s^2 (P'P - n s^2)^-1``. The assumption holds only roughly for a NARX
    model: its regressors share lagged signals, and products scale the errors.

    Identifiers pass scaled regressors: each signal is divided by the power of two just above its largest magnitude. The
    errors are then assumed equal relative to these divisors, not in the signals' units. If the errors are equal in the
    units, call the estimator with unscaled regressors, as returned by `TermTable.rows`.

    References
    ----------
    Golub, Van Loan, "An analysis of the total least squares problem", SIAM J. Numer. Anal. 17 (1980) 883-893,
    doi:10.1137/0717073.
    Van Huffel, Vandewalle, "The Total Least Squares Problem" (1991), doi:10.1137/1.9781611971002.
    """

    def __call__(self, rows: Array, target: Array) -> Estimate:
        """Estimate. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""
        centred = Centred.of(rows, target)
        n_terms, n = centred.rows.shape
        if centred.freedom <= n_terms:
            raise ModelError(f"{n} samples do not determine {n_terms} parameters and the noise")
        _, s, vt = np.linalg.svd(np.vstack([centred.rows, centred.target]).T, full_matrices=False)
        if abs(vt[-1, -1]) < np.finfo(float).eps * n:
            raise ModelError("the total least squares problem has no solution: the regressors depend on each other")
        theta = -vt[-1, :-1] / vt[-1, -1]
        variance = float((1 + theta @ theta) * s[-1] ** 2 / (centred.freedom - n_terms))
        # P'P - s_min^2 from the singular values of P, which are not below s_min.
        _, t, wt = np.linalg.svd(centred.rows.T, full_matrices=False)
        root = wt.T / np.sqrt(np.maximum(t**2 - s[-1] ** 2, np.finfo(float).tiny))
        return centred.complete(theta, np.sqrt(variance) * root, variance)
