"""Label the cells of wide tables with their columns, so that a narrow screen can show the cells of a row below each other.

A hook of MkDocs (`on_page_content`), named in mkdocs.yml. The stylesheet `extra.css` stacks the labelled cells.
"""

from __future__ import annotations

import html
import re
from itertools import chain, repeat
from typing import Any

TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
HEAD = re.compile(r"<th\b[^>]*>(.*?)</th>", re.DOTALL)
ROW = re.compile(r"<tr\b.*?</tr>", re.DOTALL)
NARROW = 2
"""Columns of a table that a narrow screen shows as it is."""


def on_page_content(content: str, **_: Any) -> str:
    """Label the cells of each table that has more than two columns."""
    return TABLE.sub(lambda found: _labelled(found[0]), content)


def _labelled(table: str) -> str:
    heads = [html.unescape(re.sub(r"<[^>]*>", "", head)).strip() for head in HEAD.findall(table)]
    if len(heads) <= NARROW:
        return table

    def cells(row: re.Match[str]) -> str:
        names = chain(heads, repeat(""))
        return re.sub(r"<td\b", lambda _: f'<td data-label="{html.escape(next(names))}"', row[0])

    return ROW.sub(cells, table)
