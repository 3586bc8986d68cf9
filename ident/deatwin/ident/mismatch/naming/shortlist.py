"""Shortlist of the most promising effects, by two measures with different weaknesses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.fit import descend
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.naming.screen import Lead
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import ROUGH, opening
from deatwin.ident.mismatch.thresholds import MANY, SEVERAL
from deatwin.ident.parallel import run_jobs
from deatwin.plant.model import Plant

OPENING_SAMPLES, EVALUATIONS = 1500, 6
"""Number of samples, and largest number of simulations, of a rough fit."""


def shortlist(problem: DiagnosisProblem, start: Plant, found: Sequence[Lead]) -> tuple[Lead, ...]:
    """Choose effects to be fitted from all leads, which are ordered by their first-order score, the best first."""
    # The score misses an effect that the fitted plant imitates, as a biased damping imitates a lag of the voltage. A
    # rough fit of the opening of each experiment, from an unbiased start, finds such effects, but misses late and slow
    # ones.
    by_score, others = found[:MANY], found[MANY:]
    openings = [opening(part, OPENING_SAMPLES) for part in problem.fitted]
    sizes = run_jobs(_opens, [(start.with_effects(lead.effect), openings) for lead in others], workers=problem.jobs)
    order = sorted(range(len(others)), key=lambda k: sizes[k])
    return (*by_score, *(others[k] for k in order[:SEVERAL] if np.isfinite(sizes[k])))


def _opens(start: Plant, parts: Sequence[Part]) -> float:
    """Return the rms residual of a rough fit; infinite if the plant cannot be simulated."""
    fit = descend(start, parts, evaluations=EVALUATIONS, tolerance=ROUGH)
    return fit.rms if fit.status.ok else float(np.inf)
