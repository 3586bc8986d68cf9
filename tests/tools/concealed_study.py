"""What a study of concealed physics reached, as data that are kept with the sources, and the page that shows it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markdown_tables import markdown_table

from deatwin.plant.errors import DataError
from deatwin.scenarios.concealed_physics.cases import case_specs
from deatwin.scenarios.concealed_physics.page import KINDS, VERDICTS, tables
from deatwin.scenarios.concealed_physics.results import FAR, NO_CASE, Goal, Opened, open_key
from deatwin.scenarios.concealed_physics.study import key_of
from deatwin.studies.report.words import rendered
from deatwin.studies.sweep.seal import SweepSeal, digest
from deatwin.studies.sweep.store import CaseStore, read_object, read_seal

DATA = "deatwin/concealed-physics/1"
"""Schema of the data of the page."""
TITLES = {"long": "Concealed physics in long recordings"}
"""Titles of the pages of sizes that have one beside the usual one."""
MET = {True: "yes", False: "no", None: "reported"}
TEMPLATE = Path(__file__).with_suffix(".md.j2")
LEGEND = re.compile(r"(.+?) \(((?:[✓†(].+))\)")
"""A heading with the legend of the marks in its column."""
MARK = re.compile(r"(?<=\d):(?=[^\s\w])")
"""Between the mismatch of a case and its mark, which stay on one line."""


def opened_study(folder: Path | str) -> tuple[Opened, SweepSeal]:
    """Read a study with its key, which is made anew until the last case is through."""
    seal, path = read_seal(folder), Path(folder) / "key.json"
    if path.exists():
        key = read_object(path, "the key of a study")
    else:
        key = key_of(case_specs(seal.parts["size"], seal.parts["seed"]))
    if path.exists() and digest(key) != seal.parts["key"]:
        raise DataError(f"{path}: this is not the one that was sealed; labels must not change once a study has begun")
    return open_key(CaseStore(folder, seal), key), seal


def page_data(study: Opened, goals: Sequence[Goal], seal: SweepSeal) -> dict[str, Any]:
    """Collect the content of the page as plain data."""
    counted, seconds = Counter(case.kind for case in study.cases), np.array(study.seconds or (0.0,))
    return {
        "schema": DATA,
        "size": seal.parts["size"],
        "seed": seal.parts["seed"],
        "version": seal.parts["version"],
        "seal": seal.hash,
        "planned": study.planned,
        "done": study.planned - len(study.missing),
        "remark": "",
        "cases": {words: counted[kind] for kind, words in KINDS.items() if counted[kind]},
        "errors": len(study.failures),
        "seconds": {"median": round(float(np.median(seconds)), 1), "most": round(float(seconds.max()), 1)},
        "goals": [{"goal": g.measure, "demanded": g.demanded, "reached": g.reached, "met": MET[g.met]} for g in goals],
        "tables": [
            {"title": t.title, "columns": list(t.columns), "rows": [list(row) for row in t.rows]} for t in tables(study)
        ],
    }


def page_of(data: Mapping[str, Any]) -> str:
    """Write the page of results."""
    tested = [{**g, "met": "–"} if (g["reached"], g["met"]) == (NO_CASE, "no") else g for g in data["goals"]]
    goals = markdown_table(["goal", "demanded", "reached", "met"], [list(goal.values()) for goal in tested])
    shown = [_shown(**table) for table in data["tables"]]
    named = ("size", "seed", "version", "seal", "planned", "done", "remark", "errors")
    text = rendered(
        TEMPLATE.read_text(encoding="utf-8"),
        **{name: data[name] for name in named},
        title=TITLES.get(data["size"], "Concealed physics"),
        counted=sum(data["cases"].values()),
        kinds="; ".join(f"{words}: {count}" for words, count in data["cases"].items()),
        median=f"{data['seconds']['median']:.0f}",
        most=f"{data['seconds']['most']:.0f}",
        far=f"{FAR:g}",
        goals=goals,
        tables=shown,
    )
    return text.rstrip("\n") + "\n"


def _used(legend: str, cells: Sequence[str]) -> list[str]:
    """Return the entries of a legend whose marks the cells have."""
    entries = re.split(r", (?=\S+ )", legend)
    return [one for one in entries if re.search(rf"(?<!\(){re.escape(one.partition(' ')[0])}", " ".join(cells))]


def _shown(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Put the legends of marks below the title, and leave out verdicts that no case has."""
    kept = [k for k, name in enumerate(columns) if name not in VERDICTS or any(row[k] != "0" for row in rows)]
    legends = {name: LEGEND.fullmatch(name) for name in columns}
    heads = [found[1] if (found := legends[columns[k]]) else columns[k] for k in kept]
    cells = [[MARK.sub(":\u2060", row[k]) for k in kept] for row in rows]
    return {
        "title": title,
        "legend": " ".join(
            f"Marks in the column *{found[1]}*: {', '.join(_used(found[2], [row[k] for row in rows]))}."
            for k, found in enumerate(legends.values())
            if found
        ),
        "lines": markdown_table(heads, cells),
    }
