"""Where a model was linearised, as a file holds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from deatwin.control.linear.model import LinearModel, LinearStatus


@dataclass(frozen=True, kw_only=True)
class OperatingPoint:
    """Where the model was linearised.

    Parameters
    ----------
    input : float
        In the input's unit.
    output : float or None
        Output at rest there, in its unit; None where the model does not settle.
    static_gain : float or None
        Output unit by input unit; None where the model does not settle.
    status : LinearStatus
        Whether a controller could be designed there.
    sample_time : float
        s.
    input_unit, output_unit : str
        Units.
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
        """Describe where a model was linearised.

        Parameters
        ----------
        linear : LinearModel
            Sound or not.

        Returns
        -------
        OperatingPoint
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
