"""Parameters of a NARX model along time, and the model at each time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only, real_number, real_numbers, whole_number
from deatwin.ident.narx.document import fields_of, to_document
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.posterior import quantile
from deatwin.ident.narx.response import NarxResponse
from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, coordinate, variable
from deatwin.plant.documents import Saved
from deatwin.plant.drawing import Axes, panels_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

SCHEMA = "deatwin/theta/1"


@dataclass(frozen=True, kw_only=True, eq=False)
class ThetaTrajectory(
    Described,
    Saved,
    schema=SCHEMA,
    document=lambda trajectory: _document(trajectory),
    fields=lambda document: _fields_of(document),
):
    """NARX model with fixed terms and parameters that change with time.

    Parameters
    ----------
    model : NarxModel
        Model at the last time, with the terms and the noise variance that hold for all times.
    timepts : ndarray, shape (n,)
        Increasing times on the experiment's clock, in s.
    theta : ndarray, shape (n_terms, n)
        Parameters at each time, in the units that follow from the signals.
    theta_cov : ndarray, shape (n, n_terms, n_terms)
        Covariance of the parameters at each time.
    drift_variance : ndarray, shape (n_terms,)
        Variance of the change of each parameter in one sample interval, in the parameter's squared unit; 0 if the
        estimator does not model the drift as a random walk.
    log_likelihood : float or None
        Log-likelihood of the outputs for `drift_variance` and the noise variance of `model`; None if the estimator does
        not compute the log-likelihood.

    Raises
    ------
    ModelError
        If shapes or values are inconsistent.
    """

    model: NarxModel
    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    theta: Array = field(metadata=variable("term", "time"))
    theta_cov: Array = field(metadata=variable("time", "term", "other_term"))
    drift_variance: Array = field(metadata=variable("term"))
    log_likelihood: float | None = None

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "term": coordinate("term", of=lambda found: [str(term) for term in found.terms]),
        "other_term": coordinate("other_term", of=lambda found: [str(term) for term in found.terms]),
    }

    def __post_init__(self) -> None:
        for name in ("timepts", "theta", "theta_cov", "drift_variance"):
            given = getattr(self, name)
            if not isinstance(given, np.ndarray) or given.dtype != np.float64 or given.flags.writeable:
                object.__setattr__(self, name, real_numbers(given, name))
        m, n = len(require_model(self.model).terms), self.timepts.size
        shapes = {"timepts": (n,), "theta": (m, n), "theta_cov": (n, m, m), "drift_variance": (m,)}
        for name, wanted in shapes.items():
            values = getattr(self, name)
            if values.shape != wanted or not np.all(np.isfinite(values)):
                raise ModelError(f"{name} has the shape {values.shape}; it must be {wanted}, and all of it finite")
        if n == 0 or np.any(np.diff(self.timepts) <= 0) or np.any(self.drift_variance < 0):
            raise ModelError("timepts must increase, at least one of them, and drift_variance not be negative")

    @classmethod
    def joined(cls, parts: Sequence[ThetaTrajectory]) -> Self:
        """Combine trajectories of each output's equation, `parts` in the order of the outputs, at their common times.

        Parameters of different outputs are taken as uncorrelated. ModelError unless there is one for each output.
        """
        times = parts[0].timepts
        for part in parts[1:]:
            times = np.intersect1d(times, part.timepts)
        kept = [np.searchsorted(part.timepts, times) for part in parts]
        sizes = [len(part.model.terms) for part in parts]
        theta_cov = np.zeros((times.size, sum(sizes), sum(sizes)))
        for part, chosen, stop, size in zip(parts, kept, np.cumsum(sizes), sizes, strict=True):
            theta_cov[:, stop - size : stop, stop - size : stop] = part.theta_cov[chosen]
        likelihoods = [part.log_likelihood for part in parts]
        known = [value for value in likelihoods if value is not None]
        return cls(
            model=NarxModel.joined([part.model for part in parts]),
            timepts=times,
            theta=np.concatenate([part.theta[:, chosen] for part, chosen in zip(parts, kept, strict=True)]),
            theta_cov=theta_cov,
            drift_variance=np.concatenate([part.drift_variance for part in parts]),
            log_likelihood=sum(known) if len(known) == len(parts) else None,
        )

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of all equations."""
        return self.model.terms

    @cached_property
    def std(self) -> Array:
        """Standard deviation of each parameter, shape (n_terms, n)."""
        return read_only(np.sqrt(np.einsum("kii->ik", self.theta_cov)))

    def at(self, time: float) -> NarxModel:
        """Return the model at the sample nearest to `time`, s on the experiment's clock; ModelError if it is outside."""
        k = int(self._nearest(np.array([real_number(time, "time")]))[0])
        return replace(self.model, theta=self.theta[:, k], theta_cov=self.theta_cov[k])

    def thinned(self, step: int) -> Self:
        """Return the trajectory at every `step`-th time, counted from the end; ModelError if `step` is below 1."""
        kept = np.arange(self.timepts.size)[:: -whole_number(step, "step")][::-1]
        return replace(self, timepts=self.timepts[kept], theta=self.theta[:, kept], theta_cov=self.theta_cov[kept])

    def predict(self, recording: Recording, *, steps: int = 1) -> NarxResponse:
        """Predict `steps` ahead as `NarxModel.predict`; ModelError if the times of `recording` exceed the trajectory's."""
        return self._driven.predict(self._with_theta(recording), steps=steps)

    def simulate(self, recording: Recording) -> NarxResponse:
        """Simulate as `NarxModel.simulate`; ModelError if the times of `recording` exceed those of the trajectory."""
        return self._driven.simulate(self._with_theta(recording))

    def plot(self, axes: Sequence[Axes] | None = None) -> list[Axes]:
        """Draw each parameter over time with its 95 % band, on `axes` or new ones; ModelError for too few axes."""
        panels = panels_or_new(axes, len(self.terms), height=1.4, sharex=True)
        for ax, term, theta, std in zip(panels, self.terms, self.theta, self.std, strict=True):
            half = quantile(0.95, np.inf) * std

            ax.fill_between(self.timepts, theta - half, theta + half, color="C0", alpha=0.25, linewidth=0)
            ax.plot(self.timepts, theta, color="C0", linewidth=1.2)
            ax.set_title(str(term), loc="left", fontsize="small")
        panels[-1].set_xlabel("time (s)")
        return panels

    @cached_property
    def _driven(self) -> NarxModel:
        """Return the model with its parameters as further inputs, so that any simulation can use theta(t)."""
        n_inputs, count = len(self.model.input_names), len(self.terms)
        driven = [
            Term.product([*term.expanded, Variable("u", n_inputs + m + 1, 0)]) for m, term in enumerate(self.terms)
        ]
        return replace(
            self.model,
            terms=tuple(driven),
            theta=np.ones(count),
            theta_cov=np.zeros((count, count)),
            input_names=self._driven_names,
            input_units=self.model.input_units + ("",) * count,
            input_origin=np.concatenate([self.model.input_origin, np.zeros(count)]),
        )

    @property
    def _driven_names(self) -> tuple[str, ...]:
        return self.model.input_names + tuple(f"theta{m}" for m in range(1, len(self.terms) + 1))

    def _with_theta(self, recording: Recording) -> Recording:
        """Return the recording with the parameters at its samples as further inputs."""
        first = self.model.table.max_lag
        chosen = self._nearest(recording.timepts[first:])
        theta = self.theta[:, np.concatenate([np.repeat(chosen[:1], recording.n_samples - chosen.size), chosen])]
        return replace(
            recording,
            inputs=np.concatenate([recording.inputs, theta]),
            input_names=self._driven_names,
            input_units=recording.input_units + ("",) * len(self.terms),
        )

    def _nearest(self, times: Array) -> NDArray[np.intp]:
        """Return the positions in ``timepts`` nearest to some times."""
        slack = 0.5 * self.model.sample_time
        if not np.all((times >= self.timepts[0] - slack) & (times <= self.timepts[-1] + slack)) or not times.size:
            asked = f"{times.min():g} s to {times.max():g} s" if times.size else "no time at all"
            raise ModelError(
                f"asked for {asked}; the parameters are known from {self.timepts[0]:g} s to {self.timepts[-1]:g} s"
            )
        after = np.clip(np.searchsorted(self.timepts, times), 1, max(self.timepts.size - 1, 1))
        if self.timepts.size == 1:
            return np.zeros(times.size, dtype=np.intp)
        return after - (times - self.timepts[after - 1] <= self.timepts[after] - times)


