"""NARX models in the frequency domain: GFRFs, NOFRFs, their variation in time, their uncertainty, their comparison."""

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison, Difference, Drift, compare
from deatwin.ident.frequency.comparison.records import compare_records
from deatwin.ident.frequency.dc import Equilibrium, equilibrium, remove_dc
from deatwin.ident.frequency.drawing import bode
from deatwin.ident.frequency.gfrf import frequency_grid, gfrf
from deatwin.ident.frequency.linear import LinearPart, linear_part
from deatwin.ident.frequency.output_responses.estimate import nofrf, nofrf_exact
from deatwin.ident.frequency.output_responses.excitation import TestSignal, design_excitation
from deatwin.ident.frequency.output_responses.powers import InputSpectrum, input_spectrum, output_frequencies
from deatwin.ident.frequency.output_responses.result import Nofrf, NofrfStatus, NofrfWarning
from deatwin.ident.frequency.response import Band, FrequencyResponse, FrequencyStatus
from deatwin.ident.frequency.spectrum import output_orders, output_spectrum
from deatwin.ident.frequency.uncertainty.beside_draws import Sampled, SampleStatus, sample
from deatwin.ident.frequency.uncertainty.propagate import Propagated, UncertaintyStatus, UncertaintyWarning, propagate
from deatwin.ident.frequency.varying.along_time import tv_gfrf, tv_nofrf
from deatwin.ident.frequency.varying.following import hold_equilibrium
from deatwin.ident.frequency.varying.response import VaryingResponse, VaryingStatus
from deatwin.ident.frequency.varying.sliding import SlidingStatistics, SlidingStatus, sliding_mean_and_gain

__all__ = [
    "Agreement",
    "Band",
    "Comparison",
    "Difference",
    "Drift",
    "Equilibrium",
    "FrequencyResponse",
    "FrequencyStatus",
    "InputSpectrum",
    "LinearPart",
    "Nofrf",
    "NofrfStatus",
    "NofrfWarning",
    "Propagated",
    "SampleStatus",
    "Sampled",
    "SlidingStatistics",
    "SlidingStatus",
    "TestSignal",
    "UncertaintyStatus",
    "UncertaintyWarning",
    "VaryingResponse",
    "VaryingStatus",
    "bode",
    "compare",
    "compare_records",
    "design_excitation",
    "equilibrium",
    "frequency_grid",
    "gfrf",
    "hold_equilibrium",
    "input_spectrum",
    "linear_part",
    "nofrf",
    "nofrf_exact",
    "output_frequencies",
    "output_orders",
    "output_spectrum",
    "propagate",
    "remove_dc",
    "sample",
    "sliding_mean_and_gain",
    "tv_gfrf",
    "tv_nofrf",
]
