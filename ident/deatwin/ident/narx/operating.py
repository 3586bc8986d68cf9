"""Range and centre of the data on which a model was trained."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from deatwin.ident.arguments import real_numbers
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Rebuilt


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingRange(Rebuilt):
    """Range of the signals in a model's training data.

    Parameters
    ----------
    input_min, input_max : ndarray, shape (n_inputs,)
        Smallest and largest value of each input, in its unit.
    input_centre : ndarray, shape (n_inputs,)
        Mean of each input, in its unit; 0 if the model's signals are deviations from an operating point.
    output_min, output_max : ndarray, shape (n_outputs,)
        Smallest and largest value of each output, in its unit.
    output_centre : ndarray, shape (n_outputs,)
        Mean of each output, in its unit; 0 if the model's signals are deviations from an operating point.
    """

    input_min: Array
    input_max: Array
    input_centre: Array
    output_min: Array
    output_max: Array
    output_centre: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, np.atleast_1d(real_numbers(getattr(self, item.name), item.name)))

    def shifted(self, operating_input: Array, operating_output: Array) -> OperatingRange:
        """Return the range of the deviations from `operating_input` (n_inputs,) and `operating_output` (1,)."""
        return OperatingRange(
            input_min=self.input_min - operating_input,
            input_max=self.input_max - operating_input,
            input_centre=np.zeros_like(self.input_centre),
            output_min=self.output_min - operating_output,
            output_max=self.output_max - operating_output,
            output_centre=np.zeros_like(self.output_centre),
        )
