"""Responses over a band whose value and scatter are given."""

import numpy as np

from deatwin.ident.frequency.comparison.bands import BandMean, Scatter


def mean(value: complex, variance: float = 0.0, gain: float = 2.0) -> BandMean:
    """A response over a band, known with a circular normal law."""
    return BandMean(
        order=1,
        from_Hz=0.0,
        to_Hz=0.1,
        value=np.array([value.real, value.imag]),
        gradient=np.zeros((2, 1)),
        scatter=Scatter(scale=variance * np.eye(2), dof=np.inf),
        gain=gain,
        unit="m/V",
    )
