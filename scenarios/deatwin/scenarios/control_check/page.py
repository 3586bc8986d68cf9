"""Goals, results, tables and figures of the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from deatwin.control import Verdict
from deatwin.plant.amplitudes import axis_label
from deatwin.scenarios.control_check.concealed import Concealed, Designed
from deatwin.scenarios.control_check.matters import QUANTITIES, Matters, Promise
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tracking import SETTLED, FleetRun, Tracked, Tracking
from deatwin.scenarios.control_check.trials import NO_MODEL, Outcome, broken, caught, in_words, inside, sound
from deatwin.studies.rates import Rate
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above, titled
from deatwin.studies.report.quantities import in_interval
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
LOWER = 5.0  # Demanded ratio of the error of PI alone to that behind the inverse
NEAR = 2.0  # Largest allowed ratio of an error to that of a design on the true plant
KEPT = 0.9  # Share of the passed designs that keep inside the predicted band
CAUGHT = 0.9  # Share of the unsound designs that the check does not pass
INVERSES = ("inverse", "inverse with dynamics")
EQUAL = 1e-6  # Relative difference of margins that are equal: they are of one loop, computed twice
MICRO = 1e6
NOTHING = "none"  # Stands where no effect is concealed


def judge(study: Study) -> list[Measure]:
    """Compare the study with its goals."""
    nominal = study.tracking[0]
    base, amended = next(one for one in study.concealed if one.effect == "electrode_rc").designs
    kept, unsound = inside(study.outcomes), caught(study.outcomes)
    return [
        _pays(nominal),
        _near(nominal),
        _scheduled(study.fleet),
        WORDS.measure("base", base.check.verdict is not Verdict.PASS, said=_both(base)),
        WORDS.measure("amended", amended.check.verdict is Verdict.PASS, said=_both(amended)),
        WORDS.measure("kept", kept.count > 0 and kept.share >= KEPT, least=100 * KEPT, rate=in_words(kept)),
        WORDS.measure(
            "caught", unsound.count > 0 and unsound.share >= CAUGHT, least=100 * CAUGHT, rate=in_words(unsound)
        ),
    ]


def _pays(tracking: Tracking) -> Measure:
    alone = tracking.tracked["PI"]
    factors = {name: tracking.ratio("PI", name) for name in INVERSES}
    same = all(_alike(alone, tracking.tracked[name]) for name in INVERSES)
    return WORDS.measure(
        "pays",
        same and min(factors.values()) >= LOWER,
        least=LOWER,
        factors="; ".join(f"{name}: {factor:.1f}" for name, factor in factors.items()),
        gain=float(alone.margins.gain[0]),
        phase=float(alone.margins.phase_deg[0]),
        whose="all three controllers have" if same else "PI has",
        others="" if same else ", the inverses have others",
    )


def _alike(one: Tracked, other: Tracked) -> bool:
    pairs = ((getattr(one.margins, name), getattr(other.margins, name)) for name in ("gain", "phase_deg", "delay"))
    return all(bool(np.allclose(a, b, rtol=EQUAL, atol=0.0)) for a, b in pairs)


def _near(tracking: Tracking) -> Measure:
    factors = {name: tracking.ratio(name, f"oracle: {name}") for name in INVERSES}
    said = "; ".join(f"{name}: {factor:.2f}" for name, factor in factors.items())
    return WORDS.measure("near", max(factors.values()) <= NEAR, most=NEAR, factors=said)


def _scheduled(fleet: Sequence[FleetRun]) -> Measure:
    unstable = [run.actuator.name for run in fleet if not run.stable]
    ripple = max((run.steps.ripple for run in fleet), default=0.0)
    calm = f"; in the last third of each level, the output moves by at most {100 * ripple:.2g} % of a step (rms)"
    return WORDS.measure(
        "scheduled",
        bool(fleet) and not unstable,
        stable=len(fleet) - len(unstable),
        count=len(fleet),
        but=f" (not {', '.join(unstable)})" if unstable else calm,
    )


def _both(designed: Designed) -> str:
    """Return the verdict of the check, and the behaviour on the true rig."""
    true = designed.truth.text.removeprefix("in simulation with the plant model, ").replace("the plant model", "it")
    return f"`{designed.check.verdict.value}`; verdict on the true rig: `{designed.truth.verdict.value}`, {true}"


def tables(study: Study) -> list[Table]:
    """Make all tables."""
    always = [
        _tracking_table(study.tracking),
        _fleet(study.fleet),
        _models(study.matters),
        _concealed_table(study.concealed),
        _rates(study.outcomes),
    ]
    return [*always, _broken(study.outcomes)] if broken(study.outcomes) else always


def _tracking_table(every: Sequence[Tracking]) -> Table:
    return Table.of(
        "Tracking tones of 0.1 to 0.8 Hz",
        [(tracking, name, tracking.tracked[name]) for tracking in every for name in tracking.tracked],
        {
            "plant": lambda row: row[0].name,
            "controller": lambda row: row[1],
            "rms error": lambda row: _number(MICRO * row[2].rms, ".3g", " µm"),
            "rms error of the PI controller, divided by the rms error of this controller": lambda row: _number(
                row[0].ratio("PI", row[1]), ".2f"
            ),
            "this error, divided by that of the best oracle": lambda row: _number(row[2].rms / row[0].best, ".2f"),
            "gain margin with the identified model": lambda row: _number(float(row[2].margins.gain[0]), ".3g"),
            "phase margin": lambda row: _number(float(row[2].margins.phase_deg[0]), ".0f", "°"),
            "run": lambda row: row[2].run.status.name.lower().replace("_", " "),
        },
    )


def _number(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if isfinite(value) else "–"


def _fleet(runs: Sequence[FleetRun]) -> Table:
    return Table.of(
        "The scheduled design on the six actuators",
        runs,
        {
            "actuator": lambda run: run.actuator.name,
            "what happens to it": lambda run: run.actuator.story,
            "overshoot of the steps": lambda run: f"{100 * run.steps.overshoot:.0f} %",
            "mean error in the last third of each level": lambda run: f"{100 * run.steps.steady_error:.1f} %",
            "rms motion in the last third of each level": lambda run: f"{100 * run.steps.ripple:.2g} %",
            "rms error on the tones": lambda run: f"{MICRO * run.tones.rms_error:.0f} µm",
            "stable": lambda run: "yes" if run.stable else "no",
        },
    )


def _models(matters: Matters) -> Table:
    rows = []
    for m in matters.models:
        left = "diverged" if m.residual is None else f"{100 * m.residual / matters.output_rms:.2g} %"
        cells = [_promise(p) for p in m.promises] or [f"no design: {m.reason}", *[""] * (len(QUANTITIES) - 1)]
        rows.append([m.name, left, *cells])
    return Table(
        title="Predicted (95 % interval), then achieved; ✓ where it lies inside",
        columns=[
            "model",
            "free run leaves, of the recording's rms",
            *(axis_label(name, unit) for name, (unit, _) in QUANTITIES.items()),
        ],
        rows=rows,
    )


def _promise(promise: Promise) -> str:
    p = promise.predicted
    return f"{in_interval(p.value, p.low, p.high)}, {promise.achieved:.3g} {'✓' if promise.kept else '✗'}"


def _concealed_table(every: Sequence[Concealed]) -> Table:
    def causes(one: Concealed) -> str:
        return ", ".join(cause.effect.replace("_", " ") for cause in one.diagnosis.causes) or "–"

    return Table.of(
        "A concealed effect: designs from the base model and from the amended one",
        [(one, designed) for one in every for designed in (*one.designs, *one.at_other_times)],
        {
            "concealed": lambda row: row[0].effect.replace("_", " "),
            "diagnosis": lambda row: row[0].diagnosis.verdict.value,
            "its causes": lambda row: causes(row[0]),
            "designed from": lambda row: row[1].source,
            "closed-loop time": lambda row: f"{row[1].controller.closed_loop_time:g} s",
            "controller": lambda row: row[1].controller.name,
            "verdict of the check": lambda row: row[1].check.verdict.value,
            "reason": lambda row: row[1].check.reason,
            "what the true rig did": lambda row: f"{row[1].truth.verdict.value}: {row[1].truth.text}",
        },
    )


def _rates(outcomes: Sequence[Outcome]) -> Table:
    groups: list[tuple[str, list[Outcome]]] = [("all", list(outcomes))]
    keys: tuple[Callable[[Outcome], str], ...] = (
        lambda o: o.design,
        lambda o: f"concealed: {(o.concealed or NOTHING).replace('_', ' ')}",
    )
    for key in keys:
        groups += [(name, [o for o in outcomes if key(o) == name]) for name in sorted(set(map(key, outcomes)))]
    seen = [verdict.value for verdict in Verdict]
    seen += [NO_MODEL] if any(o.verdict == NO_MODEL for o in outcomes) else []
    rows = [
        [
            name,
            str(len(of)),
            *(str(sum(o.verdict == v for o in of)) for v in seen),
            *map(_cell, (inside(of), sound(of), caught(of))),
        ]
        for name, of in groups
    ]
    return Table(
        title="How often the verdict was right, by design and by concealed effect (lower bounds with 95 %)",
        columns=[
            "trials",
            "number",
            *seen,
            "of those that pass: steps inside the band",
            "of those that pass: sound on the true rig",
            "of the unsound: not passed",
        ],
        rows=rows,
    )


def _cell(rate: Rate) -> str:
    return f"{rate.hits} of {rate.count} (≥ {rate.least_percent} %)" if rate.count else "–"


def _broken(outcomes: Sequence[Outcome]) -> Table:
    return Table.of(
        "Passed trials that failed on the true rig",
        broken(outcomes),
        {
            "trial": lambda o: o.number,
            "design": lambda o: o.design,
            "closed-loop time": lambda o: f"{o.closed_loop_time:.2g} s",
            "concealed": lambda o: o.concealed.replace("_", " ") or NOTHING,
            "steps inside the band": lambda o: "–" if o.inside is None else f"{100 * o.inside:.1f} %",
            "on the true rig": lambda o: o.truth,
        },
    )


Array = NDArray[np.float64]
STRETCH = 10.0  # Length of the tones that is drawn, s
SHOWN = {
    "PI": (Hue.BEFORE, "-", "PI alone"),
    "inverse": (Hue.AFTER, "-", "PI behind the inverse"),
    "inverse with dynamics": (Hue.MARK, "-", "the same, with dynamics"),
    "oracle: inverse with dynamics": (Hue.INK, ":", "oracle, with dynamics"),
}


def drawings(study: Study) -> list[Drawing]:
    """Draw all figures."""
    return [_tracking(study.tracking[0]), _concealed(study.concealed)]


def _tracking(nominal: Tracking) -> Drawing:
    """Errors on the tones over a stretch of time, all of them and the small ones."""
    with draw((9.6, 5.2)) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        for axes, hidden in ((above, ()), (below, ("PI", "inverse"))):
            for name, (colour, line, label) in SHOWN.items():
                if name not in hidden:
                    run = nominal.tracked[name].run
                    part = slice(*np.searchsorted(run.timepts, (SETTLED, SETTLED + STRETCH)))
                    axes.plot(run.timepts[part], MICRO * run.error[part], line, color=colour, label=label)
            axes.set_ylabel("error (µm)")
        titled(above, f"{nominal.name}: all")
        titled(below, "the two smallest, enlarged")
        below.set_xlabel("time (s)")
        legend_above(figure, above, 4)
        return WORDS.drawing(figure, "tracking", settled=SETTLED)


def _concealed(every: Sequence[Concealed]) -> Drawing:
    """Draw the steps of both designs on the true plant, one panel per effect."""
    with draw((9.6, 2.0 + 2.0 * len(every))) as figure:
        panels = figure.subplots(len(every), 1, squeeze=False)[:, 0]
        for axes, one in zip(panels, every, strict=True):
            longest = max((d.runs.steps for d in one.designs), key=lambda run: run.timepts.size)
            reference = MICRO * longest.reference
            axes.plot(longest.timepts, reference, color=Hue.INK, linewidth=2.4, alpha=0.3, label="reference")
            for designed, colour in zip(one.designs, (Hue.BEFORE, Hue.AFTER), strict=True):
                run, label = designed.runs.steps, f"design from the {designed.source} model"
                axes.plot(run.timepts, MICRO * run.output, color=colour, label=label)
            said, was = (
                ", ".join(f"{d.source} {getattr(d, kind).verdict.value}" for d in one.designs)
                for kind in ("check", "truth")
            )
            titled(axes, f"{one.effect.replace('_', ' ')} concealed. Check: {said}. True rig: {was}")
            axes.set_ylabel("displacement (µm)")
        panels[-1].set_xlabel("time (s)")
        legend_above(figure, panels[0], 3)
        return WORDS.drawing(figure, "concealed")
