"""The gallery: results of real commands, drawn while the site is built.

Hooks of MkDocs, named in mkdocs.yml. `on_page_markdown` replaces ``<!-- gallery -->`` on a page; the order and the commands
are in docs/gallery/entries.toml, the data of the pictures in docs/data/gallery.json. `on_files` unpacks the reports
docs/gallery/NAME.html.xz.
"""

from __future__ import annotations

import html
import json
import lzma
import tomllib
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from deatwin.studies.report.quantities import raised

MARK = "<!-- gallery -->"
DOCS = Path(__file__).parents[1]
WIDTH, HEIGHT, LEFT, BELOW = 640.0, 190.0, 60.0, 18.0
LARGEST = 5_000_000
"""Bytes of the largest page that the site may have."""


def on_files(files: Files, config: Any) -> Files:
    """Add the reports to the site, each a page of its own."""
    for path in sorted((DOCS / "gallery").glob("*.html.xz")):
        page = lzma.decompress(path.read_bytes())
        if len(page) > LARGEST:
            raise ValueError(f"{path}: a report of {len(page)} bytes; a page may have {LARGEST}")
        files.append(File.generated(config, f"gallery/{path.name.removesuffix('.xz')}", content=page))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the gallery where the page asks for it."""
    return markdown.replace(MARK, gallery()) if MARK in markdown else markdown


def gallery() -> str:
    """Markdown of all entries."""
    told = tomllib.loads((DOCS / "gallery" / "entries.toml").read_text(encoding="utf-8"))["entry"]
    data = json.loads((DOCS / "data" / "gallery.json").read_text(encoding="utf-8"))
    return "\n\n".join(shown(one, data[one["name"]]) for one in told if one["name"] in data)


def shown(told: dict[str, Any], found: dict[str, Any]) -> str:
    """One entry: title, commands, answer and picture."""
    commands = told.get("command") or (
        f"python docs/gallery/record.py {told['record']} lab\ndeatwin diagnose lab/rig.toml lab/noise.csv --out found"
    )
    answer = f"**{found['verdict']}**: {html.escape(raised(found['sentence']))}\n\n" if "sentence" in found else ""
    picture = (
        f"![{told['title']}](gallery/{told['name']}.svg)"
        if "figure" in told
        else f'<figure class="gallery">{drawing(found)}</figure>'
    )
    whole = (DOCS / "gallery" / f"{told['name']}.html.xz").exists()
    report = f"[Open the whole report](gallery/{told['name']}.html)" if whole else ""
    return f"## {told['title']}\n\n```sh\n{commands.strip()}\n```\n\n{answer}{picture}\n\n{report}".rstrip()


def drawing(found: dict[str, Any]) -> str:
    """Series over time as bands between the smallest and the largest value of each group of samples."""
    series, (start, end) = found["series"], found["seconds"]
    values = [v for outline in series.values() for pair in outline for v in pair]
    low, high = min(0.0, *values), max(0.0, *values)

    def y(value: float) -> float:
        return 4.0 + (HEIGHT - BELOW - 8.0) * (high - value) / ((high - low) or 1.0)

    def band(outline: list[list[float]], place: int) -> str:
        step = (WIDTH - LEFT) / len(outline)
        across = [f"{LEFT + step * (i + 0.5):.1f}" for i in range(len(outline))]
        top = [f"{x},{y(v):.1f}" for x, (_, v) in zip(across, outline, strict=True)]
        bottom = [f"{x},{y(v):.1f}" for x, (v, _) in zip(across, outline, strict=True)]
        return f'<path d="M{"L".join(top + bottom[::-1])}Z" class="series{place}"/>'

    marks = [(high, y(high) + 4), (0.0, y(0.0) + 3)] + ([(low, y(low))] if low < -0.15 * (high - low) else [])
    levels = "".join(f'<text x="{LEFT - 6}" y="{at:.1f}" text-anchor="end">{plain(v)}</text>' for v, at in marks)
    bottom = HEIGHT - 5
    times = (
        f'<text x="{LEFT}" y="{bottom}">{plain(start)} s</text>'
        f'<text x="{WIDTH}" y="{bottom}" text-anchor="end">{plain(end)} s</text>'
    )
    bands = "".join(band(outline, i) for i, outline in enumerate(series.values(), 1))
    keys = " ".join(
        f'<span class="series{i}">■</span>&nbsp;{name.replace(" ", "&nbsp;")}' for i, name in enumerate(series, 1)
    )
    what = "measured minus simulated reading" if "verdict" in found else "reading"
    label = f"{what}, {found['unit']}: {', '.join(series)}"
    return (
        f"<figcaption>{what}, {found['unit']}: {keys}</figcaption>"
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" aria-label="{html.escape(label)}">'
        f'<path d="M{LEFT} {y(0.0):.1f}H{WIDTH:.0f}" class="zero"/>{bands}{levels}{times}</svg>'
    )


def plain(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{float(f'{value:.3g}'):.10g}".replace("-", "−")
