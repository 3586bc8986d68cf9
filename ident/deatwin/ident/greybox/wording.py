"""Fitted parameters in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.plant.parameters import Parameter

ALIKE = 0.95
"""Correlation above which an interval is more than three times as long as it would be if the other parameter were
known."""


def described(parameter: Parameter, interval: tuple[float, float] | None, others: Sequence[float], bound: str) -> str:
    """Describe a parameter in one line: its interval, or None if undetermined, and other equally good values."""
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    known = "undetermined" if interval is None else _range(parameter, *interval)
    other = "".join(f", or {value:.6g}" for value in others)
    return f"{parameter.name} = {parameter.value:.6g}{unit} ({known}{bound}){other}"


def _range(parameter: Parameter, low: float, high: float) -> str:
    """Write an interval in words; an end of the allowed range does not come from the readings."""
    if low <= parameter.lower:
        return f"{high:.4g} or less"
    return f"{low:.4g} to {high:.4g}" if high < parameter.upper else f"{low:.4g} or more"


def known_together(names: tuple[str, ...], covariance: np.ndarray) -> list[str]:
    """Return pairs of parameters of which one is known much better if the other is known; (n, n)."""
    deviations = np.sqrt(np.diag(covariance))
    sizes = np.outer(deviations, deviations)
    alike = np.divide(covariance, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    pairs = [(j, k) for j, k in zip(*np.triu_indices(len(names), 1), strict=True) if abs(alike[j, k]) > ALIKE]
    return [f"{names[j]} and {names[k]} (correlation {alike[j, k]:.4f})" for j, k in pairs]
