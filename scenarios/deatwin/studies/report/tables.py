"""Tables as text: CSV for files, parameters of models."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deatwin.ident.narx import NarxModel


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return the text of a CSV file; cells may contain commas, and None gives an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def parameters_by_term(*models: NarxModel) -> list[list[str]]:
    """Return rows of a table: each term of any model, by degree, with its parameter in each model."""
    values = [dict(zip(model.terms, model.theta, strict=True)) for model in models]
    every = sorted({term for each in values for term in each}, key=lambda term: (term.degree, term.factors))
    return [[str(term), *(f"{each[term]:.4g}" if term in each else "–" for each in values)] for term in every]
