"""Excitation signals: commands in V, shape (n,), that are held between samples."""

from deatwin.plant.excitation.multisine import odd_harmonics, random_odd_harmonics, random_phase_multisine
from deatwin.plant.excitation.noise import band_limited_noise, share_above_band
from deatwin.plant.excitation.rearranged import with_alternating_polarity
from deatwin.plant.excitation.steps import random_holds, staircase, triangles
from deatwin.plant.excitation.sweeps import linear_chirp, logarithmic_chirp

__all__ = [
    "band_limited_noise",
    "linear_chirp",
    "logarithmic_chirp",
    "odd_harmonics",
    "random_holds",
    "random_odd_harmonics",
    "random_phase_multisine",
    "share_above_band",
    "staircase",
    "triangles",
    "with_alternating_polarity",
]
