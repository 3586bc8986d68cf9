"""The tables of the story: table 4.3 of the thesis, the responses in numbers, and how well the NOFRFs are posed."""

from __future__ import annotations

import numpy as np

from deatwin.ident.frequency.closed_forms import SYSTEMS
from deatwin.scenarios.frequency_analysis.actuators import FREQUENCIES, TABLED, Actuators, Analysed
from deatwin.scenarios.frequency_analysis.known import Known
from deatwin.studies.report.story import Table
from deatwin.studies.report.tables import parameters_by_term
from deatwin.studies.report.words import Each, Words

WORDS = Words(__package__)


def tables(known: Known, found: Actuators) -> list[Table]:
    """Make all tables."""
    closed = [
        [one.name, one.shown, *(_error(known.errors[one.name].get(order)) for order in (1, 2, 3, 4))] for one in SYSTEMS
    ]
    return [
        WORDS.table("closed", closed),
        _removal(found.shown),
        WORDS.table("deviations", [_deviations(one) for one in found.each]),
        WORDS.table("gains", [_gains(one) for one in found.each], *(f"{f:g} Hz" for f in TABLED)),
        WORDS.table("posed", [_posed(one) for one in found.each]),
    ]


def _error(error: float | None) -> str:
    return "–" if error is None else f"{error:.0e}" if error else "0"


def _removal(one: Analysed) -> Table:
    point, rows = one.removal.shifted.point, parameters_by_term(one.removal.model, one.removal.shifted.model)
    return WORDS.table("removal", rows, name=one.name, level=point.operating_input[0], rest=1e3 * point.output)


def _deviations(one: Analysed) -> list[str]:
    """The operating point, and what the removal and the deletion of the constant do."""
    removal, point = one.removal, one.removal.shifted.point
    return [
        one.name,
        f"{point.operating_input[0]:.3f} V",
        f"{1e3 * point.output:.3f} mm",
        "stable" if point.is_stable else "unstable",
        f"{len(removal.model.terms)} and {len(removal.shifted.model.terms)}",
        f"{removal.error:.0e}",
        f"{removal.deleted_error:.2f}",
        f"{one.alike.fit_percent:.1f} %",
    ]


def _gains(one: Analysed) -> list[str]:
    places = [int(np.argmin(np.abs(FREQUENCIES - f))) for f in TABLED]
    gain, deviation = 1e6 * one.first.gain, 1e6 * one.first.gain_deviation
    return [one.name, *(f"{gain[i]:.1f} ± {1.96 * deviation[i]:.1f}" for i in places)]


def _posed(one: Analysed) -> list[str]:
    fitted = one.nofrfs.fitted
    return [
        one.name,
        f"{fitted.highest} at {fitted.levels.size} levels",
        f"{fitted.condition:.0f}",
        f"{fitted.residual[:, -1].max():.0e}",
        f"{Each(one.nofrfs.errors):.0e}",
        fitted.status.value,
    ]
