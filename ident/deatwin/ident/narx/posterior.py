"""Posterior of a NARX model's parameters: intervals, draws, ArviZ data, and predictive bands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import probability, real_numbers, whole_number
from deatwin.ident.narx.covariance import covariance_root
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.plant.amplitudes import axis_label
from deatwin.plant.arguments import instance
from deatwin.plant.arrays import Array, require_generator
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, one_unit, status_of, variable
from deatwin.plant.drawing import Axes, axes_or_new
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

    def to_arviz(
        self, rng: np.random.Generator, *, recording: Recording | None = None, n_chains: int = 4, n_draws: int = 500
    ) -> Any:
        """Return posterior draws as ArviZ data, an InferenceData or, from ArviZ 1 on, a DataTree.

        The extra ``bayes`` must be installed. `rng` generates the draws: `n_chains` chains of `n_draws` each. If a
        `recording` is given, its one-step predictions and log-likelihood are added.
        """
        try:
            import arviz
        except ImportError as error:
            raise ModelError('export to ArviZ needs ArviZ: pip install "arviz>=0.18"') from error
        model, draws = self.model, self.sample(rng, n_chains * n_draws)
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


_CHUNK = 4096  # samples whose quantiles are computed at once


class BandStatus(Enum):
    """Validity of a band. The value of each member is a message for the user."""

    OK = "done"
    DIVERGED = (
        "some draws of the posterior diverged in free run and were left out, so the band is too narrow: "
        "stay within the operating range of the model, or identify it from more data"
    )

    @property
    def ok(self) -> bool:
        """True if the band includes every draw."""
        return self is BandStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictiveBand(Described):
    """Predictive band: at each time, an interval that contains a new measurement with a given probability.

    Parameters
    ----------
    outputs : ndarray, shape (n_outputs, n)
        Centre of the band, in the recording's units: the mean of the one-step prediction, or the median of the free
        runs. The samples before ``first`` are initial values, not predictions.
    lower, upper : ndarray, shape (n_outputs, n)
        Lower and upper end of the band, in the recording's units.
    level : float
        Probability that the interval at any one time contains a new measurement.
    measured : ndarray, shape (n_outputs, n)
        Measured outputs, in the recording's units.
    timepts : ndarray, shape (n,)
        Times of the samples on the recording's clock in s.
    first : int
        Index of the first predicted sample.
    units : tuple of str
        Unit of each output.
    draws : int
        Number of free runs, each with parameters drawn from the posterior; 0 for a one-step prediction.
    diverged : int
        Number of free runs that diverged and were left out of the band.
    """

    outputs: Array = field(metadata=variable("output", "time", name="middle", unit=one_unit))
    lower: Array = field(metadata=variable("output", "time", unit=one_unit))
    upper: Array = field(metadata=variable("output", "time", unit=one_unit))
    level: float = field(metadata=attribute())
    measured: Array = field(metadata=variable("output", "time", unit=one_unit))
    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    first: int = field(metadata=attribute())
    units: tuple[str, ...] = field(metadata=coordinate("output", name="unit"))
    draws: int = field(default=0, metadata=attribute())
    diverged: int = field(default=0, metadata=attribute())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "status": status_of(),
    }

    @property
    def status(self) -> BandStatus:
        """``DIVERGED`` if free runs diverged and were left out of the band, otherwise ``OK``."""
        return BandStatus.DIVERGED if self.diverged else BandStatus.OK

    @property
    def coverage(self) -> Array:
        """Share of the measured outputs from sample ``first`` on that lie in the band, shape (n_outputs,)."""
        inside = (self.lower <= self.measured) & (self.measured <= self.upper)
        return np.asarray(inside[:, self.first :].mean(axis=1), dtype=np.float64)

    def plot(self, ax: Axes | None = None, *, output: int = 0) -> Axes:
        """Draw the band, its centre and the measurement of the output with index `output`, on `ax` or new axes."""
        axes = axes_or_new(ax)
        axes.fill_between(
            self.timepts,
            self.lower[output],
            self.upper[output],
            color="C1",
            alpha=0.35,
            linewidth=0,
            label=f"{100 * self.level:g} % band",
        )
        axes.plot(self.timepts, self.outputs[output], color="C1", label="model")
        axes.plot(self.timepts, self.measured[output], color="C0", linewidth=0.8, label="measured")
        unit = self.units[output]
        axes.set(xlabel="time (s)", ylabel=axis_label("output", unit))
        axes.legend()
        return axes


def one_step_band(model: NarxModel, recording: Recording, *, level: float = 0.95) -> PredictiveBand:
    """Return the predictive band of the one-step prediction.

    The posterior is ``theta | tau ~ N(mean, V/tau)``, ``tau ~ Gam(a, b)``, with the parameters theta and the noise
    precision tau. With the regressors phi, each output then has a Student-t distribution with 2a degrees of freedom,
    mean ``phi'mean`` and squared scale ``b/a (1 + phi'V phi)``. The band is exact for a model without noise terms. For
    a model with noise terms, the past noise in phi is estimated by the one-step errors of the model with the mean
    parameters.

    Parameters
    ----------
    model : NarxModel
        Model with its covariance, degrees of freedom and noise variance.
    recording : Recording
        Measured inputs and outputs, in the model's units.
    level : float
        Probability that the band at any one time contains the measurement, between 0 and 1.

    Raises
    ------
    ModelError
        If the recording does not suit the model, or `level` does not lie between 0 and 1.
    """
    half_width = quantile(level, require_model(model).theta_dof)
    response = model.predict(recording)
    rows, first = regressors(model, recording), response.first
    belongs = np.array(model.equations)
    shrink = 1.0 if math.isinf(model.theta_dof) else (model.theta_dof - 2) / model.theta_dof
    half = np.zeros_like(response.outputs)
    for row, noise in enumerate(np.atleast_1d(model.noise_variance)):
        own = belongs == row
        phi, cov = rows[own], model.theta_cov[np.ix_(own, own)]
        uncertain = np.einsum("ik,ik->k", phi, cov @ phi)
        half[row, first:] = half_width * np.sqrt(shrink * (noise + uncertain))
    return _band(model, recording, response.outputs, response.outputs - half, response.outputs + half, level)


def free_run_band(
    model: NarxModel,
    recording: Recording,
    rng: np.random.Generator,
    *,
    n_draws: int = 400,
    level: float = 0.95,
    output_noise: ArrayLike | None = None,
) -> PredictiveBand:
    """Return the predictive band of new measurements in free run.

    The band consists of quantiles over many free runs. Each run has one draw of the parameters and the noise variance
    from the posterior, and new noise at each sample. By default, the noise enters the model's equation and therefore
    propagates through the past outputs. A model that was fitted to the smallest free-run error (`Grow`, `refine`)
    assumes noise on the readings instead. For such a model, give the standard deviation of that noise as
    `output_noise`.

    Parameters
    ----------
    model : NarxModel
        Model with its covariance, degrees of freedom and noise variance.
    recording : Recording
        Inputs and outputs in the model's units; the first ``model.table.max_lag`` outputs start the runs.
    rng : numpy.random.Generator
        Random generator for the draws.
    n_draws : int
        Number of runs.
    level : float
        Probability that the band at any one time contains a new measurement, between 0 and 1.
    output_noise : float or array_like of shape (n_outputs,), optional
        Standard deviation of noise on the readings, in the outputs' units, which replaces the noise in the equation.
        For a model from `Grow` or `refine`, give the free-run error on the training data,
        ``model.simulate(training).rms_error``.

    Returns
    -------
    PredictiveBand
        Band of the runs that did not diverge; ``.status`` says if some did.

    Raises
    ------
    ModelError
        If all runs diverge, `n_draws` is below 2, the recording does not suit the model, `level` does not lie between 0
        and 1, or `output_noise` is negative.
    """
    require_generator(rng)
    require_model(model)
    instance(Recording)(recording, "recording")
    tail = (1 - probability(level)) / 2
    whole_number(n_draws, "n_draws", 2)
    runs = _runs(model, recording, rng, n_draws, None if output_noise is None else _readings(model, output_noise))
    if not runs:
        raise ModelError(f"all {n_draws} draws of the posterior diverged in free run: there is no band")
    ends = np.empty((3, *runs[0].shape))
    for start in range(0, recording.n_samples, _CHUNK):
        part = np.stack([run[:, start : start + _CHUNK] for run in runs])
        # A new measurement is like one more draw: it lies below the k-th of n with probability k / (n + 1), as in this
        # definition of the quantiles only.
        ends[..., start : start + _CHUNK] = np.quantile(part, [tail, 0.5, 1 - tail], axis=0, method="weibull")
    lower, middle, upper = ends
    return _band(model, recording, middle, lower, upper, level, draws=n_draws, diverged=n_draws - len(runs))


def _readings(model: NarxModel, output_noise: ArrayLike) -> Array:
    """Return the standard deviation of the noise on each reading, shape (n_outputs, 1)."""
    given = real_numbers(output_noise, "output_noise")
    if given.shape not in ((), (model.n_outputs,)) or not np.all((given >= 0) & np.isfinite(given)):
        raise ModelError(
            f"output_noise = {output_noise!r}; it must be a standard deviation of at least 0, or one for each of the "
            f"{model.n_outputs} outputs"
        )
    return np.broadcast_to(given, model.n_outputs)[:, None]


def _runs(
    model: NarxModel, recording: Recording, rng: np.random.Generator, n_draws: int, readings: Array | None
) -> list[Array]:
    """Return noisy free runs (n_outputs, n) of draws that do not diverge; `readings` is noise on outputs."""
    first = model.simulate(recording).first  # also checks that the recording suits
    limit = model.divergence_limit(recording.outputs)
    inputs, outputs = model.about_origin(recording.inputs, recording.outputs)
    draws = ThetaPosterior(model=model).sample(rng, n_draws)
    runs = []
    for theta, variance in zip(draws.theta, draws.noise_variance, strict=True):
        drawn = rng.standard_normal(recording.outputs.shape)
        noise = np.sqrt(variance)[:, None] * drawn if readings is None else np.zeros_like(drawn)
        march = March.of(model.terms, {"u": inputs, "e": noise}, "y", outputs, first=first, equations=model.equations)
        run, failed = march.run(theta, limit=limit, base=noise)
        if failed is None:
            runs.append(run + model.output_origin[:, None] + (0.0 if readings is None else readings * drawn))
    return runs


def _band(
    model: NarxModel,
    recording: Recording,
    middle: Array,
    lower: Array,
    upper: Array,
    level: float,
    draws: int = 0,
    diverged: int = 0,
) -> PredictiveBand:
    for values in (middle, lower, upper):
        values.setflags(write=False)
    return PredictiveBand(
        outputs=middle,
        lower=lower,
        upper=upper,
        level=level,
        measured=recording.outputs,
        timepts=recording.timepts,
        first=model.table.max_lag,
        units=model.output_units,
        draws=draws,
        diverged=diverged,
    )
