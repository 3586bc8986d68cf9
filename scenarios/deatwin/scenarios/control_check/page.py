"""Goals, results, tables and figures of the page."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from deatwin.control import Verdict
from deatwin.plant.amplitudes import axis_label
from deatwin.plant.words import spaced
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
    calm = (
        "; in the last third of each constant reference, the rms motion of the output is at most "
        f"{100 * ripple:.2g} % of the step"
    )
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
    rows = []
    for tracking, name, one in [(t, key, tracked) for t in every for key, tracked in t.tracked.items()]:
        ratios = [_number(ratio, ".2f") for ratio in (tracking.ratio("PI", name), one.rms / tracking.best)]
        gain, phase = float(one.margins.gain[0]), float(one.margins.phase_deg[0])
        margins = [_number(gain, ".3g"), _number(phase, ".0f", "°")]
        status = spaced(one.run.status.name.lower())
        rows.append([tracking.name, name, _number(MICRO * one.rms, ".3g", " µm"), *ratios, *margins, status])
    return WORDS.table("tracking", rows)


def _number(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if isfinite(value) else "–"


def _fleet(runs: Sequence[FleetRun]) -> Table:
    rows = []
    for run in runs:
        shares = [100 * share for share in (run.steps.overshoot, run.steps.steady_error, run.steps.ripple)]
        steps = [f"{share:{form}} %" for share, form in zip(shares, (".0f", ".1f", ".2g"), strict=True)]
        tones, stable = f"{MICRO * run.tones.rms_error:.0f} µm", "yes" if run.stable else "no"
        rows.append([run.actuator.name, run.actuator.story, *steps, tones, stable])
    return WORDS.table("fleet", rows)


def _models(matters: Matters) -> Table:
    rows = []
    for m in matters.models:
        left = "diverged" if m.residual is None else f"{100 * m.residual / matters.output_rms:.2g} %"
        cells = [_promise(p) for p in m.promises] or [f"no design: {m.reason}", *[""] * (len(QUANTITIES) - 1)]
        rows.append([m.name, left, *cells])
    return WORDS.table("models", rows, *(axis_label(name, unit) for name, (unit, _) in QUANTITIES.items()))


def _promise(promise: Promise) -> str:
    p = promise.predicted
    return f"{in_interval(p.value, p.low, p.high)}, {promise.achieved:.3g} {'✓' if promise.kept else '✗'}"


def _concealed_table(every: Sequence[Concealed]) -> Table:
    rows = []
    designs = [(each, designed) for each in every for designed in (*each.designs, *each.at_other_times)]
    for one, designed in designs:
        causes = ", ".join(spaced(cause.effect) for cause in one.diagnosis.causes) or "–"
        law, found, truth = designed.controller, designed.check, designed.truth
        told = [spaced(one.effect), one.diagnosis.verdict.value, causes, designed.source]
        design = [f"{law.closed_loop_time:g} s", law.name, found.verdict.value, found.reason]
        rows.append([*told, *design, f"{truth.verdict.value}: {truth.text}"])
    return WORDS.table("concealed", rows)


def _rates(outcomes: Sequence[Outcome]) -> Table:
    concealed = [f"concealed: {spaced(o.concealed or NOTHING)}" for o in outcomes]
    groups = {"all": list(outcomes)}
    for names in ([o.design for o in outcomes], concealed):
        for name in sorted(set(names)):
            groups[name] = [o for o, its in zip(outcomes, names, strict=True) if its == name]
    seen = [verdict.value for verdict in Verdict]
    seen += [NO_MODEL] if any(o.verdict == NO_MODEL for o in outcomes) else []
    rows = []
    for name, of in groups.items():
        counts = [str(sum(o.verdict == verdict for o in of)) for verdict in seen]
        rows.append([name, str(len(of)), *counts, *map(_cell, (inside(of), sound(of), caught(of)))])
    return WORDS.table("rates", rows, *seen, *WORDS.texts("table.rates.further"))


def _cell(rate: Rate) -> str:
    return f"{rate.hits} of {rate.count} (≥ {rate.least_percent} %)" if rate.count else "–"


def _broken(outcomes: Sequence[Outcome]) -> Table:
    rows = []
    for o in broken(outcomes):
        share = "–" if o.inside is None else f"{100 * o.inside:.1f} %"
        concealed = spaced(o.concealed) or NOTHING
        rows.append([str(o.number), o.design, f"{o.closed_loop_time:.2g} s", concealed, share, o.truth])
    return WORDS.table("broken", rows)


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
                run, label = designed.runs.steps, f"design from the {designed.source} plant"
                axes.plot(run.timepts, MICRO * run.output, color=colour, label=label)
            said, was = (
                ", ".join(f"{d.source} {getattr(d, kind).verdict.value}" for d in one.designs)
                for kind in ("check", "truth")
            )
            titled(axes, f"{spaced(one.effect)} concealed. Check: {said}. True rig: {was}")
            axes.set_ylabel("displacement (µm)")
        panels[-1].set_xlabel("time (s)")
        legend_above(figure, panels[0], 3)
        return WORDS.drawing(figure, "concealed")
