"""Time of an event, found with a plant that was fitted to the openings of the recordings."""

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
"""Share of an effect's squared response below which the part that parameters cannot imitate is rounding."""


def event_leads(
    unbiased: Plant, fit: Calibration, effects: Iterable[Effect], parts: Sequence[Part]
) -> tuple[Lead, ...]:
    """Return what events could explain, each at the time at which it explains most.

    A fit without an event is biased: its residual may jump at another time, or in the other direction. A plant that was
    fitted to the openings of the recordings has mostly not seen the event. From there all parameters, also those at a
    bound, are refitted to all samples to first order, with the event before each sample in turn.

    Parameters
    ----------
    unbiased : Plant
        Start of the fit of the openings.
    fit : Calibration
        Fit of the same effects to all samples.
    effects : iterable of Effect
        Effects to try; those without an event, or already in the plant, are ignored.
    parts : sequence of Part
        Samples that count.

    Returns
    -------
    tuple of Lead
        Without events that cannot be simulated or explain nothing beyond `fit`.
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
    """Return an event at the time at which it explains most.

    Its response is that of an event before all samples, set to zero before its time. That is exact for a sudden change,
    and rough for one that grows.

    Parameters
    ----------
    known : LinearisedResponse
        Response to the event before all samples.
    times : ndarray, shape (m,)
        Clock times of the readings, in any order, s.
    residuals : ndarray, shape (m,)
        Measured minus simulated without the event, SI.
    jacobian : ndarray, shape (m, n)
        Derivative of what is simulated.
    rms : float
        Rms residual of a fit without the event, SI. The explained share refers to its square, and is counted from the
        smaller of it and the first-order residual without the event.

    Returns
    -------
    Lead or None
        None if no possible time explains anything beyond the fit.

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
    """Return, for each sample, the part of a change beginning there that parameters cannot imitate.

    Cumulative sums give all samples in one pass.

    Parameters
    ----------
    change : ndarray, shape (m,)
        Change of the readings per unit of strength, present from the first sample.
    residual : ndarray, shape (m,)
        Residual to explain.
    basis : ndarray, shape (m, r)
        Orthonormal directions that parameters can imitate.

    Returns
    -------
    along : ndarray, shape (m,)
        Product of that part with the residual.
    own : ndarray, shape (m,)
        Square of that part; 0 if it is rounding. With a strength s it explains 2 s along - s² own of the squared residual.
    """

    def from_each_on(terms: np.ndarray) -> np.ndarray:
        return np.cumsum(terms[::-1], axis=0)[::-1]

    taken = from_each_on(basis * change[:, None])
    length = from_each_on(change**2)
    own = length - np.sum(taken**2, axis=1)
    along = from_each_on(change * residual) - taken @ (basis.T @ residual)
    return along, np.where(own > VANISHING * length[0], own, 0.0)


def _from(effect: Effect, times: np.ndarray) -> Effect:
    """Return the event at a time before all samples."""
    at = effect.described(effect.event)
    return replace(effect, **{effect.event: float(np.clip(times.min(), at.lower, at.upper))})
