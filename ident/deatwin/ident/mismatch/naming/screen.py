"""Screening: what each effect could explain to first order in its strength, from a few simulations of each shape."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part, first_only, level_of, motion_of, reading_times, simulated
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import ACCURACY, ROUNDING, TINY
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect, Place, require_effects
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Scale

SHAPES = 3
"""Number of values of each shape parameter at which an effect is screened."""
SHAPE_RANGE = (1 / 8, 8.0)
"""Range of these values, relative to the typical value."""
LEVELS = (0.5, 0.75, 0.9, 0.98)
"""Quantiles of the readings, or of the voltage, at which an effect with a threshold is screened."""
EVENT_STEP = 0.04
"""First step of the search for the time of an event, as a share of the record."""
EVENT_ERROR = 0.004
"""Last step of that search, as a share of the record. A fit begins at the time found; afterwards the time is searched
again."""
WEAKER = (1.0, 0.2, 0.02)
"""Shares of the typical strength that are tried until the plant can be simulated."""
TOO_MUCH = 2.0
"""Ratio to the residual above which an effect's change of the readings is too large: the effect is simulated again, at
a smaller strength, until the change is within this ratio."""
LOOKS = 3
"""Largest number of these further simulations of an effect."""
SEEN = 1e3 * ACCURACY
"""Smallest change at which these simulations aim, as a share of the motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearisedResponse:
    """Change that an effect causes in the readings of the base plant, per unit of the effect's strength.

    Parameters
    ----------
    effect : Effect
        Effect with the values of all its parameters. Its strength is the typical one, or a smaller one if the plant
        cannot be simulated at the typical strength.
    change : ndarray, shape (m,)
        Change of the readings at the fitted samples, divided by the strength, SI. If the typical strength changes the
        readings by much more than the mismatch, the change is computed at a smaller strength, because some effects are
        not proportional to their strength.
    """

    effect: Effect
    change: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Lead:
    """An effect with values from which a fit should start."""

    # effect with its most promising shape and sign, at its typical strength or one that can be simulated
    effect: Effect
    share: float  # share of the squared residual that the effect could explain to first order
    estimate: Effect  # effect at the strength at which it explains this share
    # Mean square that remains with the effect, SI, if it was estimated in another plant than that of the fit; else 0
    left: float = 0.0


@checks_its_arguments
def linearised_responses(
    problem: DiagnosisProblem,
    base: Calibration,
    effects: Sequence[Effect],
    fit: Calibration,
    finished: Callable[[int], None] | None = None,
) -> tuple[LinearisedResponse, ...]:
    """Compute the linearised response of each effect in the base plant, for several values of its parameters.

    Parameters
    ----------
    problem : DiagnosisProblem
        Fitted data and number of worker processes.
    base : Calibration
        Calibration of the base plant on the fitted data.
    effects : sequence of Effect
        Effects whose responses are computed.
    fit : Calibration
        Calibration whose residual is to be explained. The starting values of event times, periods and resonance
        frequencies are found from this residual.
    finished : callable, optional
        Called with the number of finished effects.

    Returns
    -------
    tuple of LinearisedResponse
        Responses in the order of `effects`, several for each effect. Parameter values with which the plant cannot be
        simulated are omitted.
    """
    jobs = [(base, effect, problem.fitted, fit) for effect in require_effects(effects)]
    found = run_jobs(_of_effect, jobs, workers=problem.jobs, finished=finished)
    return tuple(itertools.chain.from_iterable(found))


def by_effect(responses: Iterable[LinearisedResponse]) -> dict[str, list[LinearisedResponse]]:
    """Return the responses of each effect, by its name."""
    found: dict[str, list[LinearisedResponse]] = {}
    for one in responses:
        found.setdefault(one.effect.name, []).append(one)
    return found


