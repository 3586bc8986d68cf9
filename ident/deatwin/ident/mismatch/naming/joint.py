"""Which pairs of effects promise most together, though neither may do so alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from deatwin.ident.greybox.tangent import linearised_rms
from deatwin.ident.mismatch.naming.screen import leads, most_promising
from deatwin.ident.mismatch.naming.trial import NEAR, Trial, trials_of, unbent_like

if TYPE_CHECKING:
    from deatwin.ident.mismatch.naming.sets import Search


FIRST = 3
"""So many of the pairs that were not tried and promise most are."""


def joint_trials(search: Search) -> list[Trial]:
    """Trials of the pairs that promise most of all in which one effect was tried alone.

    A step from the best single effect to a second one beside it misses two that work against each other: either alone
    explains little, and what explains more may imitate both. What a second effect could explain of what each single one
    leaves, to first order, costs no simulation, but for when an event came.

    Parameters
    ----------
    search : Search
        In which single effects were tried.

    Returns
    -------
    list of Trial
        Of pairs that were not tried the most promising, the first one first, as far as they promise nearly as much as
        the best possible pair that was tried has kept.
    """
    given = frozenset(search.bench.nominal.effect_names)
    tried = {frozenset(names) | given for names in search.tried}
    kept = [names for names, c in search.tried.items() if len(names) == 2 and search.is_possible(c)]
    least = (NEAR * search.least_rms(kept)) ** 2
    promising: dict[frozenset[str], Trial] = {}
    for left, trial in sorted(_of_all(search), key=lambda found: found[0]):
        names = frozenset(trial.start.effect_names)
        if left < least and names not in tried:
            promising.setdefault(names, trial)
    return list(promising.values())[:FIRST]


def _of_all(search: Search) -> Iterator[tuple[float, Trial]]:
    """Each trial with the mean square that it leaves to first order, wherever its parameters had to go for that.

    Many single fits were given up before their minimum, and what their own parameters would still take is not to be
    had by a second effect. An event is seen from another plant, all of whose parameters may move: what it leaves there
    counts no more than what its share takes off here.
    """
    singles = [names for names in search.tried if len(names) == 1]
    for names, events in zip(singles, search.event_leads(*singles), strict=True):
        fit = search.tried[names].calibration
        free = [f for f in search.known() if f.effect.name not in fit.plant.effect_names]
        found = most_promising(leads(free, fit), events)
        alone = linearised_rms(fit.residuals, fit.movable) ** 2
        for lead, trial in zip(found, trials_of(unbent_like(search.bench, fit.plant), fit, found), strict=True):
            yield max(lead.left, alone - lead.share * fit.rms**2), trial
