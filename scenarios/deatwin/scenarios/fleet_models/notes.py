"""What the page says in words: what drift does, what hysteresis does, and what the tests make of both."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import median

from deatwin.ident.narx.fleet.orders import Plan
from deatwin.ident.narx.fleet.records import FILM, RECORDED, STEADY
from deatwin.scenarios.fleet_models.study import FREE, FRO, SEMP, SVB, Study
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import Note


def semp_notes(study: Study) -> list[Note]:
    """Write the notes of chapter 4."""
    return [_sections(study), _failures(study), _drift(), _step_taken(study)]


def svb_notes(study: Study) -> list[Note]:
    """Write the notes of chapter 6."""
    return [_same_benches(study), _posterior(study), _failures(study), _rule(study)]


def _failures(study: Study) -> Note:
    every = {variant: study.models(variant) for variant in (RECORDED, STEADY, FILM)}
    passed = {variant: sum(one.passed for one in found) for variant, found in every.items()}
    one_step = {v: _micro([float(one.held_out.one_step.rms[0]) for one in found]) for v, found in every.items()}
    free_run = {v: _micro([one.error for one in found]) for v, found in every.items()}
    number = len(every[RECORDED])
    total = sum(len(one.held_out.tests) for one in every[RECORDED])
    noise = f"{1e6 * study.prepared[0].actuator.plant.rig.noise:.1f} µm"
    test = every[RECORDED][0].held_out.tests[0]
    return Note(
        title="Why correlation tests fail, and what that is worth",
        paragraphs=[
            f"Of the {total} tests of the {number} models {passed[RECORDED]} pass. Of the same actuators without their "
            f"histories, under the same commands and the same sensor's noise, {passed[STEADY]} pass, and of the bare "
            f"film {passed[FILM]}: drift is one reason, and most failures have another. An error that moves slowly "
            "correlates with itself at every lag, and one that grows with the displacement, as a gain that drifts "
            "makes it, with the command.",
            "What fails without drift too is structure that the models do not have, even for the bare film: products "
            "up to a degree, of few lags, at a long sampling time, are no film. The force of friction depends on "
            "where the motion last turned, which no polynomial of a few past values tells; and such a polynomial "
            "follows the film's own law only so far, least where the film is soft, at large commands, which is what "
            f"φ (u²)′e² sees. With hysteresis alone the free-run error is {free_run[STEADY]} (median of the {number}) "
            f"and the one-step residual {one_step[STEADY]}; without it they are {free_run[FILM]} and "
            f"{one_step[FILM]}. The sensor's noise is {noise}, so that nearly all of a residual is the model's own.",
            "A test judges the residual relative to itself, however small it is, and the smaller it is the more of it "
            f"is the model's own fault. Over {test.n_samples} samples a correlation of {test.band:.2f} is seen; a test "
            "that fails says that there is something left to explain, not how much. How much, the free run says.",
        ],
    )


def _drift() -> Note:
    return Note(
        title="What the histories do",
        paragraphs=[
            "A model whose parameters do not change follows an actuator that does only where it was fitted. The figure "
            "of the free runs over whole recordings shows each history at work, and which of it lies within the "
            "sections. What to do about it is chapter 5: time-varying."
        ],
    )


def _step_taken(study: Study) -> Note:
    return Note(
        title="The step that is taken",
        paragraphs=[
            "SEMP is the step of its search with the least free-run error over the training section. On one actuator "
            "or another that is a structure that does worse on the held-out section than FRO with as many terms: "
            f"{_against(study)}. What Bayes' rule makes of the same recordings is in svb-fleet."
        ],
    )


def _same_benches(study: Study) -> Note:
    plan = study.plan
    step = plan.factor * study.prepared[0].recordings[RECORDED].sample_time
    return Note(
        title="The same recordings, sections and candidates as in semp-fleet",
        paragraphs=[
            "Six actuators, recorded once. Each has a stationary stretch, whose last 100 s are held out. Sampling time "
            f"({quantity(step, 's')}), lags and degree are those that semp-fleet chooses and gives reasons for: the "
            f"candidates are {_candidates(plan)}. SEMP looks for the structure that runs free best; SVB looks one step "
            "ahead only, and prunes what the lower bound on the evidence can do without. SVB is the published "
            "algorithm, without the clean-up of the package's default."
        ],
    )


def _posterior(study: Study) -> Note:
    counts = {m: [len(bench.models[m].model.terms) for bench in study.recorded] for m in study.methods}
    terms = "; ".join(f"{method} {', '.join(map(str, found))}" for method, found in counts.items())
    return Note(
        title="What the posterior says, and what it does not",
        paragraphs=[
            f"Terms that are kept, DEA 1 to 6: {terms}. SVB gives each parameter a distribution, and with it a band "
            "for the next reading. Both hold if the structure does and the residual is white. It is not, as the "
            "correlation tests say, so that the intervals are too narrow for what the parameters would be on another "
            "section; they tell the terms that matter from those that do not, and that is what SVB uses them for.",
            "A band of free runs takes the draws of the parameters and of the noise through the whole run. Hysteresis "
            "and drift are in neither. What the uncertainty of parameters makes of frequency responses is chapter 7: "
            "frequency-uncertainty.",
        ],
    )


def _sections(study: Study) -> Note:
    plan = study.plan
    step = study.prepared[0].recordings[RECORDED].sample_time
    rule = sorted({one.sampling.factor * step for one in study.prepared})
    tried = ", ".join(f"{100 * one.least.mean():.1f} % at {quantity(one.factor * step, 's')}" for one in plan.orders)
    return Note(
        title="Sections, sampling time, lags and degree",
        paragraphs=[
            "Sections are chosen where a recording is stationary. The reading itself would not do: its mean over half "
            "a minute wanders by more than the actuators drift, because the command's does. Tested is the reading less "
            "what command and rate explain over the whole recording, and the longest stretch that passes is taken; its "
            "last 100 s are held out, and nothing is chosen on them.",
            f"The correlation functions ask for {' or '.join(quantity(time, 's') for time in rule)}, fifteen samples "
            f"to their first minimum. The least mean free-run errors are {tried}: the longest time is taken that is "
            f"no worse by more than a standard error, {quantity(plan.factor * step, 's')}, and of lags and degrees "
            f"likewise the fewest candidates, {_candidates(plan)}.",
        ],
    )


def _candidates(plan: Plan) -> str:
    lags = ", ".join(f"u(k-{lag})" if lag else "u(k)" for lag in plan.input_lags)
    own = ", ".join(f"y(k-{lag})" for lag in range(1, plan.output_lags + 1))
    return f"products of {own} and {lags} up to degree {plan.degree}"


def _rule(study: Study) -> Note:
    free = [bench.models[FREE] for bench in study.recorded]
    lost = sum(bool(one.training.diverged or one.held_out.diverged) for one in free)
    kept = [bench.models[SVB].fit for bench in study.recorded]
    return Note(
        title="Candidates affine in the output",
        paragraphs=[
            "The film relaxes with one time, so the past enters through one value, and the candidates are taken affine "
            "in it: products hold the past output once or not at all. Powers of it can make a free run explode, which "
            "SVB, looking one step ahead only, does not see; with other seeds it does happen. With all products among "
            f"the candidates {lost} of {len(free)} SVB models diverge over one of the sections and the others fit "
            f"{_range(one.fit for one in free if not one.held_out.diverged)} %; with the rule the fits "
            f"are {_range(kept)} %."
        ],
    )


def _against(study: Study) -> str:
    """Free-run errors of SEMP beside FRO on the held-out section."""
    errors = [
        (bench.name, *(1e6 * float(bench.models[method].held_out.free_run.rms[0]) for method in (SEMP, FRO)))
        for bench in study.recorded
    ]
    return ", ".join(f"{name} {semp:.1f} µm against {fro:.1f} µm" for name, semp, fro in errors)


def _range(values: Iterable[float]) -> str:
    every = list(values)
    return f"{min(every):.1f} to {max(every):.1f}" if every else "–"


def _micro(metres: list[float]) -> str:
    return f"{1e6 * median(metres):.1f} µm"
