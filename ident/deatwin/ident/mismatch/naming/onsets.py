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
from deatwin.ident.mismatch.thresholds import ACCURACY
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant


def event_leads(
    unbiased: Plant, fit: Calibration, effects: Iterable[Effect], parts: Sequence[Part]
) -> tuple[Lead, ...]:
    """Return the events that explain something beyond a fit, each at the time at which it explains most."""
    # A fit without an event is biased: its residual may jump at another time, or in the other direction. A plant that
    # was fitted to the openings of the recordings has mostly not seen the event. From there all parameters, also those
    # at a bound, are refitted to all samples to first order, with the event before each sample in turn.
    events = [effect for effect in effects if effect.event and effect.name not in fit.plant.effect_names]
    if not events:
        return ()
    near = approach(unbiased, parts)
    begun = [Problem(plant=plant, parts=tuple(parts), names=near.names) for plant in (near.plant, unbiased)]
    # The plant that was fitted to the openings may have no equilibrium later.
    plant, found = next(((p.plant, found) for p in begun if (found := p.evaluate(p.start()))), (unbiased, None))
    if found is None:
        return ()
    times = reading_times(plant, parts)
    without, missing = readings_of_fit(parts, found[0]), root_mean_square(found[0])
    early = (response(plant, parts, without, _from(effect, times), missing) for effect in events)
    seen = (event_lead(known, times, *found, fit.rms) for known in early if known is not None)
    return tuple(lead for lead in seen if lead is not None)


def event_lead(
    known: LinearisedResponse, times: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray, rms: float
) -> Lead | None:
    """Return an event at the time at which it explains most; None if it explains nothing beyond the fit at any time.

    `known` is the response to the event before all samples; `rms`, SI, is that of a fit without the event. Shapes:
    `times` (m,), in any order, s; `residuals` (m,), without the event, SI; `jacobian` (m, n).
    """
    # The response is set to zero before the event's time, which is exact for a sudden change and approximate for a
    # growing one. This is the score test over all times of a change (Andrews, Econometrica 61 (1993) 821,
    # doi:10.2307/2951764). The explained share is relative to the square of `rms`, and is counted from the smaller of
    # that square and the first-order residual without the event.
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

    Shapes: `change`, `residual` (m,); orthonormal `basis` (m, r); returns (m,) each: `along`, the product of that part
    with the residual, and `own`, its square, 0 if it is rounding. A strength s explains 2 s along - s² own of the
    squared residual.
    """

    def from_each_on(terms: np.ndarray) -> np.ndarray:
        return np.cumsum(terms[::-1], axis=0)[::-1]

    taken = from_each_on(basis * change[:, None])
    length = from_each_on(change**2)
    own = length - np.sum(taken**2, axis=1)
    along = from_each_on(change * residual) - taken @ (basis.T @ residual)
    return along, np.where(own > ACCURACY * length[0], own, 0.0)


def _from(effect: Effect, times: np.ndarray) -> Effect:
    """Return the event at a time before all samples."""
    at = effect.described(effect.event)
    return replace(effect, **{effect.event: float(np.clip(times.min(), at.lower, at.upper))})
