"""Contribution of the effects of an explanation to the readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part, level_of, simulated
from deatwin.ident.mismatch.problem import DiagnosisProblem


def contribution(problem: DiagnosisProblem, explanation: Calibration, added: Sequence[str]) -> np.ndarray:
    """Return the change of the readings due to the added effects, (m,), over the noise level, at unchanged parameters.

    In SI; infinite if the plant cannot be simulated without the effects.
    """
    if not added:
        return np.zeros_like(explanation.residuals)
    without = simulated(explanation.plant.without_effects(*added), problem.fitted)
    if without is None:
        return np.full_like(explanation.residuals, np.inf)
    return (readings_of_fit(problem.fitted, explanation.residuals) - without) / level_of(problem.fitted)


def readings_of_fit(parts: Sequence[Part], residuals: np.ndarray) -> np.ndarray:
    """Return the simulated readings that belong to residuals over the noise level. Shapes: (n,) both, SI."""
    return np.concatenate([part.measured for part in parts]) - residuals * level_of(parts)
