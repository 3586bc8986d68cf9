"""Write the page of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deatwin.ident.mismatch import Diagnosis, Findings, LocationSummary, VerificationSummary
from deatwin.ident.mismatch.certainty import HARDLY, how_sure, next_step, percent
from deatwin.ident.mismatch.quality.noise import NoiseSource
from deatwin.ident.mismatch.say import at_body, called, in_percent, notes_of, or_listed, ranked, rig_field, unit_of
from deatwin.plant.amplitudes import amount, reported_size, written_unit
from deatwin.plant.drawing import Figure
from deatwin.plant.effects.titles import effects_in_words
from deatwin.plant.words import spaced
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.drawing import Drawing, draw
from deatwin.studies.report.figures import LEAST_SHARE, drawings
from deatwin.studies.report.quantities import quantity, three_digits, with_interval
from deatwin.studies.report.rendering import Origin, write_page
from deatwin.studies.report.tables import drawn_table

MOST_LINES = 6
STATISTICS = {
    "variance ratio": "mean square of the residual, divided by that of noise and model error",
    "cumulative periodogram": "distance of the cumulative periodogram from that of noise",
    "correlation with the command": "largest correlation of the residual with command or time",
    "correlation of the square": "correlation of the squared residual with command or time",
}
"""Statistics of the residual in words, by their names in the file."""


def write_report(folder: ResultFolder, diagnosis: Diagnosis, origin: Origin) -> None:
    """Write ``report.html`` and the data of its figures."""
    figures, files = drawings(diagnosis)
    for name, columns in files.items():
        folder.csv(name, columns)
    steps, tables = step_drawings(diagnosis)
    for name, table in tables.items():
        folder.text(name, table)
    unit = diagnosis.output.unit
    write_page(
        folder,
        "diagnosis.html.j2",
        [*figures, *filter(None, steps.values())],
        origin,
        diagnosis=diagnosis,
        certainty=how_sure(diagnosis),
        next_step=next_step(diagnosis),
        notes=notes_of(diagnosis),
        possible=_possible(diagnosis),
        alike=_alike(diagnosis),
        statistics=STATISTICS,
        unit=written_unit(unit),
        figures={figure.name: figure for figure in figures},
        steps=steps,
        noise_source=noise_source(diagnosis),
        parameters=parameters(diagnosis),
        forms=forms(diagnosis),
        shams=shams(diagnosis.verification),
        causes=_causes(diagnosis),
        candidates=_candidates(diagnosis),
        located=_located(diagnosis.location),
        places=_places(diagnosis),
        at_body=lambda place: at_body(place, diagnosis),
        units=_signal_units(diagnosis),
    )


def _possible(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return the rows of the table of possible explanations, if there are several."""
    found = [(called(one.effects, diagnosis), percent(one.probability)) for one in ranked(diagnosis)]
    return found if len(found) > 1 else []


def _alike(diagnosis: Diagnosis) -> str:
    """Name the alternatives that the recordings cannot distinguish from the answer, with their d²."""
    pairs = ((called(pair.effects[1].split("+"), diagnosis), pair.d2) for pair in diagnosis.indistinguishable)
    return or_listed([f"{name} (d² = {three_digits(d2)})" for name, d2 in pairs])


def _causes(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the rows of the table of causes, one for each parameter."""
    rows = []
    for cause in diagnosis.causes:
        shown = {n: in_percent(n, p) for n, p in cause.parameters.items()}
        values = {n: with_interval(p.value, p.low, p.high, p.unit) for n, p in shown.items()}
        rows.append({"cause": cause, "parameters": values, "rows": max(1, len(values))})
    return rows


def _located(found: LocationSummary | None) -> LocationSummary | None:
    """Return the most important locations; the file contains all of them."""
    if found is None:
        return None
    return replace(
        found,
        time=tuple(w for w in found.time if w.score >= LEAST_SHARE),
        frequency=found.frequency[:MOST_LINES],
        response=(found.response or ())[:MOST_LINES],
        region=tuple(sorted(found.region, key=lambda r: -abs(r.mean_residual)))[:MOST_LINES],
    )


def _places(diagnosis: Diagnosis) -> list[tuple[str, list[str]]]:
    """Return the rows of places with the shares that effects explain and signals predict, the largest share first."""
    places = diagnosis.location.place if diagnosis.location else ()
    rows = []
    for place in places:
        name = at_body(spaced(": ".join(filter(None, (place.place, place.signal)))), diagnosis)
        name = "a parameter of the model" if name == "parameter" else name
        shares = {"can be predicted from the signals there": place.explained}
        if place.explained is None or place.effect is not None:
            one = f"{effects_in_words(place.effect)} alone" if place.effect else "an effect"
            best = "the best effect there" if place.score < HARDLY else one
            shares = {f"is explained by {best}": place.score, **shares}
        known = {what: max(share, 0.0) for what, share in shares.items() if share is not None}
        rows.append((max(known.values()), name, [f"{100 * share:.0f} % {what}" for what, share in known.items()]))
    return [(name, shares) for _, name, shares in sorted(rows, key=lambda row: -row[0])]


def _signal_units(diagnosis: Diagnosis) -> dict[str, str]:
    """Units of the operating signals of all regions, as the page shows them; empty where unknown."""
    located = diagnosis.location.region if diagnosis.location else ()
    left = diagnosis.unexplained.region if diagnosis.unexplained else None
    return {region.signal: unit_of(region.signal, diagnosis) for region in (*located, *([left] if left else []))}


def _candidates(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the rows of the table of candidates, the best on held-out data first."""
    if diagnosis.readings is None:
        return []
    size = reported_size(diagnosis.output.unit, diagnosis.readings.experiments[0].recordings[0].output_units[0])
    causes, plant = {cause.effect for cause in diagnosis.causes}, diagnosis.model and diagnosis.model.plant
    chosen = {effect.name for effect in plant.effects if effect.cause in causes} if plant else causes
    rows = [
        {
            "effects": " + ".join(c.effects) or "none (the calibrated model)",
            "fitted": c.fitted / size,
            "unseen": c.unseen / size,
            "d2": c.d2,
            "chosen": bool(causes) and set(c.effects) == chosen,
        }
        for c in diagnosis.candidates
    ]
    return sorted(rows, key=lambda row: row["unseen"])


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
