"""The residual of one record, and what may go with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["SI", "Track", "Unit"]

Unit = tuple[str, float]
"""Name of a unit, and its SI size."""
SI: Unit = ("SI", 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The residual of one record and the signals that may go with it.

    Parameters
    ----------
    timepts : ndarray, shape (n,)
        On the running clock, s.
    residual : ndarray, shape (n,)
        Measured minus simulated, SI.
    signals : mapping of str to ndarray, each of shape (n,)
        Operating signals, in the units in which they are reported.
    sample_time : float
        s.
    """

    timepts: np.ndarray
    residual: np.ndarray
    signals: Mapping[str, np.ndarray]
    sample_time: float
