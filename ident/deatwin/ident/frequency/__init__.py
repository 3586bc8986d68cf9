"""NARX models in the frequency domain: equilibria, removal of the operating point, frequency responses."""

from deatwin.ident.frequency.dc import Equilibrium, equilibrium, remove_dc
from deatwin.ident.frequency.gfrf import Band, FrequencyResponse, FrequencyStatus, gfrf
from deatwin.ident.frequency.linear import LinearPart, linear_part

__all__ = [
    "Band",
    "Equilibrium",
    "FrequencyResponse",
    "FrequencyStatus",
    "LinearPart",
    "equilibrium",
    "gfrf",
    "linear_part",
    "remove_dc",
]
