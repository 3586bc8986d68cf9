"""Estimate parameters that change with time: common base, and recursive least squares with forgetting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import solve_triangular

from deatwin.ident.arguments import real_number
from deatwin.ident.kalman import kalman_filter
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Recordings, Regression, flatten, require_no_target
from deatwin.ident.narx.terms import Term
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.ident.state_space import StateSpace
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
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