def sought_in(fit: Calibration, effects: Iterable[Effect], parts: Sequence[Part]) -> list[Effect]:
    """Return the effects whose shapes are sought in a fit's residual, as the lines of a periodic one are."""
    times = reading_times(fit.plant, first_only(parts))
    return [effect for effect in effects if effect.starts(times, fit.residuals[: times.size])]


def leads(known: Sequence[LinearisedResponse], fit: Calibration) -> tuple[Lead, ...]:
    """Order effects by what they could explain of a fit's residual, one lead for each, the most promising first."""
    # Each response is projected off the Jacobian of the fit, because the plant's parameters imitate what they can.
    # Parameters on a bound imitate nothing: the missing physics has driven them there. The effect could explain the
    # residual's share along the remainder (Rao's score test, Proc. Camb. Phil. Soc. 44 (1948) 50,
    # doi:10.1017/S0305004100023987). The strength starts at its typical size, if the plant can be simulated with it,
    # because the fitted plant has already absorbed part of the effect.
    basis = tangent_basis(fit.movable)
    return most_promising(_lead(response, fit.residuals, basis) for response in known)


def most_promising(*several: Iterable[Lead]) -> tuple[Lead, ...]:
    """Return the most promising lead of each effect, in the order of their shares."""
    best: dict[str, Lead] = {}
    for lead in itertools.chain(*several):
        if lead.effect.name not in best or lead.share > best[lead.effect.name].share:
            best[lead.effect.name] = lead
    return tuple(sorted(best.values(), key=lambda lead: -lead.share))


def response(
    plant: Plant, parts: Sequence[Part], without: np.ndarray, effect: Effect, missing: float
) -> LinearisedResponse | None:
    """Return the response of an effect at its typical strength or a weaker one; None if none of them can be simulated.

    `without`, (m,), are the plant's readings without the effect, SI. The strength is such that the effect changes them
    by about as much as is `missing`, rms with noise, SI, or it is the typical strength if that changes them less.
    """

    def does(strength: float) -> np.ndarray | None:
        built = plant.with_effects(replace(effect, **{effect.strength: strength}))
        readings = simulated(built, parts)
        return None if readings is None else (readings - without) / level_of(parts)

    typical = abs(effect.described(effect.strength).value)
    wanted = max(missing, SEEN * motion_of(parts, without))
    for strength in (share * typical for share in WEAKER):
        change = does(strength)
        if change is not None:
            start = replace(effect, **{effect.strength: strength})
            return LinearisedResponse(effect=start, change=_of_a_size(does, strength, change, wanted))
    return None


def _of_a_size(
    does: Callable[[float], np.ndarray | None], strength: float, change: np.ndarray, wanted: float
) -> np.ndarray:
    """Return the change per unit of strength, shape (m,), at a strength with an rms change of at most about `wanted`."""
    off, enough = _off(change, wanted), np.log(TOO_MUCH)
    most, nearest = strength, (off, change / strength)
    for _ in range(LOOKS if off > enough else 0):
        # If the change is too small, go back towards the last strength at which it was too large.
        most = strength if off > 0.0 else most
        strength = strength * np.exp(-off) if off > 0.0 else np.sqrt(strength * most)
        weaker = does(float(strength))
        if weaker is None:
            break
        off = _off(weaker, wanted)
        nearest = min(nearest, (abs(off), weaker / strength), key=lambda looked: looked[0])
        if abs(off) <= enough:
            break
    return nearest[1]


def _off(change: np.ndarray, wanted: float) -> float:
    """Return the logarithm of the ratio of a change's rms to the `wanted` one."""
    return float(np.log(max(np.sqrt(np.mean(change**2)), TINY) / max(wanted, TINY)))


def _lead(known: LinearisedResponse, residual: np.ndarray, basis: np.ndarray) -> Lead:
    direction = taken_off(known.change, basis)
    length = float(np.linalg.norm(direction))
    along = float(direction @ residual) / length if length > ROUNDING * np.linalg.norm(known.change) else 0.0
    if along < 0.0 and known.effect.described(known.effect.strength).lower >= 0.0:
        return Lead(effect=known.effect, share=0.0, estimate=known.effect)
    start, estimate = started(known.effect, along / length if along else 0.0)
    return Lead(effect=start, share=along**2 / max(float(residual @ residual), TINY), estimate=estimate)


