"""Best linear approximation of periodic recordings before modelling, and the degree that it suggests."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.ident.look import BestLinearApproximation, best_linear_approximation
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording
from deatwin.plant.words import as_sentence
from deatwin.studies.report.drawing import Drawing, draw
from deatwin.studies.report.tables import drawn_table


def approximated(records: Sequence[Recording]) -> BestLinearApproximation | None:
    """Return the best linear approximation of all recordings; None if they are not periodic or not comparable."""
    try:
        return best_linear_approximation(records)
    except (DataError, ModelError):  # ModelError: sample times, units or numbers of signals differ
        return None


def degree_remarks(found: BestLinearApproximation | None, degree: int) -> list[str]:
    """Suggest terms of odd degree if odd distortion exceeds the noise and no such terms are allowed."""
    if found is None or degree != 2 or not found.odd_rms > max(found.noise_rms, found.even_rms):
        return []
    size = with_unit(found.odd_rms, found.output_unit)
    return [
        f"allow terms of the third degree (--degree 3), because the odd nonlinear distortion, {size} rms, is larger than the "
        "noise and the even distortion"
    ]


def periodic_drawing(found: BestLinearApproximation) -> Drawing:
    """Draw the best linear approximation, without a model."""
    with draw((7.4, 5.6)) as figure:
        found.plot(list(figure.subplots(2, 1)))
        figure.align_ylabels()
        caption = as_sentence(str(found))
        return Drawing.of(
            figure, "best_linear", "Best linear approximation, estimated without a model", caption, drawn_table(figure)
        )