def _document(trajectory: ThetaTrajectory) -> dict[str, Any]:
    first, second = np.tril_indices(len(trajectory.terms))
    return {
        "schema": SCHEMA,
        "model": to_document(trajectory.model),
        "time_s": trajectory.timepts.tolist(),
        "theta": trajectory.theta.tolist(),
        "theta_cov_lower": trajectory.theta_cov[:, first, second].tolist(),
        "drift_variance": trajectory.drift_variance.tolist(),
        "log_likelihood": trajectory.log_likelihood,
    }


def _fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    model = NarxModel(**fields_of(document["model"]))
    m, n = len(model.terms), len(document["time_s"])
    lower = np.tril_indices(m)
    theta_cov = np.zeros((n, m, m))
    theta_cov[:, lower[0], lower[1]] = theta_cov[:, lower[1], lower[0]] = document["theta_cov_lower"]
    return {
        "model": model,
        "timepts": read_only(document["time_s"]),
        "theta": read_only(document["theta"]),
        "theta_cov": theta_cov,
        "drift_variance": read_only(document["drift_variance"]),
        "log_likelihood": None if document["log_likelihood"] is None else float(document["log_likelihood"]),
    }


def require_trajectory(given: object) -> None:
    """Raise ModelError for anything but a trajectory."""
    if not isinstance(given, ThetaTrajectory):
        raise ModelError(
            f"a {type(given).__name__} is not a ThetaTrajectory: give the trajectory_ of a fitted Rls or ThetaSmoother"
        )
