"""The page of a check: its numbers, the table of findings with their limits, and the gains of the controller."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite

from deatwin.app.check_report.figures import draw_margins, draw_nyquist, draw_others, draw_sine, draw_steps
from deatwin.app.check_report.view import View
from deatwin.control import Check, PidGains, Verdict
from deatwin.control.checking.amounts import amount
from deatwin.control.checking.rows import BAND
from deatwin.control.checking.specification import Limit
from deatwin.control.checking.verdict import Finding
from deatwin.plant.amplitudes import written_amplitude
from deatwin.plant.words import as_sentence
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.rendering import Origin, write_page


def written_gains(check: Check) -> list[tuple[str, str]]:
    """Return name and value of each gain of a PI or PID law at the operating input; empty for other laws."""
    controller = check.controller
    if controller is None:
        return []
    gains = PidGains.of_law(controller.local(controller.operating_input), controller.sample_time)
    if gains is None:
        return []
    output_unit, size = written_amplitude(check.operating.output_unit)
    below = "" if output_unit in ("", "1") else output_unit
    above = check.operating.input_unit if check.operating.input_unit not in ("", "1") else ""
    entries = [
        ("proportional gain", gains.proportional * size, _ratio(above, below)),
        ("integral gain", gains.integral * size, _ratio(above, f"{below} s".strip())),
    ]
    if gains.derivative:
        entries += [
            ("derivative gain", gains.derivative * size, _ratio(f"{above} s".strip(), below)),
            ("time constant of the derivative's filter", gains.filter_time, "s"),
        ]
    return [(name, f"{value:.4g} {unit}".rstrip()) for name, value, unit in entries]


def _ratio(above: str, below: str) -> str:
    """Return the quotient of two units; pure numbers have none."""
    if not below:
        return above
    return f"{above or '1'}/({below})" if " " in below else f"{above or '1'}/{below}"


TONES = {Verdict.PASS: "good", Verdict.MARGINAL: "doubt", Verdict.FAIL: "bad"}  # Classes of the page's style


@dataclass(frozen=True, kw_only=True)
class Row:
    """A line of the table."""

    subject: str
    value: str
    good: str
    poor: str
    verdict: str
    tone: str
    text: str


@dataclass(frozen=True, kw_only=True)
class Group:
    """Lines of the table that belong together."""

    title: str  # Heading
    rows: list[Row]


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """Format of the findings on one quantity."""

    group: str  # Heading, in which ``{}`` stands for the source
    form: str = ".3g"  # Format of a number, and its unit with the space before it
    unit: str = ""
    scale: float = 1.0
    limit: str = ""  # Field of the specification; empty if there is none

    def value(self, value: float | None) -> str:
        """Write the value of a finding."""
        if value is None:
            return "–"
        return amount(self.scale * value, self.form, self.unit) if isfinite(value) else "∞"

    def asked(self, value: float) -> str:
        """Write a limit, whatever its size."""
        return f"{self.scale * value:{self.form}}{self.unit}"


def groups(view: View) -> list[Group]:
    """Arrange the findings of a check in groups."""
    found: dict[str, list[Row]] = {}
    for finding in view.check.findings:
        subject, source = _split(finding.subject, view)
        kind = _KINDS.get(subject, _Kind(group="Further findings"))
        label = view.looks[source].label
        whose = f"the {label}" if re.split("[ ,]", source)[0] in ("model", "plant") else label
        found.setdefault(kind.group.format(whose), []).append(_row(finding, subject, kind, view))
    return [Group(title=title, rows=rows) for title, rows in found.items()]


def _split(subject: str, view: View) -> tuple[str, str]:
    """Split a finding's subject into its name and its source; the model and the plant model need no brackets."""
    match = re.fullmatch(r"(.+?) \((.+)\)", subject)
    if match is not None and match[2] in view.looks:
        return match[1], match[2]
    return subject, "model" if subject in _MARGINS else "plant"


