"""Effects that act like the one that explains most; they must be tried, whatever they promised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import level_of, simulated
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.naming.contribution import contribution, readings_of_fit
from deatwin.ident.mismatch.naming.screen import Lead, LinearisedResponse, leads, linearised_responses
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect

ALIKE = 0.25
"""Share of what an effect does to the readings, that another could do to first order, to be tried as well: they
correlate by a half. The rest may be what the effect that was found imitates badly."""
LOOKED_AT = 8
"""So many, the most alike at the strength at which they do as much, are looked at at their own strength,"""
MOST = 3
"""and so many are tried at most, besides effects at further places, which no score brought."""


def siblings(
    problem: DiagnosisProblem, explanation: Calibration, added: Sequence[str], effects: Sequence[Effect]
) -> list[Lead]:
    """Return what could do, to first order, much of what an added effect does to the readings.

    In a small mismatch the noise decides which effects promise most of the residual, and where the plant was biased far
    to imitate the mismatch, none does. What an effect does to the plant that was fitted with it has neither fault.

    Parameters
    ----------
    problem : DiagnosisProblem
        Recordings and number of workers.
    explanation : Calibration
        Of the plant with the added effects, on the fitted part.
    added : sequence of str
        Their names.
    effects : sequence of Effect
        That could be tried in their place.

    Returns
    -------
    list of Lead
        The most alike first, each with the strength at which it is.
    """
    bare, does = _bare(problem, explanation), contribution(problem, explanation, added)
    if bare is None or not effects or not np.isfinite(does).all():
        return []
    done = replace(bare, residuals=taken_off(does, tangent_basis(bare.jacobian)))
    rough = leads(linearised_responses(problem, bare, effects, done), done)
    looked_at = _first(rough, LOOKED_AT)
    found = run_jobs(_at_its_strength, [(problem, bare, lead, done) for lead in looked_at], workers=problem.jobs)
    alike = [lead for lead in found if lead is not None and lead.share > ALIKE]
    return _first(sorted(alike, key=lambda lead: -lead.share), MOST)


def _first(ranked: Sequence[Lead], count: int) -> list[Lead]:
    """The first so many of effects at their first places, and all at further ones."""
    others = [lead for lead in ranked if not lead.effect.placed_at][:count]
    return [lead for lead in ranked if lead in others or lead.effect.placed_at]


def _bare(problem: DiagnosisProblem, explanation: Calibration) -> Calibration | None:
    """The plant of an explanation without any added effect, not fitted anew; None where it cannot be simulated.

    Others are looked at in that one, though some effects may stay: a plant for each other beside those would be built
    for a glance.
    """
    plant = explanation.plant.without_effects(
        *(name for name in explanation.plant.effect_names if name not in problem.nominal.effect_names)
    )
    kept = [k for k, name in enumerate(explanation.names) if name in plant.parameters]
    names = tuple(explanation.names[k] for k in kept)
    fitting = Problem(plant=plant, parts=tuple(part.until_last() for part in problem.fitted), names=names)
    found = fitting.evaluate(fitting.start())
    if found is None:
        return None
    residuals, jacobian = found
    return replace(
        explanation,
        plant=plant,
        names=names,
        covariance=explanation.covariance[np.ix_(kept, kept)],
        residuals=residuals,
        jacobian=jacobian,
    )


def _at_its_strength(problem: DiagnosisProblem, bare: Calibration, lead: Lead, done: Calibration) -> Lead | None:
    """Return the same at the strength at which it is most alike."""
    strength = getattr(lead.estimate, lead.estimate.strength)
    readings = simulated(bare.plant.with_effects(lead.estimate), [part.until_last() for part in problem.fitted])
    if strength == 0.0 or readings is None:
        return None
    change = (readings - readings_of_fit(problem.fitted, bare.residuals)) / level_of(problem.fitted)
    return leads([LinearisedResponse(effect=lead.estimate, change=change / strength)], done)[0]
