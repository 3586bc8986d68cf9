"""Operating point of a linear model, as saved in a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from deatwin.control.linear.model import LinearModel, LinearStatus


@dataclass(frozen=True, kw_only=True)
class OperatingPoint:
    """Operating point at which the model was linearised.

    Parameters
    ----------
    input : float
        Constant input, in its unit.
    output : float or None
        Output at rest, in its unit; None if the model does not settle.
    static_gain : float or None
        Static gain, output unit by input unit; None if the model does not settle.
    status : LinearStatus
        Status of the linear model; it tells if a controller could be designed there.
    sample_time : float
        Sampling time, s.
    input_unit, output_unit : str
        Units of input and output.
    """

    input: float
    output: float | None
    static_gain: float | None
    status: LinearStatus
    sample_time: float
    input_unit: str
    output_unit: str

    @classmethod
    def of(cls, linear: LinearModel) -> Self:
        """Describe the operating point of a linear model.

        Parameters
        ----------
        linear : LinearModel
            Linear model, of any status.
        """
        settles = linear.operating_output is not None
        return cls(
            input=linear.operating_input,
            output=linear.operating_output,
            static_gain=linear.static_gain if settles else None,
            status=linear.status,
            sample_time=linear.sample_time,
            input_unit=linear.input_unit,
            output_unit=linear.output_unit,
        )
