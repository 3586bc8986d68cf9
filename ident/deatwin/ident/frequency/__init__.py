"""NARX models in the frequency domain: equilibria, removal of the operating point, frequency responses."""

from deatwin.ident.frequency.dc import Equilibrium, equilibrium, remove_dc
from deatwin.ident.frequency.gfrf import frequency_grid, gfrf
from deatwin.ident.frequency.linear import LinearPart, linear_part
from deatwin.ident.frequency.response import Band, FrequencyResponse, FrequencyStatus
from deatwin.ident.frequency.spectrum import output_orders, output_spectrum

__all__ = [
    "Band",
    "Equilibrium",
    "FrequencyResponse",
    "FrequencyStatus",
    "LinearPart",
    "equilibrium",
    "frequency_grid",
    "gfrf",
    "linear_part",
    "output_orders",
    "output_spectrum",
    "remove_dc",
]