def _row(finding: Finding, subject: str, kind: _Kind, view: View) -> Row:
    good, poor = _limits(finding, subject, kind, view)
    return Row(
        subject=subject,
        value=kind.value(finding.value),
        good=good,
        poor=poor,
        verdict=finding.verdict.value,
        tone=TONES[finding.verdict],
        text=finding.text,
    )


def _limits(finding: Finding, subject: str, kind: _Kind, view: View) -> tuple[str, str]:
    """Write the limits for a pass and for marginal."""
    if kind.limit:
        limit: Limit = getattr(view.specification.on_a_stand_in, kind.limit)
        sign = "≥" if limit.good > limit.poor else "≤"
        return f"{sign} {kind.asked(limit.good)}", f"{sign} {kind.asked(limit.poor)}"
    if subject == "excitation" and view.check.excited_band_Hz is not None:
        band = view.check.excited_band_Hz
        if finding.verdict is Verdict.MARGINAL and finding.value is not None and finding.value <= band:
            return "in no gap", "in a gap"
        return f"≤ {kind.asked(band)}", "beyond"
    return {
        "film": ("none", "only at the limits"),
        "training data": ("inside", "beyond"),
        "width of the prediction": (f"≤ {view.specification.width.good:g} times", "wider"),
    }.get(subject, ("–", "–"))


_percent = partial(_Kind, unit=" %", scale=100.0)
_OF_RUNS = "Simulation with {}"
_MARGINS: Mapping[str, _Kind] = {
    name: _Kind(group="Margins of {}", form=form, unit=unit, scale=scale, limit=limit)
    for name, form, unit, scale, limit in (
        ("stability", ".3g", " %", 100.0, "stable_share"),
        ("gain margin", ".2f", "", 1.0, "gain"),
        ("phase margin", ".0f", "°", 1.0, "phase_deg"),
        ("delay margin", ".1f", " samples", 1.0, "delay_samples"),
        ("disk margin", ".2f", "", 1.0, "disk"),
    )
}
_KINDS: Mapping[str, _Kind] = {
    **_MARGINS,
    "plant": _Kind(group=_OF_RUNS),
    "overshoot": _percent(group=_OF_RUNS, limit="overshoot"),
    "steady-state error": _percent(group=_OF_RUNS, limit="steady_error"),
    "ripple": _percent(group=_OF_RUNS, limit="ripple"),
    "saturation": _percent(group=_OF_RUNS, limit="saturated"),
    "tracking": _Kind(group=_OF_RUNS, form=".2f", unit=" times", limit="tracking"),
    "gain margin on the plant": _Kind(group=_OF_RUNS, form=".2g", unit=" times", limit="gain"),
    "model in closed loop": _percent(group="Prediction", limit="diverged"),
    "prediction": _percent(group="Prediction", limit="inside"),
    "width of the prediction": _Kind(group="Prediction", form=".2g", unit=" times"),
    "training data": _Kind(group="Excitation"),
    "film": _Kind(group="Film", form=".0f", unit=" actuators"),
    "limit cycle": _percent(group="Limit cycles", limit="limit_cycle"),
    "unstable limit cycle": _percent(group="Limit cycles", limit="safe_region"),
    "excitation": _Kind(group="Excitation", form=".2f", unit=" Hz"),
    "model": _Kind(group="Design"),
    "design": _Kind(group="Design"),
}


NEXT = {
    Verdict.PASS: "export the controller as C source with `deatwin export check.json --to c`, and try small steps on the actuator.",
    Verdict.MARGINAL: "remove the cause that is named above, or try another `--design` or a longer `--closed-loop-time`.",
    Verdict.FAIL: "do not use this controller; remove the cause that is named above, or try another `--design` or a longer "
    "`--closed-loop-time`.",
}


