"""NARX models in the frequency domain: equilibria, removal of the operating point, frequency responses."""

from deatwin.ident.frequency.dc import Equilibrium, equilibrium, remove_dc
from deatwin.ident.frequency.direct import direct_output
from deatwin.ident.frequency.drawing import bode
from deatwin.ident.frequency.gfrf import frequency_grid, gfrf
from deatwin.ident.frequency.linear import LinearPart, linear_part
from deatwin.ident.frequency.maps import plot_slices, plot_surface, slice_of
from deatwin.ident.frequency.response import Band, FrequencyResponse, FrequencyStatus
from deatwin.ident.frequency.spectrum import output_orders, output_spectrum

__all__ = [
    "Band",
    "Equilibrium",
    "FrequencyResponse",
    "FrequencyStatus",
    "LinearPart",
    "bode",
    "direct_output",
    "equilibrium",
    "frequency_grid",
    "gfrf",
    "linear_part",
    "output_orders",
    "output_spectrum",
    "plot_slices",
    "plot_surface",
    "remove_dc",
    "slice_of",
]
