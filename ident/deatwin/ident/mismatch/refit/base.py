"""Calibration of the base plant, in all interpretations of the rig file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part, free_run_residuals
from deatwin.ident.mismatch.naming.candidate import Candidate, judge, noise_seen
from deatwin.ident.mismatch.naming.datasets import base_tables
from deatwin.ident.mismatch.naming.drawing import draw_base
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import (
    OPENING_SAMPLES,
    approach,
    at_its_time,
    finish,
    free_run_rms,
    opening,
    roughly,
    settle,
    where_it_acts,
)
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.parallel import run_jobs
from deatwin.plant.datasets import Described, Metadata, several
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.rigs.base import Rig

if TYPE_CHECKING:
    from matplotlib.axes import Axes


OPENS_AS_WELL = 1.2
"""Ratio to the nominal variant's rms residual on the openings of the experiments up to which another variant, or its
linearised minimum, may come to be fitted to all data."""
FEWER = 4
"""Number of stages with which candidates are simulated, if that is as good as the plant's own number: vectors of the
processor hold four stages, so a simulation takes a third less time than with five."""
MORE_STARTS, SPREAD = 2, 0.2
"""Number of further starts, and relative standard deviation of their parameters: typical errors of elastomers' data
sheets."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Base(Described):
    """Calibrated base plant, in the chosen interpretation of the rig file and in other interpretations.

    An interpretation is one of several plants that agree with an incomplete rig file.

    Parameters
    ----------
    chosen : Candidate
        Base plant in the interpretation with which the diagnosis continues.
    alternatives : tuple of Candidate
        Base plant in the other interpretations, the best first.
    noise : float
        Standard deviation of the sensor noise, SI.
    """

    chosen: Candidate
    alternatives: tuple[Candidate, ...]
    noise: float

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "told": several(base_tables),
    }

    def in_variant_of(self, chosen: Candidate) -> Base:
        """Return the same base plants, of which another one is chosen.

        Parameters
        ----------
        chosen : Candidate
            Base plant in one of the interpretations. It replaces the one in the same interpretation.

        Returns
        -------
        Base
        """
        variants = (self.chosen, *self.alternatives)
        others = tuple(variant for variant in variants if not _same_form(variant, chosen))
        return Base(chosen=chosen, alternatives=others, noise=chosen.noise)

    def as_filed(self, rig: Rig) -> Base:
        """Return the same base plants, of which the one with the given rig is chosen if it could be simulated.

        Parameters
        ----------
        rig : Rig
            Rig as the file states it.

        Returns
        -------
        Base
        """
        filed = [variant for variant in self.alternatives if _is_read_alike(variant.calibration.plant.rig, rig)]
        return self.in_variant_of(filed[0]) if filed else self

    def solved_like(self, other: Plant) -> Base:
        """Return the same base plants, integrated with as many stages and steps as another plant.

        Parameters
        ----------
        other : Plant
            Plant with the wanted `Plant.stages` and `Plant.steps`.

        Returns
        -------
        Base
        """
        chosen, *alternatives = (variant.solved_like(other) for variant in (self.chosen, *self.alternatives))
        return replace(self, chosen=chosen, alternatives=tuple(alternatives))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the rms residuals in each interpretation, on fitted and on held-out data, the chosen one first.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        return draw_base(self, ax)


@checks_its_arguments
def calibrate_base(problem: DiagnosisProblem) -> Base:
    """Calibrate the base plant, if necessary in every possible interpretation of the rig file.

    Parameters
    ----------
    problem : DiagnosisProblem
        Plant and recordings.

    Returns
    -------
    Base
        The base plant. The chosen interpretation is the nominal one, unless it leaves a mismatch and another one leaves
        none. An interpretation that merely fits better is not chosen, because a wrong interpretation could then
        hide a missing effect.

    Raises
    ------
    SimulationError
        If the plant cannot be simulated on these recordings in any interpretation.
    """
    first = _fitted_well(problem, problem.nominal)
    if first is not None and first.adequate:
        return Base(chosen=first, alternatives=(), noise=first.noise)
    known = [first, *_other_forms(problem, first)]
    usable = [candidate for candidate in known if candidate is not None]
    if not usable:
        raise _cannot_simulate(problem.nominal, problem.everything)
    noise = min(candidate.noise for candidate in usable)
    usable = [replace(candidate, noise=noise) for candidate in usable]
    chosen = _preferred(usable)
    return Base(chosen=chosen, alternatives=_ranked(c for c in usable if c is not chosen), noise=noise)


def enough_stages(problem: DiagnosisProblem, base: Base) -> int:
    """Return the number of stages with which candidates are simulated: few, if that does not change the readings."""
    # A log-likelihood then changes by at most one nat (standard deviation).
    plant = base.chosen.calibration.plant
    few = min(FEWER, plant.stages)
    if few < plant.stages and plant.rig.equations_known:
        usual, fast = (free_run_residuals(replace(plant, stages=n), problem.fitted) for n in (plant.stages, few))
        if usual is None or fast is None or np.sum((fast - usual) ** 2) > base.noise**2:
            return plant.stages
    return few


