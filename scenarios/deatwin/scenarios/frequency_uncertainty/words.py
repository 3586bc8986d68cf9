"""Orders and bands in words."""

from __future__ import annotations

__all__ = ["band_of", "column_of"]


def band_of(low: float, high: float) -> str:
    """A band of frequencies.

    Parameters
    ----------
    low, high : float
        Its edges, Hz.
    """
    return f"{low:g}–{high:g} Hz"


def column_of(column: tuple[int, float, float]) -> str:
    """An order and a band.

    Parameters
    ----------
    column : tuple
        Order, and edges of the band, Hz.
    """
    order, low, high = column
    return f"H{'₁₂₃'[order - 1]}, {band_of(low, high)}"
