"""Tables as text: Markdown for documents, CSV for files whose cells may be words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table in Markdown; a vertical bar in a cell becomes a slash."""
    return [
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
        *(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows),
    ]


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """The text of a CSV file; cells hold no comma, quote or line break."""
    return "\n".join([",".join(header), *(",".join(map(str, row)) for row in rows)]) + "\n"
