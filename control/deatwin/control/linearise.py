"""A NARX model about an operating point, as the linear model that a controller is designed on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency import equilibrium, linear_part
from deatwin.ident.frequency.linear import LinearPart, operating_input_of
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError
from deatwin.plant.rigs.base import ReadingTime

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction

__all__ = ["LinearModel", "LinearStatus", "linearise", "linearise_posterior"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_SIGN_LEVEL = 1.96
"""A static gain within this many standard deviations of zero has no certain sign (95 %, normal law)."""


class LinearStatus(Enum):
    """Whether a controller can be designed on a linear model; the value is the advice."""

    OK = "the operating point is stable and the static gain has a certain sign"
    NO_EQUILIBRIUM = (
        "the model does not settle at this input: choose another operating input or identify again"
    )
    UNSTABLE = (
        "the operating point of the model is unstable: choose another operating input or identify again"
    )
    NO_GAIN = (
        "the static gain cannot be told from zero, so that no integral action can be chosen: "
        "record with a larger input about this operating point"
    )

    @property
    def ok(self) -> bool:
        """Whether a controller can be designed on it."""
        return self is LinearStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """Deviations about an operating point, ``G(z) = (b_0 + b_1 z^-1 + ...) / (1 + a_1 z^-1 + ...)``.

    Parameters
    ----------
    numerator : ndarray, shape (n_b,)
        b_0, b_1, ..., output unit by input unit.
    denominator : ndarray, shape (n_a + 1,)
        1, a_1, a_2, ...
    covariance : ndarray, shape (n_b + n_a, n_b + n_a)
        Of b_0, b_1, ..., a_1, a_2, ..., to first order; the equilibrium moves with the model's parameters.
    sample_time : float
        s.
    operating_input : float
        In the input's unit.
    operating_output : float or None
        Output at rest there, in its unit; None without an equilibrium.
    status : LinearStatus
        Whether a controller can be designed on it.
    detail : str
        What was found where the status is not sound, else empty.
    input_name, output_name, input_unit, output_unit : str
        Names and units of the signals.
    """

    numerator: Array
    denominator: Array
    covariance: Array
    sample_time: float
    operating_input: float
    operating_output: float | None
    status: LinearStatus = LinearStatus.OK
    detail: str = ""
    input_name: str = "input"
    output_name: str = "output"
    input_unit: str = ""
    output_unit: str = ""

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator", "covariance"):
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        size = self.numerator.size + self.denominator.size - 1
        if not self.sample_time > 0.0 or self.denominator[:1].tolist() != [1.0]:
            raise ModelError("a linear model needs a positive sample time and a denominator whose first is 1")
        if self.covariance.shape != (size, size):
            raise ModelError(f"the covariance has shape {self.covariance.shape}: it must be ({size}, {size})")

    def require(self) -> Self:
        """This model, if a controller can be designed on it.

        Returns
        -------
        LinearModel

        Raises
        ------
        ModelError
            With the advice, if not.
        """
        if self.status.ok:
            return self
        raise ModelError(f"{self.status.value}" + (f" ({self.detail})" if self.detail else ""))

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in the z plane, shape (n_a,)."""
        return np.asarray(np.roots(self.denominator), dtype=np.complex128)

    @property
    def static_gain(self) -> float:
        """G(1), output unit by input unit."""
        return float(self.numerator.sum() / self.denominator.sum())

    @property
    def static_gain_deviation(self) -> float:
        """Standard deviation of the static gain, output unit by input unit."""
        slopes = np.concatenate(
            [np.ones(self.numerator.size), np.full(self.denominator.size - 1, -self.static_gain)]
        )
        slopes /= self.denominator.sum()
        return float(np.sqrt(max(slopes @ self.covariance @ slopes, 0.0)))

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Frequency response.

        Parameters
        ----------
        omega : array_like, shape (n,)
            Angular frequencies, rad/s.

        Returns
        -------
        ndarray of complex, shape (n,)
            Output unit by input unit.
        """
        delay = np.exp(-1j * np.asarray(omega, dtype=np.float64) * self.sample_time)
        values = np.polyval(self.numerator[::-1], delay) / np.polyval(self.denominator[::-1], delay)
        return np.asarray(values, dtype=np.complex128)

    def step_response(self, count: int) -> Array:
        """Response to a unit step of the input.

        Parameters
        ----------
        count : int
            Number of samples.

        Returns
        -------
        ndarray, shape (count,)
            Output unit by input unit; the first sample is that in which the input steps.
        """
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.numerator, self.denominator, np.ones(count)), dtype=np.float64)

    def in_loop(self, reading: ReadingTime) -> LinearModel:
        """The model from a command to the readings that later commands can answer to.

        Where a row's reading is taken at the end of the row's hold, it can be answered by the next row's
        command only, so that the loop holds one sample of delay more than the rows of the recording show.

        Parameters
        ----------
        reading : ReadingTime
            When in its row a reading is taken.

        Returns
        -------
        LinearModel
            Whose first coefficient b_0 is zero.

        Raises
        ------
        ModelError
            If a reading at the start of the hold answers to the command that follows it.
        """
        if reading is ReadingTime.START_OF_HOLD:
            if self.numerator[0] != 0.0:
                raise ModelError(
                    "the model has the input lag 0, but the rig reads before it applies the row's command: "
                    "identify with input lags from 1 on"
                )
            return self
        covariance = np.pad(self.covariance, ((1, 0), (1, 0)))
        return replace(self, numerator=np.concatenate([[0.0], self.numerator]), covariance=covariance)

    def system(self) -> TransferFunction:
        """The transfer function as a discrete system of python-control.

        Returns
        -------
        control.TransferFunction
            With ``dt`` equal to the sample time.

        Raises
        ------
        ModelError
            If there is no equilibrium.
        """
        import control

        if self.operating_output is None:
            self.require()
        size = max(self.numerator.size, self.denominator.size)
        num, den = (np.pad(c, (0, size - c.size)) for c in (self.numerator, self.denominator))
        return control.tf(num, den, self.sample_time, inputs=[self.input_name], outputs=[self.output_name])

    def state_space(self) -> StateSpace:
        """A state-space realisation as a discrete system of python-control.

        Returns
        -------
        control.StateSpace
            With ``dt`` equal to the sample time.

        Raises
        ------
        ModelError
            If there is no equilibrium.
        """
        import control

        return control.ss(self.system())


def linearise(model: NarxModel, operating_input: float | None = None) -> LinearModel:
    """Linearise a model of one input and one output about its equilibrium at a constant input.

    Parameters
    ----------
    model : NarxModel
        In the rows of its recording: where a row's reading is taken is not its business (see
        `LinearModel.in_loop`).
    operating_input : float, optional
        Constant input in its unit; the centre of the training data by default.

    Returns
    -------
    LinearModel
        Its status says whether there is an equilibrium, and whether it is sound.

    Raises
    ------
    ModelError
        If the model has several inputs or the operating input is not finite.
    """
    if len(model.input_names) != 1:
        raise ModelError(f"the model has {len(model.input_names)} inputs; a controller is designed for one")
    point = float(operating_input_of(model, operating_input)[0])
    try:
        rest = equilibrium(model, point)
        part = linear_part(model, point, rest.output)
    except ModelError as error:
        return _without_equilibrium(model, point, str(error))
    linear = _of_part(model, part, point, rest.output)
    if not rest.is_stable:
        detail = f"largest pole {abs(linear.poles).max():.4g}"
        return replace(linear, status=LinearStatus.UNSTABLE, detail=detail)
    gain, deviation = linear.static_gain, linear.static_gain_deviation
    if gain == 0.0 or abs(gain) < _SIGN_LEVEL * deviation:
        detail = f"{gain:.3g} with a standard deviation of {deviation:.3g}"
        return replace(linear, status=LinearStatus.NO_GAIN, detail=detail)
    return linear


def linearise_posterior(
    model: NarxModel,
    operating_input: float | None,
    rng: np.random.Generator,
    count: int,
    progress: Progress | None = None,
) -> tuple[LinearModel, ...]:
    """Linearise samples of a model's posterior, each about its own equilibrium.

    Parameters
    ----------
    model : NarxModel
        With the covariance of its parameters (normal, or Student-t where ``theta_dof`` is finite).
    operating_input : float or None
        As for `linearise`.
    rng : numpy.random.Generator
        Source of the samples.
    count : int
        Number of samples.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    tuple of LinearModel
        Some may lack an equilibrium; their status says so.
    """
    samples = []
    for number, theta in enumerate(_draw(model, rng, count)):
        # The spread is in the samples themselves.
        sample = replace(model, theta=theta, theta_cov=np.zeros_like(model.theta_cov))
        samples.append(linearise(sample, operating_input))
        if progress is not None:
            progress((number + 1) / count)
    return tuple(samples)


def _draw(model: NarxModel, rng: np.random.Generator, count: int) -> Array:
    """Samples of the parameters, shape (count, n_terms)."""
    deviations = np.sqrt(np.diag(model.theta_cov))
    units = np.where(deviations > 0.0, deviations, 1.0)  # parameters differ by many orders of magnitude
    values, vectors = np.linalg.eigh(model.theta_cov / np.outer(units, units))
    spread = rng.standard_normal((count, units.size)) * np.sqrt(values.clip(min=0.0)) @ vectors.T * units
    if np.isfinite(model.theta_dof):
        spread *= np.sqrt((model.theta_dof - 2.0) / rng.chisquare(model.theta_dof, count))[:, None]
    return np.asarray(model.theta + spread, dtype=np.float64)


def _of_part(model: NarxModel, part: LinearPart, operating_input: float, output: float) -> LinearModel:
    n_b, n_a = int(part.input_lags.max(initial=0)) + 1, int(part.output_lags.max(initial=0))
    numerator, denominator = np.zeros(n_b), np.concatenate([[1.0], np.zeros(n_a)])
    slopes = np.zeros((n_b + n_a, model.theta.size))
    numerator[part.input_lags] = part.b
    slopes[part.input_lags] = part.b_theta
    denominator[part.output_lags] = -part.a
    slopes[n_b + part.output_lags - 1] = -part.a_theta
    return LinearModel(
        numerator=numerator, denominator=denominator, covariance=slopes @ model.theta_cov @ slopes.T,
        operating_output=output, **_signals(model, operating_input),
    )  # fmt: skip


def _without_equilibrium(model: NarxModel, operating_input: float, detail: str) -> LinearModel:
    return LinearModel(
        numerator=np.zeros(1), denominator=np.ones(1), covariance=np.zeros((1, 1)), operating_output=None,
        status=LinearStatus.NO_EQUILIBRIUM, detail=detail, **_signals(model, operating_input),
    )  # fmt: skip


def _signals(model: NarxModel, operating_input: float) -> dict[str, Any]:
    return {
        "sample_time": model.sample_time, "operating_input": operating_input,
        "input_name": model.input_names[0], "output_name": model.output_names[0],
        "input_unit": model.input_units[0], "output_unit": model.output_units[0],
    }  # fmt: skip
