"""The tables of the page: tracking, actuators, models, concealed effects, and how often verdicts kept their word."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

from deatwin.control.checking.specification import Verdict
from deatwin.scenarios.control_check.concealed import Concealed
from deatwin.scenarios.control_check.matters import Matters
from deatwin.scenarios.control_check.promises import QUANTITIES, Promise, promises
from deatwin.scenarios.control_check.rates import broken, caught, inside, least_percent, sound
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tracking import FleetRun, Tracking
from deatwin.scenarios.control_check.trials import NO_MODEL, Outcome
from deatwin.scenarios.svb_benchmark.figures import table_text
from deatwin.scenarios.svb_benchmark.trials import Rate
from deatwin.studies.report.quantities import in_interval
from deatwin.studies.report.story import Table

MICRO = 1e6
NOTHING = "none"
"""Where no effect is concealed."""


def tables(study: Study) -> list[Table]:
    """Make all tables."""
    always = [
        _tracking(study.tracking),
        _fleet(study.fleet),
        _models(study.matters),
        _concealed(study.concealed),
        _rates(study.outcomes),
    ]
    return [*always, _broken(study.outcomes)] if broken(study.outcomes) else always


def trials_csv(outcomes: Sequence[Outcome]) -> str:
    """A line for each trial."""
    header = ("trial", "concealed", "design", "closed_loop_time_s", "band_Hz", "verdict", "inside", "sound")
    rows = (
        (
            o.number,
            o.concealed or NOTHING,
            o.design,
            f"{o.closed_loop_time:.4g}",
            f"{o.band_Hz:.4g}",
            o.verdict,
            "" if o.inside is None else f"{o.inside:.4f}",
            "" if o.sound is None else int(o.sound),
        )
        for o in outcomes
    )
    return table_text(header, rows)


def verdicts_seen(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    """The verdicts in their order, from good to bad."""
    known = tuple(verdict.value for verdict in Verdict)
    return (*known, NO_MODEL) if any(o.verdict == NO_MODEL for o in outcomes) else known


def _tracking(every: Sequence[Tracking]) -> Table:
    rows = []
    for tracking in every:
        best = min(one.rms for name, one in tracking.tracked.items() if name.startswith("oracle"))
        for name, one in tracking.tracked.items():
            rows.append(
                [
                    tracking.name,
                    name,
                    _number(MICRO * one.rms, ".3g", " µm"),
                    _number(tracking.ratio("PI", name), ".2f"),
                    _number(one.rms / best, ".2f"),
                    _number(float(one.margins.gain[0]), ".3g"),
                    _number(float(one.margins.phase_deg[0]), ".0f", "°"),
                    one.run.status.name.lower().replace("_", " "),
                ]
            )
    return Table(
        title="Tracking tones of 0.1 to 0.8 Hz",
        columns=[
            "plant",
            "controller",
            "rms error",
            "PI's error over it",
            "its error over the best oracle's",
            "gain margin with the identified model",
            "phase margin",
            "run",
        ],
        rows=rows,
    )


def _number(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if isfinite(value) else "–"


def _fleet(runs: Sequence[FleetRun]) -> Table:
    rows = [
        [
            run.actuator.name,
            run.actuator.story,
            f"{100 * run.steps.overshoot:.0f} %",
            f"{100 * run.steps.steady_error:.1f} %",
            f"{100 * run.steps.ripple:.2g} %",
            f"{MICRO * run.tones.rms_error:.0f} µm",
            "yes" if run.stable else "no",
        ]
        for run in runs
    ]
    return Table(
        title="The scheduled design on the six actuators",
        columns=[
            "actuator",
            "what happens to it",
            "overshoot of the steps",
            "mean error late after a step",
            "motion late after a step",
            "rms error on the tones",
            "stable",
        ],
        rows=rows,
    )


def _models(matters: Matters) -> Table:
    made = promises(matters)
    rows = [
        [
            matter.name,
            _percent_of(matter.residual, matters.output_rms),
            *([_promise(p) for p in made if p.model == matter.name] or [f"no design: {matter.reason}"]),
        ]
        for matter in matters.models
    ]
    rows = [[*row, *[""] * (2 + len(QUANTITIES) - len(row))] for row in rows]
    return Table(
        title="Predicted (95 % interval), then achieved; ✓ where it lies inside",
        columns=["model", "free run leaves, of the recording's rms", *(q.label for q in QUANTITIES)],
        rows=rows,
    )


def _promise(promise: Promise) -> str:
    predicted = promise.predicted
    return (
        f"{in_interval(predicted.value, predicted.low, predicted.high)}, {promise.achieved:.3g} "
        f"{'✓' if promise.kept else '✗'}"
    )


def _percent_of(residual: float | None, whole: float) -> str:
    return "diverged" if residual is None else f"{100 * residual / whole:.2g} %"


def _concealed(every: Sequence[Concealed]) -> Table:
    rows = [
        [
            one.effect.replace("_", " "),
            one.diagnosis.verdict.value,
            ", ".join(cause.effect.replace("_", " ") for cause in one.diagnosis.causes) or "–",
            designed.source,
            f"{designed.controller.closed_loop_time:g} s",
            designed.controller.name,
            designed.check.verdict.value,
            designed.check.reason,
            f"{designed.truth.verdict.value}: {designed.truth.text}",
        ]
        for one in every
        for designed in (*one.designs, *one.at_other_times)
    ]
    return Table(
        title="A concealed effect: designs from the base model and from the amended one",
        columns=[
            "concealed",
            "diagnosis",
            "its causes",
            "designed from",
            "closed-loop time",
            "controller",
            "verdict of the check",
            "reason",
            "what the true rig did",
        ],
        rows=rows,
    )


def _rates(outcomes: Sequence[Outcome]) -> Table:
    groups: list[tuple[str, list[Outcome]]] = [("all", list(outcomes))]
    for key in (lambda o: o.design, lambda o: f"concealed: {(o.concealed or NOTHING).replace('_', ' ')}"):
        groups += _grouped(outcomes, key)
    rows = []
    for name, of in groups:
        verdicts = [sum(o.verdict == v for o in of) for v in verdicts_seen(outcomes)]
        rates = (inside(of), sound(of), caught(of))
        rows.append([name, str(len(of)), *map(str, verdicts), *map(_cell, rates)])
    return Table(
        title="How often the verdict kept its word, by design and by what was concealed (lower bounds hold with 95 %)",
        columns=[
            "trials",
            "number",
            *verdicts_seen(outcomes),
            "of those that pass: steps inside the band",
            "of those that pass: sound on the true rig",
            "of the unsound: not passed",
        ],
        rows=rows,
    )


def _grouped(outcomes: Sequence[Outcome], key: Callable[[Outcome], str]) -> list[tuple[str, list[Outcome]]]:
    return [(name, [o for o in outcomes if key(o) == name]) for name in sorted({key(o) for o in outcomes})]


def _cell(rate: Rate) -> str:
    return f"{rate.hits} of {rate.count} (≥ {least_percent(rate)} %)" if rate.count else "–"


def _broken(outcomes: Sequence[Outcome]) -> Table:
    rows = [
        [
            str(o.number),
            o.design,
            f"{o.closed_loop_time:.2g} s",
            o.concealed.replace("_", " ") or NOTHING,
            "–" if o.inside is None else f"{100 * o.inside:.1f} %",
            o.truth,
        ]
        for o in broken(outcomes)
    ]
    return Table(
        title="Trials that were passed and did not keep it",
        columns=["trial", "design", "closed-loop time", "concealed", "steps inside the band", "on the true rig"],
        rows=rows,
    )
