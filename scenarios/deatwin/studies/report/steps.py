"""The steps of a diagnosis as drawings and as rows of tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from deatwin.ident.mismatch import Diagnosis, Findings, VerificationSummary
from deatwin.ident.mismatch.quality.noise import NoiseSource
from deatwin.ident.mismatch.say import rig_field, unit_of
from deatwin.plant.amplitudes import amount
from deatwin.plant.drawing import Figure
from deatwin.studies.report.drawing import Drawing, draw
from deatwin.studies.report.quantities import quantity, three_digits, with_interval
from deatwin.studies.report.tables import drawn_table

STEPS = ("checked", "detection", "region", "place", "lines", "free_form", "advice", "verification")
WIDTH = 6.4
ROW = 0.3  # Height of a row in figures with a row for each part, in inches


def step_drawings(diagnosis: Diagnosis) -> tuple[dict[str, Drawing | None], dict[str, str]]:
    """Draw the result of each step that was taken."""
    found: dict[str, Drawing | None] = dict.fromkeys(STEPS)
    tables: dict[str, str] = {}
    if diagnosis.findings is None:
        return found, tables
    for step, (size, title, caption, into) in _drawable(diagnosis, diagnosis.findings).items():
        with draw(size) as figure:
            into(figure)
            found[step] = drawing = Drawing.of(figure, step, title, caption)
            tables[drawing.data] = drawn_table(figure)
    return found, tables


Drawable = tuple[tuple[float, float], str, str, Callable[["Figure"], object]]


def _drawable(diagnosis: Diagnosis, findings: Findings) -> dict[str, Drawable]:
    """Return size, title, caption and drawing function of each step's figure."""
    found: dict[str, Drawable] = {}
    found["checked"] = (
        (WIDTH, 3.2),
        "The readings",
        "The readings as recorded. Marks show jumps, and samples that are stuck, outlying, clipped or noisier than elsewhere.",
        lambda figure: findings.checked.plot(figure.add_subplot()),
    )
    found["detection"] = (
        (WIDTH, 8.4),
        "Tests of the residual",
        "Residual of the calibrated model: its spectrum, its cumulative periodogram, and its correlations with time and with "
        "functions of the command. In each correlation, the lag grows from left to right. If the model lacked nothing, the "
        "curves of a panel would stay inside the grey range in 99 % of all recordings.",
        lambda figure: findings.detection.plot(list(figure.subplots(3, 1))),
    )
    if (location := findings.location) is not None:
        units = {one.signal: unit_of(one.signal, diagnosis) for one in location.region.bins}
        found["region"] = (
            (WIDTH, 3.6),
            "The operating region",
            "Mean residual (measured minus simulated) over each signal. The bars extend two standard errors to both sides of the mean.",
            lambda figure: location.region.plot(figure.add_subplot(), units),
        )
        if location.place.opened:
            found["place"] = (
                (WIDTH, 4.2),
                "Signals that predict the mismatch",
                "Share of the mismatch that a regression without physics predicts from the signals at each place of the "
                "measuring chain, on data to which the regression was not fitted.",
                lambda figure: location.place.plot(figure.add_subplot()),
            )
        if (lines := location.lines) is not None:
            found["lines"] = (
                (WIDTH, 3.4),
                "Frequencies of the periodic input",
                "Rms residual at the harmonics of the periodic input. The last bar shows the part of the residual that "
                "differs between periods; the other bars show the part that repeats in every period. A small p-value means "
                "that chance alone would rarely make a bar this high.",
                lambda figure: lines.plot(figure.add_subplot(), unit=location.unit),
            )
    if (discovery := findings.discovery) is not None:
        found["free_form"] = (
            (WIDTH, 4.0),
            "The formula without physics",
            "Signal that the model lacks, as estimated from the recordings and as given by the formula. The formula names no "
            "cause.",
            lambda figure: discovery.plot(figure.add_subplot()),
        )
    if (advice := findings.advice) is not None:
        found["advice"] = (
            (WIDTH, 4.4),
            "The next experiment",
            "The advised input (right axis), and how far the prediction of each explanation differs from that of the first "
            "explanation (left axis).",
            lambda figure: advice.plot(figure.add_subplot()),
        )
    if findings.named:
        held = findings.verification
        parts = " and on parts of them" if held.transfers else ""
        rows = 1 + len(held.transfers) + len(held.ablations) + sum(s.share is not None for s in held.shams)
        found["verification"] = (
            (WIDTH, 1.3 + ROW * rows),
            "Errors on held-out data",
            f"Errors before and after the explanation is added, on all held-out data{parts}. In the other rows, "
            "one effect of the explanation is removed or replaced by a placebo. A placebo is a copy of the effect with wrong "
            "physics, and should fit less well.",
            lambda figure: held.plot(figure.add_subplot()),
        )
    return found


def noise_source(diagnosis: Diagnosis) -> str:
    """Return the source of the noise level in words; empty if the file does not state it."""
    name = (diagnosis.detection.noise_source or "").upper()
    return NoiseSource[name].value if name in NoiseSource.__members__ else ""


def parameters(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the rows of the table of the calibrated base plant."""
    rows = []
    for name, fitted in diagnosis.parameters.items():
        value, interval = with_interval(fitted.value, fitted.low, fitted.high, fitted.unit)
        interval = "undetermined" if fitted.undetermined else interval
        before = "" if fitted.nominal is None else quantity(fitted.nominal, fitted.unit)
        if fitted.nominal == 0.0:  # has no prefix of its own
            before = amount("0", fitted.shown.unit)
        rows.append({"name": name, "before": before, "value": value, "interval": interval, "at_bound": fitted.at_bound})
    return rows


def forms(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the rows of the table of the interpretations of the rig file, the chosen one first."""
    if len(diagnosis.forms) < 2:
        return []
    rows = []
    for place, form in enumerate(diagnosis.forms):
        read = ", ".join(rig_field(name, value) for name, value in form.form.items()) or "as the rig file states"
        rows.append({"read": read, "fitted": form.fitted, "unseen": form.unseen, "chosen": place == 0})
    return rows


def shams(found: VerificationSummary | None) -> list[dict[str, Any]]:
    """Return the rows of the table of placebo effects, each with its gain as shown."""
    return [
        {"sham": sham, "shown": sham.skipped if sham.share is None else f"{three_digits(100 * sham.share)} %"}
        for sham in (() if found is None else found.shams)
    ]
