"""Orders and bands in words."""

from __future__ import annotations


def band_of(low: float, high: float) -> str:
    """A band of frequencies. `low, high` its edges, Hz."""
    return f"{low:g}–{high:g} Hz"


def column_of(column: tuple[int, float, float]) -> str:
    """An order and a band. `column` order, and edges of the band, Hz."""
    order, low, high = column
    return f"H{'₁₂₃'[order - 1]}, {band_of(low, high)}"
