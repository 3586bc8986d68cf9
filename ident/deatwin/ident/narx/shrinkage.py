"""Estimation with a penalty or a prior: ridge regression and Bayesian linear regression with its evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, lgamma, log, pi

import numpy as np

from deatwin.ident.arguments import positive
from deatwin.ident.narx.bayes import Posterior, Priors, Statistics, posterior
from deatwin.ident.narx.estimate import Centred, Estimate
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError, nearest


@dataclass(frozen=True, kw_only=True, eq=False)
class BayesianEstimate(Estimate):
    """A posterior with its evidence."""

    log_evidence: float  # ln p(y), the marginal likelihood of the outputs as given, nats
    precision: float


@dataclass(frozen=True)
class Ridge:
    """Estimator of given terms, for `Frols` and `Fixed`: minimises ``mean((y - Z theta)^2) + penalty |theta|^2``.

    y is the output, and the columns of Z are the regressors divided by their root mean squares. If there is a constant
    regressor, it is not penalised, and y and the other regressors are centred before the division.

    For the covariance, the penalty is read as a Gaussian prior of theta. Let n be the number of samples, p the
    effective number of parameters, and ``s^2`` the residual sum of squares divided by n - p. ``theta_cov`` is then the
    posterior covariance ``s^2 (Z'Z + n penalty)^-1``. This includes the squared bias of theta, averaged over the prior.

    Parameters
    ----------
    penalty : float or str
        Penalty, a positive dimensionless number. "gcv" chooses it by generalised cross-validation, "evidence" by the
        largest marginal likelihood.

    References
    ----------
    Golub, Heath, Wahba, "Generalized cross-validation as a method for choosing a good ridge parameter",
    Technometrics 21 (1979) 215-223, doi:10.1080/00401706.1979.10489751.
    """

    penalty: float | str = "gcv"

    def __post_init__(self) -> None:
        known = ("gcv", "evidence")
        if isinstance(self.penalty, str) and self.penalty not in known:
            raise ModelError(
                f"penalty = {self.penalty!r}{nearest(self.penalty, known)}; give a number, or gcv or evidence"
            )
        if not isinstance(self.penalty, str):
            positive(self.penalty, "penalty")

    def __call__(self, rows: Array, target: Array) -> Estimate:
        """Estimate. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""
        centred = Centred.of(rows, target)
        sizes = np.sqrt(np.mean(centred.rows**2, axis=1))
        sizes[sizes == 0] = 1.0
        u, s, vt = np.linalg.svd((centred.rows / sizes[:, None]).T, full_matrices=False)
        spectrum = _Spectrum(s**2 / target.size, u.T @ centred.target, centred.target, centred.freedom)
        penalty = self.penalty
        if isinstance(penalty, str):
            penalty = _least({"gcv": spectrum.gcv, "evidence": spectrum.minus_evidence}[penalty])
        theta = vt.T @ (s / target.size / (spectrum.powers + penalty) * spectrum.along) / sizes
        freedom = spectrum.freedom(penalty)
        if not freedom > 0:
            raise ModelError(f"{target.size} samples leave no freedom for noise at penalty = {penalty:g}; take more")
        variance = spectrum.residual(penalty) / freedom
        # Directions that the samples do not show keep their prior variance.
        unseen = np.linalg.qr(vt.T, mode="complete")[0][:, s.size :]
        root = np.hstack([vt.T / np.sqrt(spectrum.powers + penalty), unseen / np.sqrt(penalty)])
        return centred.complete(theta, np.sqrt(variance / target.size) * root / sizes[:, None], variance)


@dataclass(frozen=True)
class Bayesian:
    """Estimator of given terms, for `Frols` and `Fixed`: Bayesian linear regression with a normal-gamma posterior.

    The priors are ``theta | tau ~ N(0, 1/(tau alpha))`` and ``tau ~ Gam(a0, b0)``, where theta are the parameters and
    tau is the noise precision. All parameters share the precision alpha, after each regressor is divided by the power
    of two nearest to its root mean square.

    Parameters
    ----------
    precision : float or None
        Precision alpha, dimensionless; if None, the value with the largest marginal likelihood is used.
    priors : Priors
        Parameters of the priors; only a0 and b0, the shape and rate for the noise precision, are used.

    References
    ----------
    Bishop, "Pattern Recognition and Machine Learning" (2006), sections 3.3 to 3.5.
    """

    precision: float | None = None
    priors: Priors = field(default_factory=Priors)

    def __post_init__(self) -> None:
        if self.precision is not None:
            positive(self.precision, "precision")
        if not isinstance(self.priors, Priors):
            raise ModelError(f"priors = {self.priors!r}; give Priors(), as of deatwin.ident.narx.bayes")

    def __call__(self, rows: Array, target: Array) -> BayesianEstimate:
        """Estimate. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""
        given = Statistics(
            gram=rows @ rows.T, moment=rows @ target, power=float(target @ target), n_samples=target.size
        )
        sizes = given.sizes
        data = given.divided(sizes)

        def at(precision: float) -> tuple[Posterior, float]:
            alpha = np.full(sizes.size, precision)
            found = posterior(data, alpha, self.priors)
            return found, _log_evidence(found, alpha, self.priors)

        precision = self.precision or _least(lambda value: -at(value)[1])
        found, evidence = at(precision)
        return BayesianEstimate(
            theta=found.mean / sizes,
            theta_cov=found.covariance / np.outer(sizes, sizes),
            noise_variance=found.noise_variance,
            dof=2 * found.a,
            log_evidence=evidence,
            precision=precision,
        )


def _log_evidence(found: Posterior, alpha: Array, priors: Priors) -> float:
    """Return ln p(y) at given precisions: the ratio of the normal-gamma law's normalising constants."""
    a0, b0 = priors.a0, priors.b0
    half_n = found.a - a0
    return float(
        -half_n * log(2 * pi)
        + 0.5 * (np.log(alpha).sum() + found.log_det)
        + a0 * log(b0)
        - found.a * log(found.b)
        + lgamma(found.a)
        - lgamma(a0)
    )


class _Spectrum:
    """Quantities of ridge regression from the singular value decomposition, as functions of the penalty."""

    def __init__(self, powers: Array, along: Array, target: Array, samples: int) -> None:
        self.powers, self.along, self.samples = powers, along, samples
        # At least rounding level, so that noise-free data have a logarithm.
        floor = float(np.finfo(float).eps ** 2 * (target @ target))
        self.outside = max(float(target @ target - along @ along), floor)

    def shrunk(self, penalty: float) -> Array:
        """Return the share of each direction that is kept."""
        return np.asarray(self.powers / (self.powers + penalty), dtype=np.float64)

    def freedom(self, penalty: float) -> float:
        """Return the number of samples minus the effective number of parameters."""
        return float(self.samples - self.shrunk(penalty).sum())

    def residual(self, penalty: float) -> float:
        """Return the residual sum of squares."""
        return self.outside + float(np.sum(((1 - self.shrunk(penalty)) * self.along) ** 2))

    def gcv(self, penalty: float) -> float:
        """Return ln of the generalised cross-validation score."""
        return log(self.residual(penalty)) - 2 * log(self.freedom(penalty))

    def minus_evidence(self, penalty: float) -> float:
        """Return -2 ln p(y) at the best noise variance, up to a constant."""
        left = 1 - self.shrunk(penalty)
        square = self.outside + float(np.sum(left * self.along**2))
        return self.samples * log(square) - float(np.log(left).sum())


def _least(measure: Callable[[float], float]) -> float:
    """Return the argument, within 1e-12 to 1e6, at which a measure is least: a grid, then Brent's method."""
    from scipy.optimize import minimize_scalar

    grid = np.linspace(log(1e-12), log(1e6), 90)
    best = int(np.argmin([measure(exp(value)) for value in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(lambda value: measure(exp(value)), bounds=(low, high), method="bounded")
    return exp(float(found.x))
