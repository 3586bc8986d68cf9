"""The page of results that is kept with the sources, and the data that it is made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from deatwin.scenarios.concealed_physics.results import FAR, Opened
from deatwin.scenarios.concealed_physics.score import Goal
from deatwin.scenarios.concealed_physics.seal import Seal
from deatwin.scenarios.concealed_physics.tables import KINDS, tables
from deatwin.studies.report.prose import rendered
from deatwin.studies.report.tables import markdown_table

DATA = "deatwin/concealed-physics/1"
"""Schema of the data of the page."""
TITLES = {"long": "Concealed physics in long recordings"}
"""Titles of the pages of sizes that have one beside the usual one."""


def results_page(study: Opened, goals: Sequence[Goal], seal: Seal) -> str:
    """Write the results as a page of text."""
    return page_of(page_data(study, goals, seal))


def page_data(study: Opened, goals: Sequence[Goal], seal: Seal) -> dict[str, Any]:
    """Collect the content of the page as plain data that are kept with the sources."""
    counted, seconds = Counter(case.kind for case in study.cases), np.array(study.seconds or (0.0,))
    return {
        "schema": DATA,
        "size": seal.size,
        "seed": seal.seed,
        "version": seal.version,
        "seal": seal.hash,
        "planned": study.planned,
        "done": study.planned - len(study.missing),
        "remark": "",
        "cases": {words: counted[kind] for kind, words in KINDS.items() if counted[kind]},
        "intervals": len(study.intervals),
        "errors": len(study.failures),
        "seconds": {"median": round(float(np.median(seconds)), 1), "most": round(float(seconds.max()), 1)},
        "goals": [{"goal": g.measure, "demanded": g.demanded, "reached": g.reached, "met": g.outcome} for g in goals],
        "tables": [
            {"title": t.title, "columns": list(t.columns), "rows": [list(row) for row in t.rows]}
            for t in tables(study, seal)[:-1]
        ],
    }


def page_of(data: Mapping[str, Any]) -> str:
    """Write the page of results."""
    goals = markdown_table(["goal", "demanded", "reached", "met"], [list(goal.values()) for goal in data["goals"]])
    shown = [{"title": t["title"], "lines": markdown_table(t["columns"], t["rows"])} for t in data["tables"]]
    named = ("size", "seed", "version", "seal", "planned", "done", "remark", "intervals", "errors")
    text = rendered(
        files(__package__).joinpath("results.md.j2").read_text(encoding="utf-8"),
        **{name: data[name] for name in named},
        title=TITLES.get(data["size"], "Concealed physics"),
        counted=sum(data["cases"].values()),
        kinds=", ".join(f"{count} {words}" for words, count in data["cases"].items()),
        median=f"{data['seconds']['median']:.0f}",
        most=f"{data['seconds']['most']:.0f}",
        far=f"{FAR:g}",
        goals=goals,
        tables=shown,
    )
    return text.rstrip("\n") + "\n"
