"""Shortlist: the effects that promise most, by two measures that err in different ways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.fit import descend
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.naming.screen import Lead
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import ROUGH, opening
from deatwin.ident.parallel import run_jobs
from deatwin.plant.model import Plant

BY_SCORE, BY_OPENING = 6, 4
"""Number of effects chosen by what they explain to first order, and of others by their place."""
OPENING_SAMPLES, EVALUATIONS = 1500, 6
"""A rough fit of so few samples, with so few simulations, tells a good beginning from a bad one."""


def shortlist(problem: DiagnosisProblem, start: Plant, found: Sequence[Lead]) -> tuple[Lead, ...]:
    """Choose effects to be fitted.

    What an effect explains to first order is blind where the fitted plant was biased far to imitate it, as a lag of
    the voltage bends the damping. A rough fit of the opening of each experiment sees that, but is blind to what
    comes late or slowly.

    Parameters
    ----------
    problem : DiagnosisProblem
        Recordings.
    start : Plant
        Not biased: where fits begin.
    found : sequence of Lead
        All effects, the most promising to first order first.

    Returns
    -------
    tuple of Lead
        The chosen ones.
    """
    by_score, others = found[:BY_SCORE], found[BY_SCORE:]
    openings = [opening(part, OPENING_SAMPLES) for part in problem.fitted]
    sizes = run_jobs(_opens, [(start.with_effects(lead.effect), openings) for lead in others], workers=problem.jobs)
    order = sorted(range(len(others)), key=lambda k: sizes[k])
    return (*by_score, *(others[k] for k in order[:BY_OPENING] if np.isfinite(sizes[k])))


def _opens(start: Plant, parts: Sequence[Part]) -> float:
    """Rms of what a rough fit leaves; infinite where the plant cannot be simulated."""
    fit = descend(start, parts, evaluations=EVALUATIONS, tolerance=ROUGH)
    return fit.rms if fit.status.ok else float(np.inf)