def beside_alternatives(problem: DiagnosisProblem, base: Base) -> Base:
    """Return the base plant with its alternative variants, judged by the same noise, unless it already has some."""
    if base.alternatives:
        return base
    others = [variant for variant in _other_forms(problem, base.chosen) if not _same_form(variant, base.chosen)]
    alternatives = [replace(variant, noise=base.noise) for variant in others]
    return replace(base, alternatives=_ranked(alternatives)) if alternatives else base


def _other_forms(problem: DiagnosisProblem, first: Candidate | None) -> list[Candidate]:
    """Return the other rig variants that can be simulated and fit the openings about as well as the file's own."""
    variants = [problem.nominal.with_rig(rig) for rig in problem.nominal.rig.rivals()]
    near = run_jobs(approach, [(variant, problem.fitted) for variant in variants], workers=problem.jobs)
    openings = [opening(part, OPENING_SAMPLES) for part in problem.fitted]
    limit = np.inf if first is None else OPENS_AS_WELL * free_run_rms(first.calibration.plant, openings)
    pairs = zip(near, variants, strict=True)
    running = [(fit.plant, variant) for fit, variant in pairs if fit.status.ok and fit.within_reach < limit]
    floor = problem.nominal.rig.noise if first is None else first.noise
    fits = run_jobs(_settled, [(*pair, problem.fitted, floor) for pair in running], workers=problem.jobs)
    return [candidate for candidate in (_judged(problem, fit) for fit in fits) if candidate is not None]


def _settled(near: Plant, variant: Plant, parts: Sequence[Part], noise: float) -> Calibration:
    """Fit all samples from `near`, or from the variant as described if `near` cannot be simulated."""
    found = settle(near, parts, noise)
    return found if found.status.ok else settle(variant, parts, noise)


def _ranked(variants: Iterable[Candidate]) -> tuple[Candidate, ...]:
    return tuple(sorted(variants, key=lambda c: -c.evidence))


def _fitted_well(problem: DiagnosisProblem, variant: Plant) -> Candidate | None:
    """Fit a variant completely, from the best of several starts."""
    near = run_jobs(approach, [(start, problem.fitted) for start in _starts(variant)], workers=problem.jobs)
    usable = sorted((fit for fit in near if fit.status.ok), key=lambda fit: fit.rms)
    openings = [opening(part, OPENING_SAMPLES) for part in problem.fitted]
    # A plant that was fitted to the openings may have no equilibrium later; then the next one is tried, and at last the
    # variant as described.
    begun = chain((where_it_acts(fit, openings, fit.names) for fit in usable), [variant])
    rough = next((fit for plant in begun if (fit := roughly(plant, problem.fitted)).status.ok), None)
    if rough is None:
        return None
    placed = at_its_time(rough, problem.fitted)
    return _judged(problem, finish(placed if placed.status.ok else rough, problem.fitted))


def _starts(variant: Plant) -> list[Plant]:
    """Return the variant as described, and with fixed typical data-sheet errors in all parameters but event times."""
    rng = np.random.default_rng(0)
    free = [variant.parameters[name] for name in variant.parameters.free if name not in variant.event_times]
    starts = [variant]
    for factors in np.exp(SPREAD * rng.standard_normal((MORE_STARTS, len(free)))):
        pairs = zip(free, factors, strict=True)
        starts.append(variant.with_values({p.name: float(np.clip(f * p.value, p.lower, p.upper)) for p, f in pairs}))
    return starts


def _same_form(one: Candidate, other: Candidate) -> bool:
    return _is_read_alike(one.calibration.plant.rig, other.calibration.plant.rig)


def _is_read_alike(one: Rig, other: Rig) -> bool:
    """Return whether two rigs are equal apart from their model error."""
    return replace(one, model_error=other.model_error) == other


def _judged(problem: DiagnosisProblem, fit: Calibration) -> Candidate | None:
    return judge(problem, fit, noise_seen(fit, problem.fitted)) if fit.status.ok else None


def _preferred(usable: Sequence[Candidate]) -> Candidate:
    """Return the nominal variant, or an adequate one if the nominal one certainly leaves a mismatch."""
    if not usable[0].mismatch:
        return usable[0]
    sound = [c for c in usable if c.adequate] or [c for c in usable if not c.mismatch]
    return sound[0] if sound else usable[0]


def _cannot_simulate(plant: Plant, parts: Sequence[Part]) -> SimulationError:
    for part in parts:
        try:
            plant.simulate(part.experiment).require()
        except SimulationError as error:
            return SimulationError(f"the model of this rig cannot be simulated with these recordings: {error}")
    return SimulationError("the model of this rig cannot be simulated with these recordings")