def write_check_report(folder: ResultFolder, view: View, origin: Origin) -> None:
    """Write ``report.html`` and the data of its figures."""
    drawn = _drawn(view)
    for drawing in drawn:
        drawing.save_data(folder)
    check = view.check
    sentence, more = _verdict(check)
    write_page(
        folder,
        "check.html.j2",
        drawn,
        origin,
        __package__,
        verdict=check.verdict.value,
        tone=TONES[check.verdict],
        sentence=sentence,
        more=more,
        next=NEXT[check.verdict],
        tiles=_tiles(view),
        groups=groups(view),
        figures={drawing.name: drawing for drawing in drawn},
        here=_margins_here(view),
        linearised=any(row.source == BAND for row in check.table),
        drawn_plants=any(row.source.startswith("plant") and row.samples > 1 for row in check.table),
        caveats=check.caveats,
        gains=written_gains(check),
        controller=check.controller,
        operating=check.operating,
        samples=check.margins.samples if check.margins else 0,
    )


def _verdict(check: Check) -> tuple[str, list[str]]:
    """Return the decisive finding, and the other findings of the same severity."""
    if check.verdict is Verdict.PASS:
        return as_sentence(check.reason), []
    more = [f.text for f in check.findings if f.verdict is check.verdict and f is not check.worst_case]
    return as_sentence(check.worst_case.text), more


def _drawn(view: View) -> list[Drawing]:
    """Draw the available figures, in the order of the page."""
    check = view.check
    found = []
    if check.steps is not None and check.steps.timepts.size:
        found.append(draw_steps(view, check.steps))
    others = {name: run for name, run in check.others.items() if run.timepts.size}
    if others:
        found.append(draw_others(view, others))
    found += [draw_margins(view, along_time=along) for along in (False, True) if view.rows(along)]
    if check.controller is not None:
        found.append(draw_nyquist(view, check.controller))
    if check.sine is not None and check.sine.timepts.size:
        found.append(draw_sine(view, check.sine))
    return found


def _tiles(view: View) -> list[tuple[str, str, str]]:
    """Return name, value and unit of each number at the top of the page."""
    check, at = view.check, view.check.operating
    tiles = [("operating input", three_digits(at.input), "" if at.input_unit == "1" else at.input_unit)]
    if at.output is not None:
        tiles.append(("output at the operating input", three_digits(at.output / view.size), view.shown_unit))
    if check.controller is None or check.margins is None:
        return tiles
    tiles += [
        ("controller", check.controller.name, ""),
        ("closed-loop time", three_digits(check.controller.closed_loop_time), "s"),
        ("crossover at the operating input", three_digits(check.margins.crossover_Hz), "Hz"),
    ]
    if check.excited_band_Hz is not None:
        tiles.append(("highest frequency that the recording excited", three_digits(check.excited_band_Hz), "Hz"))
    if check.steps is not None:
        error, unit = three_digits(check.steps.rms_error / view.size), f"{view.shown_unit} rms".strip()
        tiles.append(("error on steps in simulation with the plant model", error, unit))
    return tiles


def _margins_here(view: View) -> list[tuple[str, ...]]:
    """Return the rows of margins at the operating point: of the model, of its draws and, if known, linearised."""
    check = view.check
    if check.controller is None or check.margins is None:
        return []
    own, spec, h = check.margins, view.specification, check.operating.sample_time
    lows = [own, *(row for row in check.table if row.source == BAND)]
    kinds = (
        ("gain", "gain", "gain_low", spec.gain, 1.0),
        ("phase", "phase_deg", "phase_low_deg", spec.phase_deg, 1.0),
        ("delay", "delay", "delay_low", spec.delay_samples, h),
        ("disk", "disk", "disk_low", spec.disk, 1.0),
    )
    return [
        (
            name,
            *(kind.value(value / scale) for value in (getattr(own, field), *(getattr(row, low) for row in lows))),
            kind.asked(limit.good),
            kind.asked(limit.poor),
        )
        for name, field, low, limit, scale in kinds
        for kind in [_MARGINS[f"{name} margin"]]
    ]
