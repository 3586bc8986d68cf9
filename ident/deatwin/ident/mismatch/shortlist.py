"""Which effects are worth a fit to all data: those that promise most, on two counts that err in different ways."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.screen import Lead
from deatwin.ident.mismatch.search import approach
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant

__all__ = ["shortlist"]

BY_SCORE, BY_OPENING = 6, 5
"""How many effects are taken for what they explain to first order, and for how well they open."""


def shortlist(bench: Bench, start: Plant, found: Sequence[Lead]) -> tuple[Effect, ...]:
    """Choose effects to be fitted.

    What an effect explains to first order is blind where the fitted plant was bent far to imitate it, as a lag of
    the voltage bends the damping. A rough fit of the opening of each experiment sees that, but is blind to what
    comes late or slowly.

    Parameters
    ----------
    bench : Bench
        Recordings.
    start : Plant
        Not bent: where fits begin.
    found : sequence of Lead
        All effects, the most promising to first order first.

    Returns
    -------
    tuple of Effect
        Each with the shape and strength to start from.
    """
    tasks = [(start.with_effects(lead.effect), bench.fitted) for lead in found]
    openings = run_jobs(approach, tasks, workers=bench.jobs)
    opened = [(fit.rms, lead.effect) for fit, lead in zip(openings, found, strict=True) if fit.status.ok]
    best = [effect for _, effect in sorted(opened, key=lambda pair: pair[0])[:BY_OPENING]]
    chosen = {effect.name: effect for effect in (*(lead.effect for lead in found[:BY_SCORE]), *best)}
    return tuple(chosen.values())
