"""Effects that act like the best one; they must be tried, regardless of their score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import level_of, simulated
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.naming.contribution import contribution, readings_of_fit
from deatwin.ident.mismatch.naming.screen import (
    Lead,
    LinearisedResponse,
    by_effect,
    leads,
    linearised_responses,
    sought_in,
)
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import FEW, MOST
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect

LOOKED_AT = 8
"""Number of the most similar effects that are simulated at their estimated strength."""


def siblings(
    problem: DiagnosisProblem,
    explanation: Calibration,
    added: Sequence[str],
    effects: Sequence[Effect],
    known: dict[str, list[LinearisedResponse]],
) -> list[Lead]:
    """Return effects whose response is similar, to first order, to that of an added effect, the most similar first.

    `known` are responses by effect in another plant, such as the calibrated one; those of further effects are added.
    """
    # An effect is tried if it can cause a quarter of the squared response, a correlation of a half: the found effect may
    # imitate the rest badly. If the mismatch is small, noise decides which effects have a high score; if the base fit is biased, no effect has
    # one. The response of an effect in the plant that was fitted with it has neither problem.
    bare, does = _bare(problem, explanation), contribution(problem, explanation, added)
    if bare is None or not effects or not np.isfinite(does).all():
        return []
    done = replace(bare, residuals=taken_off(does, tangent_basis(bare.jacobian)))
    rough = leads(_responses(problem, bare, effects, done, known), done)
    looked_at = _first(rough, LOOKED_AT)
    found = run_jobs(_at_its_strength, [(problem, bare, lead, done) for lead in looked_at], workers=problem.jobs)
    alike = [lead for lead in found if lead is not None and lead.share > MOST**2]
    return _first(sorted(alike, key=lambda lead: -lead.share), FEW)


def _responses(
    problem: DiagnosisProblem,
    bare: Calibration,
    effects: Sequence[Effect],
    done: Calibration,
    known: dict[str, list[LinearisedResponse]],
) -> list[LinearisedResponse]:
    """Return responses in the bare plant; those already `known` come from another one."""
    # Responses only rank the effects; the most similar ones are simulated again in the bare plant. Of eight
    # explanations of recordings of a finite-element rig, seven had the same similar effects with responses in the bare
    # plant, and one had a third one at the border. An effect that is sought in the residual needs the present one.
    sought = {e.name for e in effects if e.event} | {e.name for e in sought_in(done, effects, problem.fitted)}
    new = [effect for effect in effects if effect.name in sought or effect.name not in known]
    found: dict[str, list[LinearisedResponse]] = {effect.name: [] for effect in new}
    found |= by_effect(linearised_responses(problem, bare, new, done))
    known |= {name: responses for name, responses in found.items() if name not in sought}
    return [response for effect in effects for response in {**known, **found}[effect.name]]


def _first(ranked: Sequence[Lead], count: int) -> list[Lead]:
    """Return the first `count` effects at their usual places, and all effects at further places."""
    others = [lead for lead in ranked if not lead.effect.placed_at][:count]
    return [lead for lead in ranked if lead in others or lead.effect.placed_at]


def _bare(problem: DiagnosisProblem, explanation: Calibration) -> Calibration | None:
    """Return the plant of an explanation without added effects, not refitted; None if it cannot be simulated."""
    # Similar effects are compared in this plant, because a plant with each of them beside the remaining effects would
    # have to be compiled for one simulation.
    plant = explanation.plant.without_effects(
        *(name for name in explanation.plant.effect_names if name not in problem.nominal.effect_names)
    )
    kept = [k for k, name in enumerate(explanation.names) if name in plant.parameters]
    names = tuple(explanation.names[k] for k in kept)
    fitting = Problem(plant=plant, parts=problem.fitted, names=names)
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
    """Return a lead at the strength at which it is most similar."""
    strength = getattr(lead.estimate, lead.estimate.strength)
    readings = simulated(bare.plant.with_effects(lead.estimate), problem.fitted)
    if strength == 0.0 or readings is None:
        return None
    change = (readings - readings_of_fit(problem.fitted, bare.residuals)) / level_of(problem.fitted)
    return leads([LinearisedResponse(effect=lead.estimate, change=change / strength)], done)[0]
