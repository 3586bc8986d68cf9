"""The page of a check."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from deatwin.app.check_report.findings import TONES, groups
from deatwin.app.check_report.gains import written_gains
from deatwin.app.check_report.margin_figures import draw_margins, draw_margins_over_time, draw_nyquist
from deatwin.app.check_report.run_figures import draw_others, draw_sine, draw_steps
from deatwin.app.check_report.view import View
from deatwin.control import Check, Verdict
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.rendering import Origin, write_page

NEXT = {
    Verdict.PASS: "write the controller as C source with deatwin export check.json --to c, and try small steps on the actuator.",
    Verdict.MARGINAL: "remove the cause named above, or try another --design or a longer --closed-loop-time.",
    Verdict.FAIL: "do not use this controller; remove the cause named above, or try another --design or a longer "
    "--closed-loop-time.",
}


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A number at the top of the page."""

    name: str
    value: str
    unit: str = ""


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
        caveats=[_capital(text) for text in check.caveats],
        gains=written_gains(check),
        controller=check.controller,
        operating=check.operating,
        samples=check.margins.samples if check.margins else 0,
    )


def _verdict(check: Check) -> tuple[str, list[str]]:
    """Return the check's sentence with the decisive finding, and the other findings of the same severity."""
    head = check.sentence.removeprefix(f"{check.verdict.value}: ")
    head = f"{head.partition(f'{check.reason}.')[0]}{check.reason}."  # the caveats are shown below it
    more = [f.text for f in check.findings if f.verdict is check.verdict and f is not check.worst_case]
    if check.verdict is Verdict.PASS or not more:
        return _capital(head), []
    return _capital(f"{head.removesuffix(f'{check.reason}.')}{check.worst_case.text}."), [_capital(t) for t in more]


def _capital(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"


def _drawn(view: View) -> list[Drawing]:
    """Draw the available figures, in the order of the page."""
    check = view.check
    found = []
    if check.steps is not None and check.steps.timepts.size:
        found.append(draw_steps(view, check.steps))
    others = {name: run for name, run in check.others.items() if run.timepts.size}
    if others:
        found.append(draw_others(view, others))
    if view.rows(along_time=False):
        found.append(draw_margins(view))
    if view.rows(along_time=True):
        found.append(draw_margins_over_time(view))
    if check.controller is not None:
        found.append(draw_nyquist(view, check.controller))
    if check.sine is not None and check.sine.timepts.size:
        found.append(draw_sine(view, check.sine))
    return found


def _tiles(view: View) -> list[Tile]:
    check, at = view.check, view.check.operating
    input_unit = "" if at.input_unit == "1" else at.input_unit
    tiles = [Tile(name="operating input", value=three_digits(at.input), unit=input_unit)]
    if at.output is not None:
        tiles.append(
            Tile(name="output at the operating input", value=three_digits(at.output / view.size), unit=view.shown_unit)
        )
    if check.controller is None or check.margins is None:
        return tiles
    promised = check.margins
    tiles += [
        Tile(name="controller", value=check.controller.name),
        Tile(name="closed-loop time", value=three_digits(check.controller.closed_loop_time), unit="s"),
        Tile(name="crossover at the operating input", value=three_digits(promised.crossover_Hz), unit="Hz"),
    ]
    if check.excited_band_Hz is not None:
        tiles.append(
            Tile(
                name="highest frequency that the recording excited",
                value=three_digits(check.excited_band_Hz),
                unit="Hz",
            )
        )
    if check.steps is not None:
        tiles.append(
            Tile(
                name="error on the steps, with the plant model",
                value=three_digits(check.steps.rms_error / view.size),
                unit=f"{view.shown_unit} rms".strip(),
            )
        )
    return tiles


def _margins_here(view: View) -> list[tuple[str, ...]]:
    """Return the rows of margins at the operating point: of the model, of its draws, and linearised."""
    check = view.check
    if check.controller is None or check.margins is None:
        return []
    own, spec, h = check.margins, view.specification, check.operating.sample_time
    first = next((row for row in check.table if row.source.startswith("model ")), None)
    kinds = (
        ("gain", "gain", "gain_low", spec.gain, 1.0, ""),
        ("phase", "phase_deg", "phase_low_deg", spec.phase_deg, 1.0, "°"),
        ("delay", "delay", "delay_low", spec.delay_samples, h, " samples"),
        ("disk", "disk", "disk_low", spec.disk, 1.0, ""),
    )
    return [
        (
            name,
            _written(getattr(own, field) / scale, unit),
            _written(getattr(own, low) / scale, unit),
            "–" if first is None else _written(getattr(first, low) / scale, unit),
            _written(limit.good, unit),
            _written(limit.poor, unit),
        )
        for name, field, low, limit, scale, unit in kinds
    ]


def _written(value: float, unit: str) -> str:
    return f"{value:.3g}{unit}" if isfinite(value) else "∞"
