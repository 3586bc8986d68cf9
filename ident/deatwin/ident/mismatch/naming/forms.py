"""Effects in other forms of the plant: another reading of what the rig file leaves open costs less than physics."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.screen import footprints, leads
from deatwin.ident.mismatch.naming.sets import (
    BESIDE,
    CLEARLY_BETTER,
    Names,
    Search,
    each_without_one,
    trials_of,
)
from deatwin.ident.mismatch.naming.trial import Trial, with_fitted

__all__ = ["in_form", "with_fewer"]

AGAIN = 4
"""The best single effects of the nominal form, that are tried in a rival one."""


def in_form(search: Search, rival: Candidate, stage: Sequence[Names]) -> tuple[Search, list[Names]]:
    """A search in a rival form of the plant, begun with the best single effects of another one.

    Where that form leaves clearly less, what promises most there is tried as well.

    Parameters
    ----------
    search : Search
        In the nominal form.
    rival : Candidate
        The rival form without effects.
    stage : sequence of tuple of str
        Single effects of that search.

    Returns
    -------
    tuple of Search and list
        With the single effects that were tried there.
    """
    fit, known = rival.calibration, search.known
    unbent = search.bench.nominal.with_rig(fit.plant.rig)
    best = sorted(stage, key=lambda names: -search.tried[names].evidence)[:AGAIN]
    chosen = {name: search.leads[name] for names in best for name in names}
    if search.is_clearly_worse_than(rival):
        known = footprints(search.bench, fit, search.bench.effects, fit)
        chosen |= {lead.effect.name: lead for lead in leads(known, fit)[:BESIDE]}
    other = Search(search.bench, rival, known, search.fitted)
    other.leads = chosen
    found = other.attempt(trials_of(unbent, fit, chosen.values()), rival=search.least_rms(stage))
    other.judge_by_the_best(found)
    return other, found


def with_fewer(search: Search, naming: Naming, rivals: Sequence[Candidate]) -> tuple[Search, Naming]:
    """The search and its answer, or those in a rival form that needs one effect less, or has an answer at all.

    A reading that is taken a sample early is a delay beside any other effect, too. Where two effects leave too much,
    they may explain the recordings in a form that neither shows by itself.

    Parameters
    ----------
    search : Search
        With what was tried.
    naming : Naming
        Its decision.
    rivals : sequence of Candidate
        Other forms of the plant without effects.

    Returns
    -------
    tuple of Search and Naming
    """
    pair = search.best_of([names for names in search.tried if len(names) == 2])
    best = pair if naming.best is None else naming.best.effects
    if best is None or len(best) < 2:
        return search, naming
    limit = search.missing([best]) / CLEARLY_BETTER
    for rival in rivals:
        other = _without_one(search, best, rival)
        found = other.nearly()
        if naming.best is None:
            pairs = other.attempt([_trial(search, best, rival)], rival=search.tried[best].calibration.rms)
            found = other.decided_surely(pairs)
        if found.best is not None and other.missing([found.best.effects]) < limit:
            return other, found
    return search, naming


def _without_one(search: Search, full: Names, rival: Candidate) -> Search:
    """A search in a rival form, begun with all but one of the effects of a set that is known in another form."""
    other = Search(search.bench, rival, search.known, search.fitted)
    other.leads = {name: lead for name, lead in search.leads.items() if name in full}
    trials = [_trial(search, full, rival, names) for names in each_without_one(full)]
    other.judge_by_the_best(other.attempt(trials, rival=search.tried[full].calibration.rms))
    return other


def _trial(search: Search, full: Names, rival: Candidate, names: Names = ()) -> Trial:
    """Some effects of a set that is known in one form, or all, built into another one with their values."""
    plant, fit = search.plant_of(full, names or full), rival.calibration
    unbent = search.bench.nominal.with_rig(fit.plant.rig)
    return Trial(start=with_fitted(unbent, plant), bent=with_fitted(fit.plant, plant), without=fit)