def started(effect: Effect, strength: float) -> tuple[Effect, Effect]:
    """Return an effect at its own strength, signed as `strength`, for a distant fit, and at `strength` for a near one."""
    known = effect.described(effect.strength)
    values = (np.copysign(known.value, strength), strength)
    start, estimate = (
        replace(effect, **{known.name: float(np.clip(value, known.lower, known.upper))}) for value in values
    )
    return start, estimate


def _of_effect(base: Calibration, effect: Effect, parts: Sequence[Part], fit: Calibration) -> list[LinearisedResponse]:
    """Return the response for each shape at which the plant can be simulated."""
    without = readings_of_fit(parts, base.residuals)
    times = reading_times(base.plant, parts)
    simulate = partial(response, base.plant, parts, without, missing=fit.rms)
    first = sum(part.size for part in first_only(parts))
    shapes = effect.starts(times[:first], fit.residuals[:first]) or shapes_of(effect, base.plant, parts)
    found = [f for f in map(simulate, shapes) if f is not None]
    return [_at_its_time(found, fit, times, simulate)] if effect.event and found else found


def _at_its_time(
    found: Sequence[LinearisedResponse],
    fit: Calibration,
    times: np.ndarray,
    simulate: Callable[[Effect], LinearisedResponse | None],
) -> LinearisedResponse:
    """Return the event at the time at which it explains most; a fit cannot move it, as few samples depend on its time."""
    basis, event = tangent_basis(fit.movable), found[0].effect.event
    known = found[0].effect.described(event)
    first, last = known.lower, known.upper
    best = max(found, key=lambda f: _lead(f, fit.residuals, basis).share)
    step, near = (share * float(np.ptp(times)) for share in (EVENT_STEP, EVENT_ERROR))
    seen = [getattr(best.effect, event)]
    while step > max(near, fit.plant.rig.sample_time / 2):
        at = getattr(best.effect, event)
        new = [t for t in (at - step, at + step) if first < t < last and np.abs(np.subtract(seen, t)).min() > near / 2]
        seen += new
        tried = [simulate(replace(best.effect, **{event: t})) for t in new]
        better = max([best, *(f for f in tried if f is not None)], key=lambda f: _lead(f, fit.residuals, basis).share)
        step, best = (step, better) if better is not best else (step / 2, best)
    return best


def shapes_of(effect: Effect, plant: Plant, parts: Sequence[Part]) -> list[Effect]:
    """Return the effect on a grid of its shape parameters, within their ranges and around their typical values."""
    grids = []
    for parameter in effect.describe():
        if parameter.name == effect.strength:
            continue
        if parameter.name == effect.threshold:
            values = np.quantile(_levels(effect, plant, parts), LEVELS)
        elif parameter.scale is Scale.LOGARITHMIC:
            values = parameter.value * np.geomspace(*SHAPE_RANGE, SHAPES)
        else:
            values = np.array([parameter.value])
        within = np.unique(np.clip(values, parameter.lower, parameter.upper))
        grids.append([(parameter.name, float(v)) for v in within])
    return [replace(effect, **dict(combination)) for combination in itertools.product(*grids)]


def _levels(effect: Effect, plant: Plant, parts: Sequence[Part]) -> np.ndarray:
    """Return the signal with which an effect's threshold is compared, in the fitted data, SI."""
    if effect.place is not Place.DRIVE:
        return np.abs(np.concatenate([part.measured for part in first_only(parts)]))
    parameters = plant.parameters
    gain = parameters["gain"].value if "gain" in parameters else 1.0
    return gain * np.abs(np.concatenate([part.commands for part in parts]))
