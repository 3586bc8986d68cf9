"""A calibration in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.ident.greybox.fit import Calibration

ALIKE = 0.95
"""Correlation above which an interval is more than three times as long as it were if the other parameter was known."""


def described(fit: Calibration) -> str:
    """Return the outcome of a fit in a line, and each parameter in one more."""
    if not fit.status.ok:
        return fit.fault
    agree = f"; {fit.agreed} of {fit.starts} starts agree" if fit.starts > 1 else ""
    unit = f" {fit.plant.rig.output_unit}" if fit.plant.rig.output_unit not in ("", "1") else ""
    rows = [f"rms {fit.rms:.4g}{unit} after {fit.evaluations} simulations: {fit.status.value}{agree}"]
    for name in fit.names:
        parameter, (low, high) = fit.plant.parameters[name], fit.interval(name)
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        known = _range(parameter, low, high) if fit.is_determined(name) else "undetermined"
        bound = ", on a bound of its range" if name in fit.at_bound else ""
        other = "".join(f", or {values[fit.names.index(name)]:.6g}" for values in fit.equals)
        rows.append(f"  {name} = {parameter.value:.6g}{unit} ({known}{bound}){other}")
    if together := _together(fit):
        rows.append(f"  known together better than alone: {', '.join(together)}")
    return "\n".join(rows)


def _range(parameter: Parameter, low: float, high: float) -> str:
    """An interval in words; an end of the allowed range is none that the readings gave."""
    if low <= parameter.lower:
        return f"{high:.4g} or less"
    return f"{low:.4g} to {high:.4g}" if high < parameter.upper else f"{low:.4g} or more"


def _together(fit: Calibration) -> list[str]:
    """Pairs of parameters of which the one is known much better where the other is known."""
    deviations = np.sqrt(np.diag(fit.covariance))
    sizes = np.outer(deviations, deviations)
    alike = np.divide(fit.covariance, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    pairs = [(j, k) for j, k in zip(*np.triu_indices(len(fit.names), 1), strict=True) if abs(alike[j, k]) > ALIKE]
    return [f"{fit.names[j]} and {fit.names[k]} (correlation {alike[j, k]:.4f})" for j, k in pairs]
