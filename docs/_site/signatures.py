"""Table of the effects with a small picture of each one's signature, and matrix of effects and places, drawn while the
site is built.

A hook of MkDocs (`on_page_markdown`), named in mkdocs.yml: they take the place of ``<!-- signatures -->`` and of
``<!-- places -->`` on a page. The curves come from docs/data/signatures.json, names and sentences from the catalogue.
"""

from __future__ import annotations

import json
import re
from itertools import groupby
from pathlib import Path
from typing import Any

from deatwin.plant import Effect, catalogue

MARK, PLACES = "<!-- signatures -->", "<!-- places -->"
DATA = Path(__file__).parents[1] / "data" / "signatures.json"
WIDTH, HEIGHT = 180.0, 48.0


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the tables where the page asks for them."""
    for mark, made in ((MARK, table), (PLACES, matrix)):
        markdown = markdown.replace(mark, made()) if mark in markdown else markdown
    return markdown


def table() -> str:
    """HTML of the table: one row for each effect, by families."""
    data = json.loads(DATA.read_text(encoding="utf-8"))
    heads = "<tr><th>effect</th><th>what it does</th><th>what it adds to the reading</th></tr>"
    command = f"<tr><td>command</td><td>a step, two triangles</td><td>{picture(data['command_V'], 'V')}</td></tr>"
    effects = sorted(catalogue(), key=lambda e: (list(type(e.family)).index(e.family), e.name))
    rows = [command]
    for family, members in groupby(effects, key=lambda e: e.family):
        rows.append(f'<tr><th colspan="3">{family.value}</th></tr>')
        rows += [row(effect, data["added_um"][effect.name]) for effect in members]
    return f'<table class="signatures"><thead>{heads}</thead><tbody>{"".join(rows)}</tbody></table>'


def matrix() -> str:
    """HTML of the effects that have further places: one row for each effect, one column for each place."""
    data = json.loads(DATA.read_text(encoding="utf-8"))["added_um"]
    several = [effect for effect in catalogue() if effect.places]
    columns = list(dict.fromkeys(place for e in several for place in (e.signal, *e.places)))
    heads = "".join(f"<th>{place.replace('_', ' ')}</th>" for place in ("effect", *columns))
    rows = []
    for effect in several:
        names = {effect.signal: effect.name, **{at: f"{effect.name}_at_{at}" for at in effect.places}}
        cells = "".join(
            f'<td data-label="{place.replace("_", " ")}">{cell(names[place], data)}</td>'
            if place in names
            else "<td></td>"
            for place in columns
        )
        rows.append(f"<tr><td>{link(effect)}</td>{cells}</tr>")
    return f'<table class="signatures places"><thead><tr>{heads}</tr></thead><tbody>{"".join(rows)}</tbody></table>'


def cell(name: str, data: dict[str, list[list[float]]]) -> str:
    """Picture of an effect at a place, if the diaphragm has it."""
    return picture(data[name], "µm") if name in data else "on rigs that have it"


def link(effect: Effect) -> str:
    """Name with a link to the effect's entry."""
    return f'<a href="#deatwin.plant.{type(effect).__name__}"><code>{effect.name}</code></a>'


def row(effect: Effect, added: list[list[float]]) -> str:
    """Name with a link, sentence, and picture."""
    return f"<tr><td>{link(effect)}</td><td>{sentence(effect)}</td><td>{picture(added, 'µm')}</td></tr>"


def sentence(effect: Effect) -> str:
    """Say what the effect does, with the names of its parameters in place of their values."""

    def named(found: re.Match[str]) -> str:
        time = "the time " if found[1] == effect.event else ""
        return f"{time}<i>{found[1].replace('_', ' ')}</i>"

    return re.sub(r"\{(\w+)\}", named, effect.wording) + "."


def picture(outline: list[list[float]], unit: str) -> str:
    """Band between the smallest and the largest value of each group of samples, with its range beside it."""
    low, high = min(0.0, *(v for v, _ in outline)), max(0.0, *(v for _, v in outline))
    span = (high - low) or 1.0

    def y(value: float) -> float:
        return 1.0 + (HEIGHT - 2.0) * (high - value) / span

    step = WIDTH / len(outline)
    upper = [f"{step * (i + 0.5):.1f},{y(v):.1f}" for i, (_, v) in enumerate(outline)]
    lower = [f"{step * (i + 0.5):.1f},{y(v):.1f}" for i, (v, _) in enumerate(outline)]
    extent = f"{float(f'{low:.2g}'):g} to {float(f'{high:.2g}'):g} {unit}".replace("-", "−")
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" width="{WIDTH:.0f}" height="{HEIGHT:.0f}" '
        f'role="img" aria-label="{extent}">'
        f'<path d="M0 {y(0.0):.1f}H{WIDTH:.0f}" class="zero"/>'
        f'<path d="M{"L".join(upper + lower[::-1])}Z" class="band"/></svg><br><small>{extent}</small>'
    )
