"""Estimate parameters that change with time: recursive least squares with forgetting, and random walks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from deatwin.ident.arguments import positive, real_number
from deatwin.ident.kalman import Filtered, StateSpace, adjoint, kalman_filter, kalman_smoother
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Recordings, Regression, flatten, require_no_target
from deatwin.ident.narx.terms import Term
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError, nearest
from deatwin.plant.recording import Experiment, Recording

Terms = Sequence[Term | str] | Mapping[str, Sequence[Term | str]]
Structure = NarxModel | Terms  # Fixed structure: that of a model, or terms as `Fixed` takes them

_INDEPENDENT = 1e-7  # least singular value, relative to the largest, of regressors from which the recursion can start


class VaryingParameters(NarxIdentifier):
    """Base of estimators of theta(t); `trajectory_` is theta(t), `model_` the model at the last sample."""

    terms: Structure

    trajectory_: ThetaTrajectory

    def fit(self, recordings: Recordings, y: None = None, *, progress: Progress | None = None) -> Self:
        """Estimate the parameters along time, on `recordings` of one clock; `progress` takes share and step."""
        require_no_target(y)
        super().fit(Experiment(recordings=flatten(recordings)), progress=progress)
        fitted = [one for one in self.equations_ if isinstance(one, VaryingParameters)]
        if fitted:
            self.trajectory_ = ThetaTrajectory.joined([one.trajectory_ for one in fitted])
        return self

    def _check(self) -> None:
        Fixed(terms=self.terms)._check()

    def _notes(self, recordings: tuple[Recording, ...]) -> tuple[str, ...]:
        """Return no notes: the model belongs to one time, but least squares would use all times."""
        return ()

    def _resting(self, data: list[Regression], model: NarxModel) -> list[Regression]:
        return data  # the terms are given, and so is their origin

    def _regression(self, recordings: Recordings, output: int) -> Regression:
        return Fixed(terms=self.terms)._regression(recordings, output)

    def _written(self) -> Terms:
        """Return the terms in the form that `Fixed` expects."""
        if not isinstance(self.terms, NarxModel):
            return self.terms
        pairs = list(zip(self.terms.terms, self.terms.equations, strict=True))
        if self.terms.n_outputs == 1:
            return self.terms.terms
        return {f"y{row + 1}": [t for t, equation in pairs if equation == row] for row in range(self.terms.n_outputs)}

    def __repr__(self) -> str:
        def shown(terms: object) -> object:
            if isinstance(terms, Mapping):
                return {name: shown(equation) for name, equation in terms.items()}
            return [str(term) for term in terms] if isinstance(terms, list | tuple) else terms

        arguments = self.get_params(deep=False) | {"terms": shown(self._written())}
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in arguments.items())})"


@dataclass(kw_only=True, eq=False, repr=False)
class Rls(VaryingParameters):
    """Estimator of time-varying parameters by recursive least squares with exponential forgetting.

    At each sample k, the parameters theta minimise the sum of ``forgetting**(k - i) * (y(i) - phi(i)'theta)**2`` over
    all samples i up to k, with the output y and the regressors phi. The recursion starts from the least squares
    solution of a short initial part of the data, in which the regressors are linearly independent. The recursion is
    therefore exact: without forgetting, it ends at the least squares estimate of all data. Nothing is forgotten over a
    gap between recordings.

    Parameters
    ----------
    terms : NarxModel, sequence of Term or str, or mapping of str to such sequences
        Fixed structure: a model, whose terms are used, or terms such as ``["y(k-1)", "u(k-1)^2"]``. For several
        outputs, give the terms of each equation: ``{"y1": ["y1(k-1)"], "y2": ["y2(k-1)", "u(k-1)"]}``.
    forgetting : float
        Forgetting factor in (0, 1]; the memory is 1 / (1 - forgetting) samples.

    Attributes
    ----------
    trajectory_ : ThetaTrajectory
        Estimates from the end of the initial part on. Their covariance is the noise variance times the inverse of the
        weighted sum of ``phi phi'``. With forgetting, this covariance does not include the drift of the parameters.
    model_ : NarxModel
        Model at the last sample.

    References
    ----------
    Ljung, Soderstrom, "Theory and Practice of Recursive Identification", MIT Press 1983, section 2.2.
    """

    terms: Structure
    forgetting: float = 0.999

    def _check(self) -> None:
        super()._check()
        if not 0 < real_number(self.forgetting, "forgetting") <= 1:
            raise ModelError(f"forgetting = {self.forgetting}; it must lie above 0 and not above 1")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        rows, target = data.matrix()
        m, sizes = len(rows), regressor_sizes(rows)
        phi = rows.T / sizes
        count, theta, root, squares = _beginning(phi, target, self.forgetting)
        # In the coordinates z, theta + root z, the start is standard normal: no recursion is better conditioned.
        filtered = kalman_filter(
            StateSpace(
                rows=phi[count:] @ root,
                noise_variance=np.ones(1),
                start=np.zeros(m),
                start_cov=np.eye(m) / self.forgetting,
                fading=self.forgetting,
            ),
            target[count:] - phi[count:] @ theta,
        )
        states = np.concatenate([np.zeros((1, m)), filtered.states])
        roots = root @ np.concatenate([np.eye(m)[None], filtered.roots])
        progress(1.0, f"{m} parameters along {len(phi)} samples")
        noise = (squares + filtered.variance_factor * filtered.n_measured) / (len(phi) - m)
        self.trajectory_ = trajectory_of(
            data,
            self,
            times=sample_times(data)[count - 1 :],
            theta=theta[:, None] + root @ states.T,
            theta_cov=noise * (roots @ roots.swapaxes(1, 2)),
            sizes=sizes,
            noise_variance=noise,
        )
        return self.trajectory_.model


def _beginning(phi: Array, target: Array, forgetting: float) -> tuple[int, Array, Array, float]:
    """Solve the shortest beginning; return samples, theta, covariance root, squared residual."""
    n, count = phi.shape
    while count < n:
        weights = np.sqrt(forgetting) ** np.arange(count - 1, -1, -1)
        q, r = np.linalg.qr(weights[:, None] * phi[:count])
        values = np.linalg.svd(r, compute_uv=False)
        if values[-1] > _INDEPENDENT * values[0]:
            theta = solve_triangular(r, q.T @ (weights * target[:count]))
            left = weights * (target[:count] - phi[:count] @ theta)
            return count, theta, solve_triangular(r, np.eye(phi.shape[1])), float(left @ left)
        count *= 2
    raise ModelError(
        f"the {phi.shape[1]} terms depend on each other in the {n} samples of these recordings; take fewer terms, "
        "or a longer memory"
    )


def regressor_sizes(rows: Array) -> Array:
    """Return the root mean square of each regressor, shape (n_terms,). Shapes: `rows` (n_terms, n)."""
    sizes = np.sqrt(np.mean(rows**2, axis=1))
    if not np.all(sizes > 0):
        raise ModelError(f"term {int(np.argmin(sizes)) + 1} is zero throughout these recordings")
    return np.asarray(sizes, dtype=np.float64)


def sample_times(data: Regression) -> Array:
    """Return the times of a regression's samples on the experiment's clock in s, shape (n_samples,)."""
    return np.concatenate([record.timepts[data.first :] for record in data.recordings])


def trajectory_of(
    data: Regression,
    identifier: VaryingParameters,
    *,
    times: Array,
    theta: Array,
    theta_cov: Array,
    sizes: Array,
    noise_variance: float,
    drift_variance: Array | None = None,
    log_likelihood: float | None = None,
) -> ThetaTrajectory:
    """Return a trajectory in physical units. Shapes: `theta` (n_terms, n); `theta_cov` (n, n_terms, n_terms)."""
    last = data.model(
        theta[:, -1] / sizes, theta_cov[-1] / np.outer(sizes, sizes), noise_variance, identifier=identifier
    )
    unit = data.term_scales / sizes
    physical, physical_cov = theta * unit[:, None], theta_cov * np.outer(unit, unit)
    for array in (physical, physical_cov):
        array.setflags(write=False)
    return ThetaTrajectory(
        model=last,
        timepts=times,
        theta=physical,
        theta_cov=physical_cov,
        drift_variance=np.zeros(unit.size) if drift_variance is None else drift_variance * unit**2,
        log_likelihood=None
        if log_likelihood is None
        else log_likelihood - data.n_samples * float(np.log(data.output_scale)),
    )


_PRIOR_SAMPLES = 1e-4  # weight of the prior of the start, in samples
# Drift is measured by the variance that a term's contribution gains per sample, relative to that of the noise, times
# the square of the number of samples; with a value of 1, a local level would be averaged over the whole record.
_COARSE = (1e1, 1e3, 1e5, 1e7, 1e9)  # values that are tried first, for all parameters together
_NONE = 1e-2  # drift that could never be seen
_MOST = 1e6  # largest drift, without the square of the number of samples: the noise is negligible beside it
_USUAL_STEPS = 40  # usual number of evaluations of a search, for its progress


@dataclass(kw_only=True, eq=False, repr=False)
class ThetaSmoother(VaryingParameters):
    """Estimator of time-varying parameters that follow random walks: Kalman filter and fixed-interval smoother.

    The model is ``theta(k+1) = theta(k) + w(k)``, ``y(k) = phi(k)'theta(k) + e(k)``, with the parameters theta, the
    regressors phi, the output y and white noises w and e. The variances of w and e are estimated unless given. The
    filter starts at the least squares estimate, which counts only as much as 1e-4 samples. The random walk continues
    over a gap between recordings.

    Parameters
    ----------
    terms : NarxModel, sequence of Term or str, or mapping of str to such sequences
        Fixed structure: a model, whose terms are used, or terms such as ``["y(k-1)", "u(k-1)^2"]``. For several
        outputs, give the terms of each equation: ``{"y1": ["y1(k-1)"], "y2": ["y2(k-1)", "u(k-1)"]}``.
    drift : str
        Model of the variance of w. "each" estimates one variance for each parameter. "common" estimates a single
        variance, for regressors scaled to a root mean square of 1.
    variances : str
        Estimator of the variances. "likelihood" maximises the likelihood. A weak drift is then often estimated as zero,
        and the bands, which treat the variances as known, are too narrow: with one strong and two weak random walks
        over 600 samples, 95 % bands had a coverage of 88 %. "posterior" multiplies the likelihood by the standard
        deviation of each random walk [2]_. No drift is then estimated as zero, and 95 % bands have a coverage of 95 %
        (more for constant parameters).
    noise_variance : float, optional
        Variance of e in the squared unit of the output. Give both this and ``drift_variance``, or neither.
    drift_variance : array_like, shape (n_terms,), optional
        Variance of w for each parameter, in the parameter's squared unit; for one output only.

    Attributes
    ----------
    trajectory_ : ThetaTrajectory
        Smoothed parameters: the estimate at each time uses all samples. The bands treat the variances as known.
    filtered_ : ThetaTrajectory
        Filtered parameters: the estimate at each time uses the samples up to that time. With several outputs, each
        estimator in ``equations_`` has this attribute instead.
    model_ : NarxModel
        Model at the last sample.

    References
    ----------
    .. [1] Harvey, "Forecasting, Structural Time Series Models and the Kalman Filter", Cambridge University Press 1989,
       chapters 3 and 4.
    .. [2] Chung, Rabe-Hesketh, Dorie, Gelman, Liu, "A nondegenerate penalized likelihood estimator for variance
       parameters in multilevel models", Psychometrika 78 (2013) 685-709, doi:10.1007/s11336-013-9328-2.
    """

    terms: Structure
    drift: str = "each"
    variances: str = "likelihood"
    noise_variance: float | None = None
    drift_variance: ArrayLike | None = None

    filtered_: ThetaTrajectory = field(init=False)

    def _check(self) -> None:
        super()._check()
        for name, known in (("drift", ("each", "common")), ("variances", ("likelihood", "posterior"))):
            given = getattr(self, name)
            if given not in known:
                raise ModelError(f"{name} = {given!r}{nearest(str(given), known)}; known are {' and '.join(known)}")
        if (self.noise_variance is None) != (self.drift_variance is None):
            raise ModelError("give noise_variance and drift_variance together, or none of them and both are estimated")
        if self.noise_variance is not None:
            positive(self.noise_variance, "noise_variance")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        rows, target = data.matrix()
        sizes = regressor_sizes(rows)
        walk = _Walk.of(np.ascontiguousarray(rows.T / sizes), target, _intervals(data))
        if self.noise_variance is None:
            ratios = self._most_likely(walk, progress)
            noise = walk.filtered(ratios).variance_factor
        else:
            noise = self.noise_variance / data.output_scale**2
            ratios = self._given(len(sizes)) * (sizes / data.term_scales) ** 2 / noise
        filtered = walk.filtered(ratios, noise)
        smoothed = kalman_smoother(filtered)
        for name, result in (("filtered_", filtered), ("trajectory_", smoothed)):
            trajectory = trajectory_of(
                data,
                self,
                times=sample_times(data),
                theta=result.states.T,
                theta_cov=result.covariances,
                sizes=sizes,
                noise_variance=noise,
                drift_variance=noise * ratios,
                log_likelihood=filtered.log_likelihood,
            )
            setattr(self, name, trajectory)
        return self.trajectory_.model

    def _given(self, count: int) -> Array:
        """Return the given drift variances after a check."""
        given = np.asarray(self.drift_variance, dtype=np.float64)
        if given.shape != (count,) or not np.all(given >= 0):
            raise ModelError(f"drift_variance = {given}; {count} terms need as many values, none negative")
        return given

    def _most_likely(self, walk: _Walk, progress: Progress) -> Array:
        """Return the likeliest drift variances relative to that of the noise, shape (n_terms,)."""
        from scipy.optimize import minimize

        n, m = walk.phi.shape
        low, high = np.log(_NONE / n**2), np.log(_MOST)
        groups = np.ones((m, 1)) if self.drift == "common" else np.eye(m)
        search = _Search(walk, groups, 0.5 if self.variances == "posterior" else 0.0, progress)
        with self._keeping(lambda: np.isfinite(search.lowest)):
            for start in np.log(_COARSE) - 2 * np.log(n):
                search(np.full(groups.shape[1], min(start, high)))
            minimize(search, search.best, jac=True, method="L-BFGS-B", bounds=[(low, high)] * groups.shape[1])
        return groups @ np.where(search.best <= low + 1e-9, 0.0, np.exp(search.best))


class _Search:
    """Minus the log likelihood as a function of logarithmic drift variances; keeps the best point."""

    def __init__(self, walk: _Walk, groups: Array, exponent: float, progress: Progress) -> None:
        self.walk, self.groups, self.exponent, self.progress = walk, groups, exponent, progress
        self.lowest, self.reached, self.best, self.steps = np.inf, -np.inf, np.zeros(groups.shape[1]), 0

    def __call__(self, logs: Array) -> tuple[float, Array]:
        ratios = np.exp(logs)
        likelihood, score = self.walk.likelihood(self.groups @ ratios)
        value = -likelihood - self.exponent * float(logs.sum())
        if value < self.lowest:
            self.lowest, self.best, self.reached = value, np.array(logs), likelihood
        self.steps += 1
        share = self.steps / (self.steps + _USUAL_STEPS)
        self.progress(share, f"variances of the drift, log likelihood {self.reached:.6g}")
        return value, -(score @ self.groups) * ratios - self.exponent


@dataclass(frozen=True, kw_only=True, eq=False)
class _Walk:
    """A regression whose parameters follow random walks: rows phi (n, m), outputs, steps, and the start."""

    phi: Array
    target: Array
    intervals: Array | None
    start: Array
    start_cov: Array

    @classmethod
    def of(cls, phi: Array, target: Array, intervals: Array | None) -> _Walk:
        """Start from least squares; the covariance is relative to the variance of the noise."""
        n, m = phi.shape
        q, r = np.linalg.qr(phi)
        if n <= m or np.linalg.cond(r) > 1 / (n * np.finfo(float).eps):
            raise ModelError(f"the {m} terms depend on each other in the {n} samples of these recordings; take fewer")
        root = np.linalg.solve(r, np.eye(m))
        return cls(
            phi=phi,
            target=target,
            intervals=intervals,
            start=root @ (q.T @ target),
            start_cov=n / _PRIOR_SAMPLES * (root @ root.T),
        )

    def filtered(self, ratios: Array, noise_variance: float = 1.0) -> Filtered:
        """Filter with given variances of the drift, relative to that of the noise."""
        model = StateSpace(
            rows=self.phi,
            noise_variance=np.array([noise_variance]),
            start=self.start,
            start_cov=noise_variance * self.start_cov,
            process_cov=np.diag(noise_variance * ratios),
            intervals=self.intervals,
        )
        return kalman_filter(model, self.target)

    def likelihood(self, ratios: Array) -> tuple[float, Array]:
        """Return the log likelihood at the best noise variance, and its gradient by the variance ratios."""
        filtered = self.filtered(ratios)
        vectors, matrices = adjoint(filtered)
        weights = np.ones(len(self.phi) - 1) if self.intervals is None else self.intervals
        squares = weights @ vectors[1:] ** 2 / filtered.variance_factor
        return filtered.scaled_log_likelihood, 0.5 * (squares - weights @ np.einsum("kii->ki", matrices[1:]))


def _intervals(data: Regression) -> Array | None:
    """Return the numbers of sample intervals between the samples; None where there is no gap."""
    if len(data.recordings) == 1:
        return None
    steps = np.diff(sample_times(data)) / data.recordings[0].sample_time
    return np.asarray(np.maximum(np.round(steps), 1.0))
