"""Where no effect explains a mismatch: a free form of what is missing, which stands for no physics.

What enters the plant is sought as a sum of a few functions of its states and its input, with and without memory. They
are compared in the readings, after the plant has answered to each of them, beside what the plant's parameters can take
up: a smoothed force lacks what the filter has smoothed away, and holds what the calibration did not bend to imitate.
Those that the recordings choose again and again are built into the plant, which is fitted anew as a whole. A free form
is kept only if the free run on the unseen part gains by it; it is never a cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.greybox.filter import Floor, Latent, Linear, Opening, linearise, open_place, smoothed
from deatwin.ident.greybox.fit import Calibration, Part, Problem, calibrate, simulated
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.candidate import Candidate, free_run_residuals
from deatwin.ident.mismatch.dictionary import POSITION, RATE, dictionary, evaluated, signals_along
from deatwin.ident.mismatch.discovery import Discovery, FoundTerm, unit_of, unit_per
from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain
from deatwin.ident.mismatch.sparse import Stable, stable_terms
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.primitives import Power, Primitive
from deatwin.plant.errors import ModelError, SimulationError
from deatwin.plant.model import Plant

__all__ = ["Discovery", "FoundTerm", "discover"]

Array = NDArray[np.float64]

LEAST_GAIN = 0.1
"""Share by which the error on the unseen part must fall."""
PREFERRED = (("ball", "force"), ("sensor", "reading"), ("drive", "command"))
"""Where a free form enters if nobody says, the first that the rig has."""
STEPS = (1.0, 0.5, 0.25, 0.1)
"""Shares of the linear prediction from which the fit may start."""
EVALUATIONS, TOLERANCE = 20, 1e-3


def discover(
    bench: Bench, base: Candidate, rng: np.random.Generator, *, place: Opening | None = None
) -> Discovery | None:
    """Look for a free form of what the base plant lacks.

    Parameters
    ----------
    bench : Bench
        Recordings.
    base : Candidate
        The plant that leaves a mismatch.
    rng : numpy.random.Generator
        Source of all resampling.
    place : Opening, optional
        Where it enters; the force on what moves by default, where the rig has one, else the reading.

    Returns
    -------
    Discovery or None
        None where the plant leaves no mismatch, where no term is stable, or where the error on the unseen part does
        not fall by a tenth, and certainly.
    """
    plant = base.calibration.plant
    site = _site(plant, place)
    if site is None or not base.mismatch:
        return None
    try:
        linears = linearise(plant, bench.fitted)
    except SimulationError:
        return None
    search = _Search.of(plant, bench.fitted, linears, site)
    jacobian, residual = base.calibration.jacobian, base.calibration.residuals
    stable = stable_terms(search.columns, residual, jacobian, rng)
    # If all of them together gain nothing, perhaps the most stable one does.
    for some in dict.fromkeys((stable, stable[:1])):
        fit = _fitted(search, some, base, bench) if some else None
        found = None if fit is None else _judged(fit, base, bench, rng)
        if found is not None:
            fitted, unseen, gain_low = found
            return _discovery(fitted, unseen, gain_low, some, site, base, bench)
    return None


@dataclass(frozen=True, kw_only=True)
class _Site:
    """Where a free form may enter, and of what it can be a function."""

    opening: Opening
    position: str
    unit: str

    def free_form(self, terms: Sequence[Primitive], size: float, coefficients: Sequence[float]) -> FreeForm:
        return FreeForm(
            size=size, terms=tuple(terms), coefficients=tuple(coefficients), enters=Place(self.opening.place),
            node=self.opening.signal, unit=self.unit,
        )  # fmt: skip


def _site(plant: Plant, wanted: Opening | None) -> _Site | None:
    """The first place that the rig offers; where nothing is watched that moves, the reading is what moves."""
    preferred = [Opening(place=place, signal=signal) for place, signal in PREFERRED]
    names = {place.value for place in Place}
    watched = plant.equations.signals
    for opening in ([wanted] if wanted is not None else []) + preferred:
        position = POSITION if POSITION in watched else "reading"
        if opening.place not in names:
            continue
        site = _Site(opening=opening, position=position, unit=_unit_at(opening, plant))
        probe = [Power(variable=position, scale=1.0)]
        if {POSITION, RATE} <= set(watched):
            probe.append(Power(variable=RATE, scale=1.0))
        if plant.accepts(site.free_form(probe, 1.0, [0.0] * len(probe))):
            return site
    return None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Search:
    """Functions, and what the readings that count answer to each at a site."""

    site: _Site
    terms: tuple[Primitive, ...]
    columns: Array

    @classmethod
    def of(cls, plant: Plant, parts: Sequence[Part], linears: Sequence[Linear], site: _Site) -> _Search:
        along = [signals_along(plant, part, site.position) for part in parts]
        terms = dictionary(along, site.position)
        number = linears[0].openings.index(site.opening)
        answers = [
            linear.response(number, evaluated(terms, signals, linear.interval))[linear.counted]
            for linear, signals in zip(linears, along, strict=True)
        ]
        return cls(site=site, terms=terms, columns=np.vstack(answers))


def _fitted(search: _Search, stable: Sequence[Stable], base: Candidate, bench: Bench) -> Calibration | None:
    """The plant with the terms, fitted as a whole; None where that does not fit better than without."""
    plain = base.calibration
    columns = search.columns[:, [s.column for s in stable]]
    both = np.hstack([plain.jacobian, columns])
    scale = np.maximum(np.linalg.norm(both, axis=0), 1e-300)
    moves = np.linalg.lstsq(both / scale, plain.residuals, rcond=1e-8)[0] / scale
    shifts, coefficients = np.split(moves, [plain.jacobian.shape[1]])
    size = float(np.abs(coefficients).max())
    if not size > 0:
        return None
    problem = Problem(plant=plain.plant, parts=tuple(bench.fitted), names=plain.names)
    lower, upper = problem.bounds()
    terms = [search.terms[s.column] for s in stable]
    starts = []
    for share in STEPS:
        moved = problem.values(np.clip(problem.start() + share * shifts, lower, upper))
        form = search.site.free_form(terms, size, share * coefficients / size)
        starts.append(plain.plant.with_values(moved).with_effects(form))
    rms = [_rms_on(start, bench.fitted) for start in starts]
    best = int(np.argmin(rms))
    if not rms[best] < plain.rms:
        return None
    fit = calibrate(starts[best], bench.fitted, evaluations=EVALUATIONS, tolerance=TOLERANCE)
    return fit if fit.status.ok and fit.rms < plain.rms else None


def _rms_on(plant: Plant, parts: Sequence[Part]) -> float:
    readings = simulated(plant, parts)
    if readings is None:
        return float(np.inf)
    return float(np.sqrt(np.mean((np.concatenate([part.measured for part in parts]) - readings) ** 2)))


def _judged(
    fit: Calibration, base: Candidate, bench: Bench, rng: np.random.Generator
) -> tuple[Calibration, Array, float] | None:
    """The fit, its residuals on the unseen part and the lower bound of its gain; None where that is not enough."""
    unseen = free_run_residuals(fit.plant, bench.unseen)
    if unseen is None:
        return None
    before, after = (float(np.sqrt(np.mean(r**2))) for r in (base.unseen, unseen))
    gain_low = bootstrap_gain(block_losses(base.unseen), block_losses(unseen), rng)
    return (fit, unseen, gain_low) if after <= (1 - LEAST_GAIN) * before and gain_low > 0 else None


def _discovery(
    fit: Calibration, unseen: Array, gain_low: float, stable: Sequence[Stable], site: _Site, base: Candidate,
    bench: Bench,
) -> Discovery:  # fmt: skip
    plant = fit.plant
    form = next(effect for effect in plant.effects if isinstance(effect, FreeForm))
    terms = tuple(_found(k, s, form, plant) for k, s in enumerate(stable, start=1))
    own = np.array([plant.parameters[f"{form.name}.coefficient_{k}"].value for k in range(1, len(terms) + 1)])
    along = [signals_along(plant, part, site.position) for part in bench.fitted]
    values = [evaluated([t.term for t in terms], signals, plant.rig.sample_time) for signals in along]
    return Discovery(
        calibration=fit, terms=terms, before=float(np.sqrt(np.mean(base.unseen**2))),
        after=float(np.sqrt(np.mean(unseen**2))), gain_low=gain_low, unseen=unseen,
        state=np.concatenate([signals[terms[0].term.variable] for signals in along]),
        entering=form.size * (np.vstack(values) @ own),
        latent=_latent(plant.without_effects(form.name), bench.fitted, site.opening, base.noise),
    )  # fmt: skip


def _found(number: int, stable: Stable, form: FreeForm, plant: Plant) -> FoundTerm:
    """A term as the fit left it."""
    term = form.terms[number - 1]
    unit = unit_of(term.variable, plant)
    shape = None
    if (parameter := term.shape_parameter) is not None:
        value = plant.parameters[f"{form.name}.{parameter.name}_{number}"].value
        term = replace(term, **{parameter.name: value})
        # A width is a pure number times the scale of the signal, a time is in seconds.
        wide, of = (1.0, parameter.unit) if parameter.unit != "1" else (term.scale, unit)
        shape = (parameter.name, value * wide, of)
    coefficient = plant.parameters[f"{form.name}.coefficient_{number}"].value
    return FoundTerm(
        term=term, coefficient=form.size * coefficient / term.scale**term.degree,
        unit=unit_per(form.unit, unit, term.degree), shape=shape, inclusion=stable.inclusion,
    )  # fmt: skip


def _latent(plant: Plant, parts: Sequence[Part], opening: Opening, noise: float) -> Latent | None:
    """What enters beside a plant whose parameters are known."""
    try:
        linears = [_with_known_parameters(linear) for linear in linearise(plant, parts)]
        floor = Floor.of(linears, noise)
        return smoothed(linears, floor, open_place(linears, floor, opening))
    except (ModelError, SimulationError):
        return None


def _with_known_parameters(linear: Linear) -> Linear:
    """Nothing follows from parameters being other than they are."""
    return replace(
        linear, by_parameter=np.zeros_like(linear.by_parameter),
        rows_by_parameter=np.zeros_like(linear.rows_by_parameter),
        start_by_parameter=np.zeros_like(linear.start_by_parameter),
    )  # fmt: skip


def _unit_at(opening: Opening, plant: Plant) -> str:
    """Unit of the signal at an opening, as far as it is known."""
    rig = plant.rig
    if opening.place == Place.PARAMETER.value:
        return plant.parameters[opening.signal].unit
    force = "N" if rig.output_unit == "m" else "1"
    return {"command": rig.input_unit, "reading": rig.output_unit, "force": force}.get(opening.signal, "1")
