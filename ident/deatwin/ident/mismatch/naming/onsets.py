"""When an event came, as a plant shows it that was not yet bent by it: fitted to the openings of the recordings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.naming.screen import Lead, footprint
from deatwin.ident.mismatch.refit.search import approach
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant

__all__ = ["event_leads", "explained_from", "most_promising"]

VANISHING = 1e-6
"""Share of an effect's squared change below which what the parameters leave of it is rounding."""


def event_leads(unbent: Plant, fit: Calibration, effects: Iterable[Effect], parts: Sequence[Part]) -> tuple[Lead, ...]:
    """What events could explain, each at the time at which it explains most.

    A fit without an event is bent to meet it halfway: its residual may step elsewhere, or the other way. A plant that
    was fitted to the openings of the recordings only has mostly not seen it. From there all parameters are refitted to
    all samples to first order, with the event before each of them in turn.

    Parameters
    ----------
    unbent : Plant
        Where the fit of the openings begins.
    fit : Calibration
        Of the same effects on all samples: what events explain is told as a share of what that leaves, and counts from
        the lesser of that and what is left to first order without the event.
    effects : iterable of Effect
        Those that are no events, or are in the plant, are passed over.
    parts : sequence of Part
        Samples that count.

    Returns
    -------
    tuple of Lead
        None of an event with which the plant cannot be simulated, or that explains nothing.

    References
    ----------
    Andrews, Econometrica 61 (1993) 821, doi:10.2307/2951764: the score test over all times of a change.
    """
    events = [effect for effect in effects if effect.event and effect.name not in fit.plant.effect_names]
    near = approach(unbent, parts) if events else None
    if near is None or not near.status.ok:
        return ()
    problem = Problem(plant=near.plant, parts=tuple(parts), names=near.names)
    found = problem.evaluate(problem.start())
    if found is None:
        return ()
    seen = (_lead(effect, near.plant, fit, parts, *found) for effect in events)
    return tuple(lead for lead in seen if lead is not None)


def _lead(
    effect: Effect, plant: Plant, fit: Calibration, parts: Sequence[Part], residuals: np.ndarray, jacobian: np.ndarray
) -> Lead | None:
    described = {parameter.name: parameter for parameter in effect.describe()}
    strength, event = described[effect.strength], described[effect.event]
    times = np.concatenate([part.timepts for part in parts])
    early = replace(effect, **{effect.event: float(np.clip(times.min(), event.lower, event.upper))})
    known = footprint(plant, parts, readings_of_fit(parts, residuals), early)
    if known is None:
        return None
    order = np.argsort(times, kind="stable")
    basis = tangent_basis(jacobian)
    explained, size = explained_from(known.change[order], residuals[order], basis[order])
    ats = (times[order][1:] + times[order][:-1]) / 2
    possible = (strength.lower < 0.0) | (size[1:] > 0.0)
    possible &= (ats > event.lower) & (ats < event.upper) & (np.diff(times[order]) > 0.0)
    explained = np.where(possible, explained[1:], 0.0)
    best = int(np.argmax(explained))
    left = float(np.sum(taken_off(residuals, basis) ** 2))
    of = float(np.sum(fit.residuals**2))
    share = float((min(left, of) - (left - explained[best])) / of)
    if share <= 0.0:
        return None
    at, sized = {effect.event: float(ats[best])}, float(np.clip(size[1:][best], strength.lower, strength.upper))
    return Lead(
        effect=replace(effect, **at, **{effect.strength: float(np.copysign(strength.value, sized))}),
        share=share,
        estimate=replace(effect, **at, **{effect.strength: sized}),
    )


def explained_from(change: np.ndarray, residual: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a change explains that begins at a sample, for each sample.

    Sums over the samples from each one on make it one pass for all.

    Parameters
    ----------
    change : ndarray, shape (m,)
        Of the readings per unit of strength, had it been there all the time.
    residual : ndarray, shape (m,)
        To be explained.
    basis : ndarray, shape (m, r)
        Directions that parameters take up, orthonormal.

    Returns
    -------
    explained : ndarray, shape (m,)
        Of the squared residual, beyond what the parameters explain.
    strength : ndarray, shape (m,)
        At which it does.
    """

    def from_each_on(terms: np.ndarray) -> np.ndarray:
        return np.cumsum(terms[::-1], axis=0)[::-1]

    taken = from_each_on(basis * change[:, None])
    length = from_each_on(change**2)
    own = length - np.sum(taken**2, axis=1)
    along = from_each_on(change * residual) - taken @ (basis.T @ residual)
    acts = own > VANISHING * length[0]
    strength = np.divide(along, own, out=np.zeros_like(along), where=acts)
    return strength * along, strength


def most_promising(*several: Iterable[Lead]) -> tuple[Lead, ...]:
    """Of each effect the lead that promises most, in the order of their shares.

    Parameters
    ----------
    *several : iterable of Lead
        Of the same fit.

    Returns
    -------
    tuple of Lead
    """
    best: dict[str, Lead] = {}
    for lead in (lead for found in several for lead in found):
        if lead.effect.name not in best or lead.share > best[lead.effect.name].share:
            best[lead.effect.name] = lead
    return tuple(sorted(best.values(), key=lambda lead: -lead.share))
