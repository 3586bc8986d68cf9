"""Describing functions of a command's limits and of a converter's codes (Gelb & Vander Velde, Multiple-Input Describing
Functions and Nonlinear System Design, 1968, appendix B).
"""

from __future__ import annotations

import numpy as np

from deatwin.plant.arrays import Array, Complex


def saturation(limit: float, amplitude: Array) -> Complex:
    """Return N of a saturation, with a gain of one up to a limit. Shapes: returns that of `amplitude`."""
    x = np.minimum(limit / amplitude, 1.0)
    return np.asarray(2.0 / np.pi * (np.arcsin(x) + x * np.sqrt(1.0 - x**2)), dtype=np.complex128)


def quantiser(step: float, amplitude: Array) -> Complex:
    """Return N of rounding to multiples of a step, shaped as `amplitude`: a relay of one step at each edge."""
    ratio = np.asarray(amplitude / step)[..., None]
    edges = np.arange(np.floor(ratio.max() + 0.5)) + 0.5
    gain = np.sum(np.sqrt(np.maximum(1.0 - (edges / ratio) ** 2, 0.0)), axis=-1)
    return np.asarray(4.0 / (np.pi * ratio[..., 0]) * gain, dtype=np.complex128)
