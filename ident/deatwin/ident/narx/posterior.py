"""The posterior of a NARX model's parameters: intervals, densities, draws, and export to ArviZ."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.ident.arguments import probability
from deatwin.ident.narx.covariance import covariance_root
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.plant.arrays import Array, require_generator
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class ThetaDraws:
    """Joint draws of parameters and noise."""

    theta: Array  # shape (n_draws, n_terms): Parameters in SI units
    noise_variance: Array  # shape (n_draws, n_outputs): Variances of e(k), squares of the outputs' units


@dataclass(frozen=True, kw_only=True, eq=False)
class ThetaPosterior:
    """Posterior of a model's parameters: Student-t, or normal if the model's degrees of freedom are infinite.

    The noise precision tau, the inverse of the noise variance, has the distribution ``Gam(a, b)`` with shape a and rate
    b. Given tau, the parameters theta have the distribution ``N(mean, V/tau)``. Their marginal distribution is
    therefore Student-t with 2a degrees of freedom and covariance ``V b/(a - 1)``, which is the model's ``theta_cov``.
    The model's ``noise_variance`` is ``b/(a - 1)``. If there are several outputs, the equation of each has its own tau.

    Parameters
    ----------
    model : NarxModel
        Model with the parameters, their covariance and degrees of freedom.
    """

    model: NarxModel

    def __post_init__(self) -> None:
        require_model(self.model)

    @property
    def scale(self) -> Array:
        """Scale of each parameter's Student-t distribution, shape (n_terms,), in the parameter's unit.

        For a normal posterior, it is the standard deviation.
        """
        dof = self.model.theta_dof
        shrink = 1.0 if math.isinf(dof) else (dof - 2) / dof
        return np.asarray(np.sqrt(shrink * np.diag(self.model.theta_cov)))

    def interval(self, level: float = 0.95) -> Array:
        """Return lower and upper ends of each parameter's central interval, shape (n_terms, 2), in the parameters' units.

        `level` is the probability that the interval contains the parameter; ModelError unless it is between 0 and 1.
        """
        half = quantile(level, self.model.theta_dof) * self.scale
        return np.column_stack([self.model.theta - half, self.model.theta + half])

    def sample(self, rng: np.random.Generator, n_draws: int) -> ThetaDraws:
        """Draw `n_draws` joint samples of parameters and noise variances with the random generator `rng`."""
        require_generator(rng)
        model = self.model
        # (1/tau) / E[1/tau]: inverse gamma of mean 1
        if math.isinf(model.theta_dof):
            ratio = np.ones((n_draws, model.n_outputs))
        else:
            a = model.theta_dof / 2
            ratio = (a - 1) / rng.gamma(a, size=(n_draws, model.n_outputs))
        normal = rng.standard_normal((n_draws, model.theta.size)) @ covariance_root(model.theta_cov).T
        return ThetaDraws(
            theta=model.theta + normal * np.sqrt(ratio[:, list(model.equations)]),
            noise_variance=ratio * np.atleast_1d(model.noise_variance),
        )

    def to_arviz(self, rng: np.random.Generator, **options: Any) -> Any:
        """Return posterior draws as ArviZ data, an InferenceData or, from ArviZ 1 on, a DataTree; needs ``bayes``.

        `rng` draws. The `options` are ``recording``, whose one-step predictions and log-likelihood are added, and
        ``n_chains`` and ``n_draws``, the numbers of chains, 4, and of draws in each of them, 500 by default.
        """
        return _to_arviz(self, rng, **options)


def quantile(level: float, dof: float) -> float:
    """Return the half width of the central interval of a Student-t or normal law, in units of its scale."""
    from scipy import special

    share = (1 + probability(level)) / 2
    return float(special.ndtri(share) if math.isinf(dof) else special.stdtrit(dof, share))


def regressors(model: NarxModel, recording: Recording) -> Array:
    """Return the terms of a model over a recording. Shapes: returns (n_terms, n - max_lag)."""
    noise = recording.outputs - model.predict(recording).outputs if model.table.channels("e") else None
    signals = model.about_origin(recording.inputs, recording.outputs)
    return model.table.rows(*signals, model.table.max_lag, recording.n_samples, noise)


def _to_arviz(
    posterior: ThetaPosterior,
    rng: np.random.Generator,
    *,
    recording: Recording | None = None,
    n_chains: int = 4,
    n_draws: int = 500,
) -> Any:
    """Return independent draws of the posterior and, with a recording, their one-step predictions."""
    try:
        import arviz
    except ImportError as error:
        raise ModelError('export to ArviZ needs ArviZ: pip install "arviz>=0.18"') from error
    model, draws = posterior.model, posterior.sample(rng, n_chains * n_draws)
    groups = {"posterior": {"theta": draws.theta, "noise_variance": draws.noise_variance}}
    coords: dict[str, Any] = {"term": _labels(model), "output": list(model.output_names)}
    dims = {"theta": ["term"], "noise_variance": ["output"]}
    if recording is not None:
        groups |= _one_step(model, recording, draws.theta, draws.noise_variance, rng)
        coords["time_s"] = recording.timepts[model.table.max_lag :]
        dims["y"] = ["output", "time_s"]
    shaped = {
        group: {
            name: values if group == "observed_data" else values.reshape(n_chains, n_draws, *values.shape[1:])
            for name, values in variables.items()
        }
        for group, variables in groups.items()
    }
    if int(arviz.__version__.split(".")[0]) >= 1:
        return arviz.from_dict(shaped, coords=coords, dims=dims)
    return arviz.from_dict(**shaped, coords=coords, dims=dims)


def _labels(model: NarxModel) -> list[str]:
    """Return the terms as text, with the output of their equation if there are several."""
    if model.n_outputs == 1:
        return [str(term) for term in model.terms]
    names = model.output_names
    return [f"{names[row]}: {term}" for row, term in zip(model.equations, model.terms, strict=True)]


def _one_step(
    model: NarxModel, recording: Recording, theta: Array, variance: Array, rng: np.random.Generator
) -> dict[str, dict[str, Array]]:
    """Return predicted outputs and the log likelihood of the measured ones, (n_draws, n_outputs, n), and the latter."""
    origin = model.output_origin[:, None]
    rows, measured = regressors(model, recording), recording.outputs[:, model.table.max_lag :]
    belongs = np.array(model.equations)
    mean = origin + np.stack(
        [theta[:, belongs == row] @ rows[belongs == row] for row in range(model.n_outputs)], axis=1
    )
    spread = variance[:, :, None]
    if not np.all(spread > 0):
        raise ModelError("the model has no noise variance, so that the recording has no likelihood")
    error = measured - mean
    return {
        "posterior_predictive": {"y": mean + np.sqrt(spread) * rng.standard_normal(mean.shape)},
        "log_likelihood": {"y": -0.5 * (error**2 / spread + np.log(2 * math.pi * spread))},
        "observed_data": {"y": measured},
    }
