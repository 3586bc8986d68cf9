"""Convert linear systems of python-control to the linear models on which controllers are designed and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.control.arguments import finite, taking
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.realisation import Realisation
from deatwin.plant.arrays import Array

if TYPE_CHECKING:
    from control import LTI, StateSpace, TransferFunction


@taking(operating_input=finite, operating_output=finite)
def from_control(
    system: LTI,
    *,
    operating_input: float = 0.0,
    operating_output: float = 0.0,
    input_unit: str = "",
    output_unit: str = "",
) -> LinearModel:
    """Convert a discrete single-input, single-output system of python-control to a linear model without uncertainty.

    Parameters
    ----------
    system : control.TransferFunction or control.StateSpace
        Discrete system with its sampling time in s; the result of ``control.zpk`` is a transfer function.
    operating_input, operating_output : float
        Operating point, in the units of input and output. The signals of `system` are deviations from this point.
    input_unit, output_unit : str
        Units of the signals.

    Returns
    -------
    LinearModel
        Linear model with the system's signal names and zero covariance. The status says whether the model is stable and
        has a static gain. For a state-space system, poles, gain and responses are computed from the matrices, and
        unstable modes count even if the input does not excite them. `LinearModel.detail` says if the polynomial
        coefficients are inaccurate.

    Raises
    ------
    ControlError
        If the system is not a linear, discrete and proper system with one input, one output, a sampling time, and
        finite real coefficients.
    """
    import control

    if not isinstance(system, control.TransferFunction | control.StateSpace):
        raise ControlError(
            f"a {type(system).__name__} is not a transfer function or state space: give a tf, ss or zpk of "
            "python-control, of a nonlinear system what control.linearize makes of it"
        )
    if system.ninputs != 1 or system.noutputs != 1:
        raise ControlError(
            f"the system has {system.ninputs} inputs and {system.noutputs} outputs; a linear model has one of each: "
            "choose them, as system[0, 0]"
        )
    sample_time = _sample_time(system)
    matrices, detail = None, ""
    if isinstance(system, control.StateSpace):
        whole = _matrices(system)
        numerator, denominator = (_trimmed(c) for c in whole.coefficients())
        if whole.c.size:
            matrices, detail = whole, whole.remark_on(numerator, denominator, sample_time, "the system")
    else:
        numerator, denominator = _of_fraction(system)
    size = numerator.size + denominator.size - 1
    linear = LinearModel(
        numerator=numerator,
        denominator=denominator,
        covariance=np.zeros((size, size)),
        sample_time=sample_time,
        operating_input=operating_input,
        operating_output=operating_output,
        input_name=system.input_labels[0],
        output_name=system.output_labels[0],
        input_unit=input_unit,
        output_unit=output_unit,
        detail=detail,
        realisation=matrices,
    )
    return linear.judged(bool((np.abs(linear.poles) < 1.0).all()))


def _sample_time(system: LTI) -> float:
    if system.dt is True:
        raise ControlError("the system has no sample time (dt = True); give it in s, as control.tf(num, den, 0.02)")
    if not system.dt:
        raise ControlError(
            "the system is continuous; sample it first, as system.sample(0.02), with the sample time of the rig"
        )
    return float(system.dt)


def _of_fraction(system: TransferFunction) -> tuple[Array, Array]:
    """Return coefficients in powers of z^-1 from coefficients in falling powers of z."""
    top, bottom = (_leading(part[0][0]) for part in (system.num, system.den))
    if top.size > bottom.size:
        raise ControlError(
            f"the transfer function is improper: its numerator is of degree {top.size - 1}, its denominator of degree "
            f"{bottom.size - 1}; a sampled system cannot know the future"
        )
    top = np.concatenate([np.zeros(bottom.size - top.size), top])
    return _trimmed(top / bottom[0]), _trimmed(bottom / bottom[0])


def _matrices(system: StateSpace) -> Realisation:
    a, b, c, d = (_finite(getattr(system, name)) for name in "ABCD")
    return Realisation(a=a, b=b, c=c[0], d=d[0])


def _leading(coefficients: Any) -> Array:
    """Strip leading zeros."""
    values = _finite(coefficients)
    return np.asarray(values[np.argmax(values != 0.0) :] if values.any() else values[-1:], dtype=np.float64)


def _trimmed(coefficients: Array) -> Array:
    """Strip trailing zeros: poles and zeros at z = 0 that cancel or have no effect."""
    return coefficients[: max(np.flatnonzero(coefficients), default=0) + 1]


def _finite(values: Any) -> Array:
    given = np.asarray(values)
    if np.iscomplexobj(given) or not np.isfinite(given).all():
        raise ControlError("every coefficient of the system must be a finite real number")
    return np.asarray(given, dtype=np.float64)
