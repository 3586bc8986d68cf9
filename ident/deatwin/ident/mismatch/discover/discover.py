"""Search for a free form, a force without physical meaning, if no effect explains a mismatch.

The force is sought as a sum of a few functions of the plant's states and its input, with and without memory. The
functions are compared by the response of the readings to each of them, without what the plant's parameters can imitate.
A smoothed estimate of the force would not do: it lacks what the filter has smoothed away, and what the calibration has
already imitated. Functions that the recordings choose again and again are built into the plant, which is fitted anew as
a whole. A free form is kept only if it improves the free run on the held-out part; it is never a cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.greybox.filter import Latent, open_place, smoothed
from deatwin.ident.greybox.filter_foreign import linearise
from deatwin.ident.greybox.filter_linear import Floor, Linear
from deatwin.ident.greybox.filter_openings import Opening
from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import Part, free_run_residuals
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.discover.dictionary import POSITION, RATE, dictionary, evaluated, signals_along
from deatwin.ident.mismatch.discover.discovery import Discovery, FoundTerm, unit_of, unit_per
from deatwin.ident.mismatch.discover.sparse import Stable, stable_terms
from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import free_run_rms
from deatwin.ident.mismatch.result import ShapeSummary
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import DEVIATIONS, NEGLIGIBLE, PRACTICAL_SHARE, ROUNDING, TINY
from deatwin.plant.arrays import Array, root_mean_square
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.primitives import Power, Primitive
from deatwin.plant.errors import ModelError, SimulationError
from deatwin.plant.model import Plant

PREFERRED = (("ball", "force"), ("sensor", "reading"), ("drive", "command"))
"""Default places of a free form; the first one that the rig has is used."""
STEPS = (1.0, 0.5, 0.25, 0.1)
"""Shares of the linear prediction that are tried as the start of the fit."""
SHARPER = np.geomspace(0.5, 2.0, 15)
"""Factors by which a shape may differ from that in the dictionary."""
EVALUATIONS = 20


@checks_its_arguments
def discover(
    problem: DiagnosisProblem, base: Candidate, rng: np.random.Generator, *, place: Opening | None = None
) -> Discovery | None:
    """Search for a free form: a force that reduces the mismatch and has no physical name.

    On a rig without a moving part, the free form is added to the reading or to the command instead.

    Parameters
    ----------
    problem : DiagnosisProblem
        Diagnosis problem with the recordings.
    base : Candidate
        Calibrated plant that leaves a mismatch.
    rng : numpy.random.Generator
        Random generator for all resampling.
    place : Opening, optional
        Place at which the free form acts. By default, or if the plant accepts no free form there, the first of these
        that accepts one: the force on the moving part, the reading, the command.

    Returns
    -------
    Discovery or None
        The free form. None if the plant leaves no mismatch, if no term is chosen consistently from resampled data, or
        if the decrease of the error on held-out data is less than 10 % or not significant.
    """
    plant = base.calibration.plant
    site = _site(plant, place)
    if site is None or not base.mismatch:
        return None
    try:
        linears = linearise(plant, problem.fitted)
    except SimulationError:
        return None
    search = _Search.of(plant, problem.fitted, linears, site)
    jacobian, residual = base.calibration.jacobian, base.calibration.residuals
    stable = stable_terms(search.answers(search.terms), residual, jacobian, rng)
    # If all terms together gain nothing, the most stable one alone may.
    for some in dict.fromkeys((stable, stable[:1])):
        fit = _fitted(search, some, base, problem)
        kept = None if fit is None else _kept(fit, base, problem, rng)
        if kept is not None:
            return kept
    return None


@dataclass(frozen=True, kw_only=True)
class _Site:
    """A place where a free form may act, with the signals on which it can depend."""

    opening: Opening
    position: str
    unit: str

    def free_form(self, terms: Sequence[Primitive], size: float, coefficients: Sequence[float]) -> FreeForm:
        return FreeForm(
            size=size,
            terms=tuple(terms),
            coefficients=tuple(coefficients),
            enters=Place(self.opening.place),
            node=self.opening.signal,
            unit=self.unit,
        )


def _site(plant: Plant, wanted: Opening | None) -> _Site | None:
    """Return the first place that the rig offers; if it watches no motion, the reading counts as the motion."""
    preferred = [Opening(place=place, signal=signal) for place, signal in PREFERRED]
    names = {place.value for place in Place}
    watched = plant.signals
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
    """Functions at a place, with the responses of the counted readings to each."""

    site: _Site
    linears: tuple[Linear, ...]
    along: list[dict[str, Array]]
    terms: tuple[Primitive, ...]
    levels: tuple[Array, ...]

    @classmethod
    def of(cls, plant: Plant, parts: Sequence[Part], linears: Sequence[Linear], site: _Site) -> _Search:
        along = [signals_along(plant, part, site.position) for part in parts]
        levels = tuple(part.level for part in parts)
        return cls(
            site=site, linears=tuple(linears), along=along, terms=dictionary(along, site.position), levels=levels
        )

    def answers(self, terms: Sequence[Primitive]) -> Array:
        """Return the responses of the readings to terms at the place, divided by the noise level, shape (m, k)."""
        number = self.linears[0].openings.index(self.site.opening)
        found = []
        for linear, signals, level in zip(self.linears, self.along, self.levels, strict=True):
            answer = linear.response(number, evaluated(terms, signals, linear.interval))[linear.counted]
            # The reading in the state of rest, before anything could enter, has no response.
            found.append(np.pad(answer, ((level.size - len(answer), 0), (0, 0))) / level[:, None])
        return np.vstack(found)

    def sharpened(self, terms: Sequence[Primitive], base: Calibration) -> list[Primitive]:
        """Choose the shape of each term in turn, so that it explains most beside the others."""
        found = list(terms)
        for k, term in enumerate(found):
            if (parameter := term.shape_parameter) is None:
                continue
            tried = [replace(term, **{term.shape: parameter.value * f}) for f in SHARPER]
            beside = [base.jacobian, self.answers(found[:k] + found[k + 1 :])] if len(found) > 1 else [base.jacobian]
            basis = tangent_basis(np.hstack(beside))
            own, left = taken_off(self.answers(tried), basis), taken_off(base.residuals, basis)
            found[k] = tried[int(np.argmax((own.T @ left) ** 2 / np.maximum((own**2).sum(axis=0), TINY)))]
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """A plant with a free form, fitted as a whole."""

    calibration: Calibration
    stable: tuple[Stable, ...]
    site: _Site

    @property
    def form(self) -> FreeForm:
        """Return the free form with the fitted coefficients."""
        plant = self.calibration.plant
        made = next(effect for effect in plant.effects if isinstance(effect, FreeForm))
        terms, coefficients = [], []
        for k, term in enumerate(made.terms, start=1):
            coefficients.append(plant.parameters[f"{made.name}.coefficient_{k}"].value)
            shape = {term.shape: plant.parameters[f"{made.name}.{term.shape}_{k}"].value} if term.shape else {}
            terms.append(replace(term, **shape))  # type: ignore[arg-type]
        return replace(made, terms=tuple(terms), coefficients=tuple(coefficients))

    @property
    def weakest(self) -> int | None:
        """Return the least significant term, if it may be zero."""
        fit = self.calibration
        own = [fit.names.index(f"{FreeForm.name}.coefficient_{k + 1}") for k in range(len(self.stable))]
        deviations = np.sqrt(np.maximum(np.diag(fit.covariance)[own], TINY))
        said = [fit.names[k] not in fit.undetermined for k in own]
        ratios = np.abs(self.form.coefficients) / deviations * said
        return int(np.argmin(ratios)) if ratios.min() < DEVIATIONS else None

    def without(self, number: int, parts: Sequence[Part]) -> _Fit:
        """Refit without one term."""
        form, left = self.form, [k for k in range(len(self.stable)) if k != number]
        fewer = self.site.free_form([form.terms[k] for k in left], form.size, [form.coefficients[k] for k in left])
        start = self.calibration.plant.without_effects(form.name).with_effects(fewer)
        again = descend(start, parts, evaluations=EVALUATIONS, tolerance=NEGLIGIBLE)
        return replace(self, calibration=again, stable=tuple(self.stable[k] for k in left))


def _fitted(search: _Search, stable: tuple[Stable, ...], base: Candidate, problem: DiagnosisProblem) -> _Fit | None:
    """Return the plant fitted with given terms; None if it does not fit better than without them."""
    start = _start(search, stable, base, problem) if stable else None
    if start is None:
        return None
    fit = descend(start, problem.fitted, evaluations=EVALUATIONS, tolerance=NEGLIGIBLE)
    found = _Fit(calibration=fit, stable=stable, site=search.site)
    while found.calibration.status.ok and (number := found.weakest) is not None:
        if len(found.stable) == 1:
            return None
        found = found.without(number, problem.fitted)
    return found if found.calibration.status.ok and found.calibration.rms < base.calibration.rms else None


def _start(search: _Search, stable: Sequence[Stable], base: Candidate, problem: DiagnosisProblem) -> Plant | None:
    """Move towards the linear prediction as long as the free run improves."""
    plain = base.calibration
    terms = search.sharpened([search.terms[s.column] for s in stable], plain)
    both = np.hstack([plain.jacobian, search.answers(terms)])
    scale = np.maximum(np.linalg.norm(both, axis=0), TINY)
    moves = np.linalg.lstsq(both / scale, plain.residuals, rcond=ROUNDING)[0] / scale
    shifts, coefficients = np.split(moves, [plain.jacobian.shape[1]])
    size = float(np.abs(coefficients).max())
    if not size > 0:
        return None
    fitting = Problem(plant=plain.plant, parts=tuple(problem.fitted), names=plain.names)
    starts = []
    for share in STEPS:
        moved = fitting.values(np.clip(fitting.start() + share * shifts, *fitting.bounds()))
        form = search.site.free_form(terms, size, list(share * coefficients / size))
        starts.append(plain.plant.with_values(moved).with_effects(form))
    rms = [free_run_rms(start, problem.fitted) for start in starts]
    best = int(np.argmin(rms))
    return starts[best] if rms[best] < plain.rms else None


def _kept(fit: _Fit, base: Candidate, problem: DiagnosisProblem, rng: np.random.Generator) -> Discovery | None:
    """Return the discovery if it certainly reduces the error on held-out data by enough."""
    plant, form = fit.calibration.plant, fit.form
    unseen = free_run_residuals(plant, problem.unseen)
    if unseen is None:
        return None
    after, losses = root_mean_square(unseen), block_losses(unseen)
    plain = min(base.unseen, _left_without(fit, base, problem), key=lambda residuals: float(np.mean(residuals**2)))
    before, gain_low = root_mean_square(plain), bootstrap_gain(block_losses(plain), losses, rng)
    if after > (1 - PRACTICAL_SHARE) * before or gain_low <= 0:
        return None
    along = [signals_along(plant, part, fit.site.position) for part in problem.fitted]
    values = np.vstack([evaluated(form.terms, signals, plant.rig.sample_time) for signals in along])
    pieces = values * np.array(form.coefficients)
    order = [int(k) for k in np.argsort(-pieces.std(axis=0), kind="stable")]
    return Discovery(
        calibration=fit.calibration,
        terms=tuple(_found(form, k, fit.stable[k].inclusion, plant) for k in order),
        before=before,
        after=after,
        gain_low=gain_low,
        unseen=unseen,
        state=np.concatenate([signals[form.terms[order[0]].variable] for signals in along]),
        entering=form.size * pieces.sum(axis=1),
        latent=_latent(plant.without_effects(form.name), problem.fitted, fit.site.opening, base.noise),
    )


def _left_without(fit: _Fit, base: Candidate, problem: DiagnosisProblem) -> Array:
    """Return held-out residuals of the plant without the form, refitted from its values beside the form."""
    # Beside a form, the plant's parameters may come to values that are better even without the form.
    plant = fit.calibration.plant.without_effects(fit.form.name)
    again = descend(plant, problem.fitted, evaluations=EVALUATIONS, tolerance=NEGLIGIBLE)
    unseen = free_run_residuals(again.plant, problem.unseen) if again.status.ok else None
    return base.unseen if unseen is None else unseen


def _found(form: FreeForm, number: int, inclusion: float, plant: Plant) -> FoundTerm:
    """Convert a term to SI."""
    term = form.terms[number]
    unit, shape = unit_of(term.variable, plant), None
    if (parameter := term.shape_parameter) is not None:
        # A width is a pure number times the scale of the signal, a time is in seconds.
        wide, of = (term.scale, unit) if parameter.unit == "1" else (1.0, parameter.unit)
        shape = ShapeSummary(name=parameter.name, value=parameter.value * wide, unit=of)
    return FoundTerm(
        term=term,
        coefficient=form.size * form.coefficients[number] / term.scale**term.degree,
        unit=unit_per(form.unit, unit, term.degree),
        shape=shape,
        inclusion=inclusion,
    )


def _latent(plant: Plant, parts: Sequence[Part], opening: Opening, noise: float) -> Latent | None:
    """Estimate the unknown input of a plant with known parameters."""
    try:
        linears = [_with_known_parameters(linear) for linear in linearise(plant, parts)]
        floor = Floor.of(linears, noise)
        return smoothed(linears, floor, open_place(linears, floor, opening))
    except (ModelError, SimulationError):
        return None


def _with_known_parameters(linear: Linear) -> Linear:
    """Return a linearised plant in which all parameters count as known."""
    return replace(
        linear,
        by_parameter=np.zeros_like(linear.by_parameter),
        rows_by_parameter=np.zeros_like(linear.rows_by_parameter),
        start_by_parameter=np.zeros_like(linear.start_by_parameter),
    )


def _unit_at(opening: Opening, plant: Plant) -> str:
    """Return the unit of the signal at a place, if it is known."""
    rig = plant.rig
    if opening.place == Place.PARAMETER.value:
        return plant.parameters[opening.signal].unit
    force = "N" if rig.output_unit == "m" else "1"
    return {"command": rig.input_unit, "reading": rig.output_unit, "force": force}.get(opening.signal, "1")
