"""What the effects of an explanation do to the readings by themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.fit import Calibration, simulated
from deatwin.ident.mismatch.bench import Bench

__all__ = ["contribution"]


def contribution(bench: Bench, explanation: Calibration, added: Sequence[str]) -> np.ndarray:
    """What added effects do to the readings of the plant that was fitted with them.

    Parameters
    ----------
    bench : Bench
        Recordings.
    explanation : Calibration
        With the effects, on the fitted part.
    added : sequence of str
        Their names.

    Returns
    -------
    ndarray, shape (m,)
        Readings with the effects less those without, no parameter changed, SI; infinite where the plant fails without
        them.
    """
    if not added:
        return np.zeros_like(explanation.residuals)
    without = simulated(explanation.plant.without_effects(*added), [part.until_last() for part in bench.fitted])
    if without is None:
        return np.full_like(explanation.residuals, np.inf)
    return np.concatenate([part.measured for part in bench.fitted]) - explanation.residuals - without
