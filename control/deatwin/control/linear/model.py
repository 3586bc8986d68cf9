"""A linear model about an operating point, on which controllers are designed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import finite, instance, number, numbers, positive, require_fields, taking, whole
from deatwin.control.errors import ControlError
from deatwin.control.linear.realisation import Realisation
from deatwin.ident.arguments import keep_read_only
from deatwin.ident.narx.covariance import covariance_of
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, gain_unit, status_of, variable
from deatwin.plant.errors import ModelError
from deatwin.plant.rigs.base import ReadingTime, require_reading_time

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction


SIGN_LEVEL = 1.96  # Static gain, in standard deviations, from which its sign is certain (95 %, normal law)


class LinearStatus(Enum):
    """Outcome of the check whether a controller can be designed on a linear model.

    The value of each member is a message for the user.
    """

    OK = "the operating point is stable and the sign of the static gain is certain"
    NO_EQUILIBRIUM = "the model does not settle at this input: choose another operating input or identify again"
    UNSTABLE = "the operating point of the model is unstable: choose another operating input or identify again"
    NO_GAIN = (
        "the static gain cannot be distinguished from zero, so no integral action can be chosen: record with a larger "
        "input at this operating point"
    )
    INACCURATE = (
        "the static gain of the linear model differs from the slope of the static curve, because of rounding errors; "
        "leave slow effects out, or choose another operating input"
    )

    @property
    def ok(self) -> bool:
        """True if a controller can be designed on the model."""
        return self is LinearStatus.OK


_text = instance(str)


def _covariance(values: Array, n_b: int) -> Array:
    """Return the covariance of b_0, b_1, ..., a_1, a_2, ..., made exactly symmetric."""
    if not np.isfinite(values).all():
        raise ModelError("the covariance of a linear model must be finite")
    names = [f"b_{i}" if i < n_b else f"a_{i - n_b + 1}" for i in range(len(values))]
    return covariance_of(values, names, "this is not a covariance of a linear model")


def _coefficients(model: LinearModel) -> list[str]:
    return [f"b_{k}" for k in range(model.numerator.size)] + [f"a_{k}" for k in range(1, model.denominator.size)]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel(Described):
    """Linear model about an operating point, ``G(z) = (b_0 + b_1 z^-1 + ...) / (1 + a_1 z^-1 + ...)``.

    The transfer function G relates the deviation of the output from its value at rest to the deviation of the input
    from the operating input.

    Parameters
    ----------
    numerator : ndarray, shape (n_b,)
        Coefficients b_0, b_1, ..., output unit per input unit.
    denominator : ndarray, shape (n_a + 1,)
        Coefficients 1, a_1, a_2, ...
    covariance : ndarray, shape (n_b + n_a, n_b + n_a)
        First-order covariance of b_0, b_1, ..., a_1, a_2, ..., including the effect of the uncertain equilibrium. It
        must be symmetric and positive semidefinite up to rounding. Ignored if there is no equilibrium.
    sample_time : float
        Sampling time, s.
    operating_input : float
        Constant input, in its unit.
    operating_output : float or None
        Output at rest, in its unit; None if there is no equilibrium.
    status : LinearStatus
        Status, which states whether a controller can be designed on the model.
    detail : str
        Explanation if the status is not OK or the coefficients are inaccurate, otherwise empty.
    input_name, output_name, input_unit, output_unit : str
        Names and units of the signals.
    realisation : Realisation, optional
        State-space matrices. If they are given, poles, gain and responses are computed from the matrices, which have
        smaller rounding errors than the coefficients. The covariance must then be zero.

    Raises
    ------
    ControlError
        If a field has the wrong type, or the operating point of a model with status OK is not finite.
    ModelError
        If the coefficients are not finite or have the wrong shape, or the covariance is invalid.
    """

    numerator: Array = field(metadata=variable("b", unit=gain_unit, about="coefficients of z^0, z^-1, ..."))
    denominator: Array = field(metadata=variable("a", about="coefficients of z^0, z^-1, ..."))
    covariance: Array = field(metadata=variable("coefficient", "other_coefficient"))
    sample_time: float = field(metadata=attribute())
    operating_input: float = field(metadata=attribute())
    operating_output: float | None = field(metadata=attribute())
    status: LinearStatus = field(default=LinearStatus.OK, metadata=status_of())
    detail: str = field(default="", metadata=attribute())
    input_name: str = field(default="input", metadata=attribute())
    output_name: str = field(default="output", metadata=attribute())
    input_unit: str = field(default="", metadata=attribute())
    output_unit: str = field(default="", metadata=attribute())
    realisation: Realisation | None = None

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        **{name: coordinate(name, of=_coefficients) for name in ("coefficient", "other_coefficient")}
    }

    def __post_init__(self) -> None:
        require_fields(
            self,
            numerator=numbers,
            denominator=numbers,
            covariance=numbers,
            sample_time=positive,
            operating_input=number,
            status=instance(LinearStatus),
            detail=_text,
            input_name=_text,
            output_name=_text,
            input_unit=_text,
            output_unit=_text,
        )
        if self.operating_output is not None:
            number(self.operating_output, "operating_output")
        if self.status.ok:
            require_fields(self, operating_input=finite, operating_output=finite)
        keep_read_only(self, "numerator", "denominator", "covariance")
        size = self.numerator.size + self.denominator.size - 1
        if self.numerator.ndim != 1 or self.denominator.ndim != 1 or self.denominator[:1].tolist() != [1.0]:
            raise ModelError("a linear model needs lists of coefficients, and a denominator whose first is 1")
        if not (np.isfinite(self.numerator).all() and np.isfinite(self.denominator).all()):
            raise ModelError("the coefficients of a linear model must be finite")
        if self.covariance.shape != (size, size):
            raise ModelError(f"the covariance has shape {self.covariance.shape}: it must be ({size}, {size})")
        if self.realisation is not None:
            require_fields(self, realisation=instance(Realisation))
            if self.covariance.any():
                raise ModelError("a linear model that is given by its matrices has no covariance of coefficients")
        if self.status is not LinearStatus.NO_EQUILIBRIUM:
            object.__setattr__(self, "covariance", _covariance(self.covariance, self.numerator.size))

    @classmethod
    def without_equilibrium(cls, detail: str, **signals: Any) -> Self:
        """Return a placeholder for an operating point without equilibrium.

        Parameters
        ----------
        detail : str
            Explanation of the failure.
        **signals
            Sampling time, operating input, names and units, by field name.

        Returns
        -------
        LinearModel
            Model without dynamics, gain or operating output.
        """
        return cls(
            numerator=np.zeros(1),
            denominator=np.ones(1),
            covariance=np.zeros((1, 1)),
            operating_output=None,
            status=LinearStatus.NO_EQUILIBRIUM,
            detail=detail,
            **signals,
        )

    def judged(self, is_stable: bool, least_gain: float = 0.0) -> Self:
        """Return this model with the status that follows from stability and static gain.

        Parameters
        ----------
        is_stable : bool
            True if the equilibrium is stable, including modes that the input does not excite.
        least_gain : float
            Largest static gain that may be mere rounding error, output unit per input unit.
        """
        if not is_stable:
            detail = f"largest pole {abs(self.poles).max(initial=0.0):.4g}"
            return replace(self, status=LinearStatus.UNSTABLE, detail=detail)
        gain, deviation = self.static_gain, self.static_gain_deviation
        if abs(gain) <= least_gain or abs(gain) < SIGN_LEVEL * deviation:
            detail = f"{gain:.3g} with a standard deviation of {deviation:.3g}"
            return replace(self, status=LinearStatus.NO_GAIN, detail=detail)
        return self

    def require(self) -> Self:
        """Return this model if its status is OK; otherwise raise ModelError with the status as text."""
        if self.status.ok:
            return self
        raise ModelError(f"{self.status.value}" + (f" ({self.detail})" if self.detail else ""))

    def require_in_loop(self) -> Self:
        """Return this model if b_0 is zero, as in a control loop; otherwise raise ControlError."""
        if self.require().numerator[0] != 0.0:
            raise ControlError(
                "the model responds to a command in the same sample: design on the model with the delay of the loop, "
                "linear.in_loop(rig.reading)"
            )
        return self

    @property
    def rest_output(self) -> float:
        """Return the output at rest at the operating point, in its unit; ModelError if there is no equilibrium."""
        if self.operating_output is None:
            raise ModelError(self.status.value + (f" ({self.detail})" if self.detail else ""))
        return self.operating_output

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in the z plane, shape (n_a,)."""
        if self.realisation is not None:
            return self.realisation.modes
        return np.asarray(np.roots(self.denominator), dtype=np.complex128)

    @cached_property
    def zeros(self) -> NDArray[np.complex128]:
        """Finite zeros in the z plane, shape (n_zeros,)."""
        if self.realisation is not None:
            return self.realisation.zeros
        return np.asarray(np.roots(np.trim_zeros(self.numerator, "f")), dtype=np.complex128)

    @property
    def mean_delay(self) -> float:
        """Mean time of the impulse response, s: the sum of all delays and lags, minus the leads."""
        if self.realisation is not None:
            return self.realisation.mean_delay * self.sample_time
        top, bottom = self.numerator, self.denominator
        steps = np.arange(top.size) @ top / top.sum() - np.arange(bottom.size) @ bottom / bottom.sum()
        return float(steps * self.sample_time)

    @property
    def static_gain(self) -> float:
        """G(1), output unit per input unit; infinite if the model integrates."""
        if self.realisation is not None:
            return self.realisation.static_gain
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(self.numerator.sum() / self.denominator.sum())

    @property
    def static_gain_deviation(self) -> float:
        """Standard deviation of the static gain, output unit per input unit."""
        if self.realisation is not None:
            return 0.0
        slopes = np.concatenate([np.ones(self.numerator.size), np.full(self.denominator.size - 1, -self.static_gain)])
        slopes /= self.denominator.sum()
        return float(np.sqrt(max(slopes @ self.covariance @ slopes, 0.0)))

    @taking(omega=numbers)
    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response at `omega` (n,) in rad/s, output unit per input unit."""
        delay = np.exp(-1j * np.asarray(omega, dtype=np.float64) * self.sample_time)
        if self.realisation is not None:
            return self.realisation.response(delay.ravel()).reshape(delay.shape)
        values = np.polyval(self.numerator[::-1], delay) / np.polyval(self.denominator[::-1], delay)
        return np.asarray(values, dtype=np.complex128)

    @taking(count=whole(0))
    def step_response(self, count: int) -> Array:
        """Return `count` samples of the response to a unit step at the first sample, output unit per input unit."""
        from scipy.signal import lfilter

        if self.realisation is not None:
            return self.realisation.step_response(count)
        return np.asarray(lfilter(self.numerator, self.denominator, np.ones(count)), dtype=np.float64)

    def in_loop(self, reading: ReadingTime) -> LinearModel:
        """Return the model from the command to the readings, with the delay that a control loop has.

        A row of a recording holds a command and a reading. If the reading is taken at the end of the hold, only the
        command of the next row can react to the reading. The loop then has one more sample of delay than the model.

        Parameters
        ----------
        reading : ReadingTime
            Instant within a sample at which the reading is taken.

        Returns
        -------
        LinearModel
            Model whose first coefficient b_0 is zero.

        Raises
        ------
        ModelError
            If `reading` is not a `ReadingTime`, or if it is the start of the hold although the output depends on the
            command of the same sample.
        """
        require_reading_time(reading, ModelError)
        if reading is ReadingTime.START_OF_HOLD:
            if self.numerator[0] != 0.0:
                raise ModelError(
                    "the model has the input lag 0, but the rig takes each reading before it applies the command of the same row: "
                    "identify with input lags from 1 on"
                )
            return self
        covariance = np.pad(self.covariance, ((1, 0), (1, 0)))
        late = None if self.realisation is None else self.realisation.delayed()
        return replace(self, numerator=np.concatenate([[0.0], self.numerator]), covariance=covariance, realisation=late)

    def system(self) -> TransferFunction:
        """Return the transfer function as a discrete system of python-control.

        If the model has several slow modes, the coefficients are inaccurate, and `detail` says so. Then use
        `state_space`.

        Returns
        -------
        control.TransferFunction
            Transfer function with ``dt`` equal to the sampling time.

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
        """Return a state space of python-control with ``dt`` in s; ModelError if there is no equilibrium."""
        import control

        if self.realisation is None:
            return control.ss(self.system())
        self.rest_output  # noqa: B018  (raises without an equilibrium)
        a, b, c, d = self.realisation.joined()
        return control.ss(
            a, b[:, None], c[None, :], d, self.sample_time, inputs=[self.input_name], outputs=[self.output_name]
        )


linear_model = instance(LinearModel, hint=", as linearise(model, operating_input) makes it")
"""Check that an argument is a linear model and not, for example, a model that is not linearised."""
