"""Write the page of a diagnosis."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from deatwin.ident.mismatch import Diagnosis, LocationSummary
from deatwin.ident.mismatch.certainty import HARDLY, how_sure, next_step, percent
from deatwin.ident.mismatch.say import at_body, called, in_percent, notes_of, or_listed, ranked, unit_of
from deatwin.plant.amplitudes import reported_size, written_unit
from deatwin.plant.effects.titles import effects_in_words
from deatwin.plant.words import spaced
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.figures import LEAST_SHARE, drawings
from deatwin.studies.report.quantities import three_digits, with_interval
from deatwin.studies.report.rendering import Origin, write_page
from deatwin.studies.report.steps import forms, noise_source, parameters, shams, step_drawings

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
