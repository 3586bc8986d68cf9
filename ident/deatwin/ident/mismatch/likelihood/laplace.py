r"""Evidence of a fit for given scales of error and noise, from products of whitened residual and columns.

With whitened residual r and columns G, z where the fit lies in the standard normal coordinates, and the variances
:math:`S_k` of the innovations:

.. math::
    b = G^T r - z, \quad M = G^T G + I, \quad
    \log p(y) = -\tfrac12 \Big(r^T r + z^T z - b^T M^{-1} b + \sum_k \log 2\pi S_k + \log\det M\Big)

This is exact if the readings are linear in the coordinates. The prior of an amplitude a that cannot be negative is half
a normal law. This multiplies p(y) by :math:`2\Phi(m/s)`, with m and s the mean and deviation of a without that limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import erfcx, log_ndtr

from deatwin.ident.mismatch.likelihood.model import Prior

LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, kw_only=True, eq=False)
class Weighed:
    """Log evidence and coordinates of a fit, as functions of the noise, at one ratio of error to noise."""

    products: np.ndarray  # (m + 1, m + 1), of the whitened residual and columns, for unit noise
    logs: float  # sum of the log variances of the innovations
    count: int  # number of the innovations
    prior: Prior

    @cached_property
    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        # If columns differ in size, each product is accurate relative to its own size, but an eigenvalue only relative
        # to the largest one. So a root of the scaled products is taken, and then its singular values, whose rounding
        # error becomes squared in the eigenvalues.
        products = self.products[1:, 1:]
        sizes = np.sqrt(np.diagonal(products))
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        squares, axes = np.linalg.eigh(products / np.multiply.outer(sizes, sizes))
        _, roots, along = np.linalg.svd(np.sqrt(np.maximum(squares, 0.0))[:, None] * axes.T * sizes)
        return roots**2, along.T

    def _along(self, log_sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return eigenvalues of M and b along its axes, shape (g, m) each, and the weight of each noise level, (g,)."""
        (squares, axes), weight = self._axes, np.exp(-2.0 * log_sigma)
        b = np.multiply.outer(weight, self.products[0, 1:] @ axes) - self.prior.fitted @ axes
        return 1.0 + np.multiply.outer(weight, squares), b, weight

    def log_evidence(self, log_sigma: np.ndarray) -> np.ndarray:
        """Return the log evidence for noise with the given logarithms, shape (g,)."""
        m, b, weight = self._along(log_sigma)
        squares = weight * self.products[0, 0] + self.prior.fitted @ self.prior.fitted - (b**2 / m).sum(axis=1)
        variances = self.logs + self.count * (LOG_2PI + 2.0 * log_sigma)
        return -0.5 * (squares + variances + np.log(m).sum(axis=1)) + self._allowed(m, b)

    def coordinates(self, log_sigma: float) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (m,) and covariance (m, m) of the coordinates, ignoring their limits."""
        m, b, _ = self._along(np.array([log_sigma]))
        axes = self._axes[1]
        return self.prior.fitted + axes @ (b[0] / m[0]), axes / m[0] @ axes.T

    def _allowed(self, m: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the log ratio of posterior to prior probability that the limited coordinates are within their
        limits.
        """
        limited = np.isfinite(self.prior.above)
        if not limited.any():
            return np.zeros(len(m))
        axes, above = self._axes[1][limited], self.prior.above[limited]
        mean = self.prior.fitted[limited] + b / m @ axes.T
        cov = np.einsum("ia,ga,ja->gij", axes, 1.0 / m, axes)
        return log_above(mean, cov, above) - log_ndtr(-above).sum()


def log_above(mean: np.ndarray, cov: np.ndarray, above: np.ndarray) -> np.ndarray:
    """Return the log probability, (g,), that normal variables, mean (g, q), all lie above limits, (q,)."""
    # The limits are applied one after the other. This is exact for one variable or independent ones; otherwise each
    # variable is treated as normal again after each cut (Mendell & Elston 1974, doi:10.2307/2529617).
    mean, cov, total = mean.copy(), cov.copy(), np.zeros(len(mean))
    least = np.finfo(float).eps * np.diagonal(cov, axis1=1, axis2=2)  # variances below it are rounding
    edges = (mean - above) / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    for k in np.argsort(edges.mean(axis=0)):  # the largest cut comes first, since the first one is exact
        spread = np.sqrt(np.maximum(cov[:, k, k], least[:, k]))
        edge = (mean[:, k] - above[k]) / spread
        total += log_ndtr(edge)
        # mean of the variable after the cut, and the share of its variance that it loses, in standard deviations
        hazard = np.sqrt(2.0 / np.pi) / erfcx(-edge / np.sqrt(2.0))
        lost = np.clip(hazard * (hazard + edge), 0.0, 1.0)
        along = cov[:, :, k] / spread[:, None]
        mean += along * hazard[:, None]
        cov -= np.einsum("gi,gj,g->gij", along, along, lost)
    return total
