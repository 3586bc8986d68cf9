"""Time of an event, found by a plant that was fitted to the recordings before the event."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part, reading_times
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.naming.screen import EVENT_ERROR, Lead, LinearisedResponse, response, started
from deatwin.ident.mismatch.refit.search import approach
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant

VANISHING = 1e-6
"""Share of an effect's squared change below which what the parameters leave of it is rounding."""


def event_leads(
    unbiased: Plant, fit: Calibration, effects: Iterable[Effect], parts: Sequence[Part]
) -> tuple[Lead, ...]:
    """Return what events could explain, each at the time at which it explains most.

    A fit without an event is biased to meet it halfway: its residual may step elsewhere, or the other way. A plant that
    was fitted to the openings of the recordings only has mostly not seen it. From there all parameters are refitted to
    all samples to first order (those on a bound, too: it was a bound for the openings), with the event before each of
    them in turn.

    Parameters
    ----------
    unbiased : Plant
        Where the fit of the openings begins.
    fit : Calibration
        Of the same effects on all samples.
    effects : iterable of Effect
        Those that are no events, or are in the plant, are passed over.
    parts : sequence of Part
        Samples that count.

    Returns
    -------
    tuple of Lead
        None of an event with which the plant cannot be simulated, or that explains nothing beyond what `fit` does.
    """
    events = [effect for effect in effects if effect.event and effect.name not in fit.plant.effect_names]
    near = approach(unbiased, parts) if events else None
    if near is None or not near.status.ok:
        return ()
    problem = Problem(plant=near.plant, parts=tuple(parts), names=near.names)
    found = problem.evaluate(problem.start())
    if found is None:
        return ()
    times = reading_times(near.plant, parts)
    without, missing = readings_of_fit(parts, found[0]), float(np.sqrt(np.mean(found[0] ** 2)))
    early = (response(near.plant, parts, without, _from(effect, times), missing) for effect in events)
    seen = (event_lead(known, times, *found, fit.rms) for known in early if known is not None)
    return tuple(lead for lead in seen if lead is not None)


def event_lead(
    known: LinearisedResponse, times: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray, rms: float
) -> Lead | None:
    """An event that is there from a time on, at the one at which it explains most.

    Its change of the readings is taken for that of an event before all samples, but for those before the time: what
    sets in at once is met, what grows from then on is met roughly.

    Parameters
    ----------
    known : LinearisedResponse
        Of the event before all samples.
    times : ndarray, shape (m,)
        Clock times of the readings, in any order, s.
    residuals : ndarray, shape (m,)
        Measured minus simulated without the event, SI.
    jacobian : ndarray, shape (m, n)
        Derivative of what is simulated.
    rms : float
        Of what a fit without the event leaves, SI: the share that is explained is told of its square, and counts from
        that or from what is left to first order without the event, whichever is less.

    Returns
    -------
    Lead or None
        None where no time that the event may have explains anything beyond what the fit does.

    References
    ----------
    Andrews, Econometrica 61 (1993) 821, doi:10.2307/2951764: the score test over all times of a change.
    """
    strength, event = (known.effect.described(name) for name in (known.effect.strength, known.effect.event))
    order = np.argsort(times, kind="stable")
    clock, basis = times[order], tangent_basis(jacobian)
    along, own = beginning_at_each(known.change[order], residuals[order], basis[order])
    at = (clock[1:] + clock[:-1]) / 2
    margin = EVENT_ERROR * float(np.ptp(clock))
    first, last = max(event.lower, clock[0] + margin), min(event.upper, clock[-1] - margin)
    possible = (np.diff(clock) > 0.0) & (at > first) & (at < last) & (own[1:] > 0.0)
    sizes = np.divide(along[1:], own[1:], out=np.zeros_like(at), where=possible).clip(strength.lower, strength.upper)
    explained = np.where(possible, sizes * (2.0 * along[1:] - sizes * own[1:]), 0.0)
    if not explained.any():
        return None
    best = int(np.argmax(explained))
    without = float(np.mean(taken_off(residuals, basis) ** 2))
    left = without - float(explained[best]) / residuals.size
    share = (min(without, rms**2) - left) / rms**2
    if share <= 0.0:
        return None
    start, estimate = started(replace(known.effect, **{event.name: float(at[best])}), float(sizes[best]))
    return Lead(effect=start, share=share, estimate=estimate, left=left)


def beginning_at_each(change: np.ndarray, residual: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what the parameters leave of a change that begins at a sample, for each sample.

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
    along : ndarray, shape (m,)
        Its product with the residual.
    own : ndarray, shape (m,)
        Its square; 0 where it is rounding. With a strength s it explains 2 s along - s² own of the squared residual.
    """

    def from_each_on(terms: np.ndarray) -> np.ndarray:
        return np.cumsum(terms[::-1], axis=0)[::-1]

    taken = from_each_on(basis * change[:, None])
    length = from_each_on(change**2)
    own = length - np.sum(taken**2, axis=1)
    along = from_each_on(change * residual) - taken @ (basis.T @ residual)
    return along, np.where(own > VANISHING * length[0], own, 0.0)


def _from(effect: Effect, times: np.ndarray) -> Effect:
    """The event before all samples."""
    at = effect.described(effect.event)
    return replace(effect, **{effect.event: float(np.clip(times.min(), at.lower, at.upper))})
