"""The page of results that is kept with the sources, and the data that it is made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.scenarios.concealed_physics.opened import FAR, Opened
from deatwin.scenarios.concealed_physics.score import Goal
from deatwin.scenarios.concealed_physics.seal import Seal
from deatwin.scenarios.concealed_physics.store import Store
from deatwin.scenarios.concealed_physics.tables import KINDS, tables
from deatwin.studies.sweep.json_files import read_object
from deatwin.studies.sweep.seal import digest

DATA = "deatwin/concealed-physics/1"
"""Schema of what the page of results is made of."""
TITLES = {"long": "Concealed physics in long recordings"}
"""Of the pages of sizes that have one beside the usual one."""
Cells = Sequence[str]


def results_page(study: Opened, goals: Sequence[Goal], seal: Seal) -> str:
    """The results as a page of text."""
    return page_of(page_data(study, goals, seal))


def page_data(study: Opened, goals: Sequence[Goal], seal: Seal) -> dict[str, Any]:
    """What the page of results is made of, as plain data that are kept with the sources."""
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
    """The page of results."""
    cases = ", ".join(f"{count} {words}" for words, count in data["cases"].items())
    lines = [
        f"# {TITLES.get(data['size'], 'Concealed physics')}: what the study reached",
        "",
        *_interrupted(data),
        *([data["remark"], ""] if data["remark"] else []),
        f"`deatwin scenario concealed-physics --size {data['size']} --seed {data['seed']}`, deatwin {data['version']}: "
        f"{sum(data['cases'].values())} cases ({cases}), {data['intervals']} parameters of fits on data of the reduced "
        f"plant. {data['errors']} ended in an error. Processor time of a case: median {data['seconds']['median']:.0f} "
        f"s, at most {data['seconds']['most']:.0f} s.",
        "",
        f"Seal of labels, thresholds and code, written before the first case: `{data['seal']}`",
        "",
        f"Bounds hold with 95 % (Clopper and Pearson); one-sided where a goal has one side. d² from {FAR:g} on means "
        "that two explanations can be told apart. Ratio is the structural residual over the noise after the base plant "
        "was refitted.",
        "",
        *markdown_table(["goal", "demanded", "reached", "met"], [list(goal.values()) for goal in data["goals"]]),
    ]
    for table in data["tables"]:
        lines += ["", f"## {table['title']}", "", *markdown_table(table["columns"], table["rows"])]
    return "\n".join(lines) + "\n"


def _interrupted(data: Mapping[str, Any]) -> list[str]:
    """Says that only a part of a study has run, where it is so."""
    if data["done"] == data["planned"]:
        return []
    counted = "Fits on data of the reduced plant are counted among them. " if data["intervals"] else ""
    return [
        f"**The study was interrupted: {data['done']} of {data['planned']} cases have run (the order is mixed, so they "
        f"are a fair sample).** {counted}A goal that is met is met so far: as long as its bound does not keep it too, "
        "the rest of the study may break it.",
        "",
    ]


def markdown_table(columns: Cells, rows: Iterable[Cells]) -> list[str]:
    """A table in Markdown."""
    return [
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
        *(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows),
    ]


def opened_study(folder: Path | str) -> tuple[Opened, Seal]:
    """Read a study with its key."""
    from deatwin.scenarios.concealed_physics.opened import open_part

    store = Store.opened(folder)
    return open_part(store, _key(Path(folder), store.seal)), store.seal


def write_results(folder: Path | str, target: Path | str) -> None:
    """Read a study, score it, and write the table of results that is kept with the sources."""
    from deatwin.plant.files import write_text_atomic
    from deatwin.scenarios.concealed_physics.score import score

    study, seal = opened_study(folder)
    write_text_atomic(target, results_page(study, score(study), seal))


def _key(folder: Path, seal: Seal) -> Mapping[str, Any]:
    """The key of a study; it is written when the last case is through, and made anew before."""
    from deatwin.scenarios.concealed_physics.study import key_of, labels

    path = folder / "key.json"
    if not path.exists():
        return key_of(labels(seal.size, seal.seed))
    found = read_object(path, "the key of a study")
    if digest(found) != seal.key:
        raise DataError(f"{path}: this is not the one that was sealed; labels must not change once a study has begun")
    return found
