"""The tables of the story: table 4.3 of the thesis, the responses in numbers, and how well the NOFRFs are posed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.frequency.closed_forms import SYSTEMS
from deatwin.scenarios.frequency_analysis.actuators import FREQUENCIES, TABLED, Actuators, Analysed
from deatwin.scenarios.frequency_analysis.benchmarks import Benchmarks
from deatwin.studies.report.story import Table

UNITS = "SI: m, V"


def tables(found: Benchmarks, fleet: Actuators) -> list[Table]:
    """Make all tables."""
    shown = next(one for one in fleet.each if one.name == fleet.sampled.name)
    return [_closed(found), _removal(shown), _deviations(fleet.each), _gains(fleet.each), _posed(fleet.each)]


def _closed(found: Benchmarks) -> Table:
    rows = [
        [system.name, system.shown, *(_error(found.errors[system.name].get(order)) for order in (1, 2, 3, 4))]
        for system in SYSTEMS
    ]
    return Table(
        title="Frequency responses against closed forms: largest error over the largest gain",
        columns=["system", "equation", "H₁", "H₂", "H₃", "H₄"],
        rows=rows,
    )


def _error(error: float | None) -> str:
    return "–" if error is None else f"{error:.0e}" if error else "0"


def _removal(one: Analysed) -> Table:
    removal = one.removal
    before, after = (dict(zip(m.terms, m.theta, strict=True)) for m in (removal.model, removal.shifted.model))
    every = sorted({*before, *after}, key=lambda term: (term.degree, term.factors))
    rows = [
        [str(term), *(f"{values[term]:.4g}" if term in values else "–" for values in (before, after))] for term in every
    ]
    point = removal.shifted.point
    return Table(
        title=f"Removal of the DC component, {one.name} (thesis table 4.3)",
        columns=[
            "term",
            f"parameter ({UNITS})",
            f"of deviations from {point.operating_input[0]:.3f} V and {1e3 * point.output:.3f} mm",
        ],
        rows=rows,
    )


def _deviations(each: Sequence[Analysed]) -> Table:
    """The operating points, and what the removal and the deletion of the constant do."""
    rows = []
    for one in each:
        removal = one.removal
        point = removal.shifted.point
        model = removal.model
        rows.append(
            [
                one.name,
                f"{point.operating_input[0]:.3f} V",
                f"{1e3 * point.output:.3f} mm",
                "stable" if point.is_stable else "unstable",
                f"{len(model.terms)} and {len(removal.shifted.model.terms)}",
                f"{removal.error:.0e}",
                f"{removal.deleted_error:.2f}",
                f"{one.alike.fit_percent:.1f} %",
            ]
        )
    return Table(
        title="Removal of the DC component at the mean of each actuator's training commands",
        rows=rows,
        columns=[
            "actuator",
            "mean command",
            "equilibrium",
            "there",
            "terms before and after",
            "free run: largest change over the stroke",
            "with only a constant left out: rms change over the deviation",
            "held-out fit of the free run",
        ],
    )


def _gains(each: Sequence[Analysed]) -> Table:
    places = [int(np.argmin(np.abs(FREQUENCIES - f))) for f in TABLED]
    rows = []
    for one in each:
        gain, deviation = 1e6 * one.first.gain, 1e6 * one.first.gain_deviation
        rows.append([one.name, *(f"{gain[i]:.1f} ± {1.96 * deviation[i]:.1f}" for i in places)])
    columns = ["actuator", *(f"{f:g} Hz" for f in TABLED)]
    return Table(title="|H₁| in µm/V with 95 % bands (beyond 1 Hz extrapolated)", columns=columns, rows=rows)


def _posed(each: Sequence[Analysed]) -> Table:
    rows = []
    for one in each:
        fitted = one.fitted
        rows.append(
            [
                one.name,
                f"{fitted.highest} at {fitted.levels.size} levels",
                f"{fitted.condition:.0f}",
                f"{fitted.residual[:, -1].max():.0e}",
                ", ".join(f"{e:.0e}" for e in one.errors),
                fitted.status.value,
            ]
        )
    return Table(
        title="How well the NOFRFs are posed",
        rows=rows,
        columns=[
            "actuator",
            "orders fitted",
            "condition of the levels",
            "largest share of an output that they leave",
            "error of G₁, G₂, G₃ against the model's own, over the largest gain",
            "status",
        ],
    )
