"""How far each mechanism reaches at the largest size that somebody would still use: measured, not judged."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["REACH", "VISIBLE", "reach"]

VISIBLE = 0.3
"""Structural residual over noise from which on a mechanism counts as visible: the lowest rung of the ladder."""
REACH: Mapping[str, float] = MappingProxyType({})


def reach(mechanism: str) -> float:
    """The largest ratio of structural residual and noise that a mechanism was seen to reach.

    Parameters
    ----------
    mechanism : str
        A concealed mechanism.

    Returns
    -------
    float
        Infinite where it was not measured.
    """
    return REACH.get(mechanism, float("inf"))
