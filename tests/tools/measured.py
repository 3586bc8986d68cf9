"""What the scenarios reached, as data that are kept with the sources, and the tables that the documents show of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from markdown_tables import markdown_table

from deatwin.plant.errors import DataError
from deatwin.scenarios.catalogue import STORIES
from deatwin.studies.public.black_boxes import LINEAR
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.sweep.store import read_object

MEASURED = "deatwin/story-measures/1"
"""Schema of what the tables are made of."""
OTHERWISE = ("concealed-physics", "control-check", "prestretch-sweep")
"""Scenarios that are not read here: two have pages and data of their own, the third judges claims."""
READ = tuple(story.name for story in STORIES if story.name not in OTHERWISE)
NARX = ("real-data", "semp-fleet", "svb-fleet", "svb-benchmark")
FREQUENCY = ("frequency-analysis", "time-varying", "frequency-uncertainty")
TASKS = "standard-tasks"
SHOWN = (
    ("semp-fleet", "SEMP: free-run error on held-out data"),
    ("svb-fleet", "SVB: free-run error on held-out data"),
    ("svb-benchmark", "SEMP: share of recordings"),
    ("svb-benchmark", "SVB with clean-up: share of recordings"),
    ("svb-benchmark", "models with exactly the true terms"),
    ("real-data", "Silverbox: free-run error on the arrow-head"),
    ("frequency-analysis", "largest error of H₁ to H₄"),
    ("frequency-analysis", "share of spectral lines"),
    ("frequency-analysis", "DEA 5 without hysteresis and drift"),
    ("time-varying", "systems with known parameters: relative error"),
    ("time-varying", "relative free-run error on blocks after the fitted data"),
    ("frequency-uncertainty", "S"),
    ("frequency-uncertainty", "E0"),
    ("frequency-uncertainty", "number of drifts found"),
)
"""Measures that a page shows although they were reached, by the first words of each; it shows all that were missed."""
GOAL = re.compile(r"(.+): free-run error \(model: (.+)\)")
PLANT = "calibrated plant"
UNKNOWN = "–"
Rows = Sequence[Mapping[str, Any]]
_TASK = ("task", "model", "unit", "error")


@dataclass(frozen=True, kw_only=True)
class _System:
    """Whose recordings a scenario diagnoses: what its plant lacks, what is documented, and the unit of errors in SI."""

    recording: str
    lacks: str
    documented: str
    unit: str
    scale: float
    loop: str = "open"


SYSTEMS: Mapping[str, _System] = MappingProxyType(
    {
        "silverbox": _System(
            recording="Silverbox (Wigren & Schoukens 2013)",
            lacks="a cubic spring",
            documented="cubic spring",
            unit="mV",
            scale=1e-3,
        ),
        "emps": _System(
            recording="EMPS (Janot, Gautier & Brunot 2019)",
            lacks="dry friction",
            documented="dry friction of 20.4 N",
            unit="µm",
            scale=1e-6,
            loop="closed",
        ),
        "cascaded-tanks": _System(
            recording="cascaded tanks (Schoukens et al. 2016)",
            lacks="overflow at the brim",
            documented="level saturates at 10 V",
            unit="V",
            scale=1.0,
        ),
        "bouc-wen": _System(
            recording="Bouc-Wen (Noël & Schoukens 2016, simulated)",
            lacks="hysteresis",
            documented="hysteresis (1.25 mm, 62.5 N)",
            unit="µm",
            scale=1e-6,
        ),
        "vhb4910": _System(
            recording="VHB 4910 coupons (C. Zhao's data)",
            lacks="relaxation",
            documented="viscoelasticity",
            unit="N",
            scale=1.0,
        ),
    }
)


def measured_data(folder: Path | str, remark: str = "", before: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Read what scenarios reached."""
    found = [name for name in READ if (Path(folder) / name).is_dir()]
    if not found:
        raise DataError(f"{folder}: it holds no scenario's results in a folder of its name ({READ[0]} and so on)")
    told = [_told(Path(folder) / name, name, remark) for name in found]
    merged: dict[str, Any] = {"schema": MEASURED}
    for key in ("stories", "measures", "recordings", "tasks"):
        kept = [row for row in (before or {}).get(key, ()) if row["story"] in READ and row["story"] not in found]
        rows = kept + [row for one in told for row in one[key]]
        merged[key] = sorted(rows, key=lambda row: READ.index(row["story"]))
    return merged


def measured_blocks(data: Mapping[str, Any]) -> dict[str, list[str]]:
    """The lines of the blocks that show what scenarios reached."""
    rows = data["measures"]
    missed = [row for row in rows if not row["passed"] and row["story"] not in (*NARX, *FREQUENCY, TASKS)]
    return {
        "recordings-of-others": _recordings(data["recordings"]),
        "narx-measures": _measures(row for row in rows if row["story"] in NARX and _is_shown(row)),
        TASKS: _tasks(data.get("tasks", ()), rows),
        "frequency-measures": _measures(row for row in rows if row["story"] in FREQUENCY and _is_shown(row)),
        "scenarios": markdown_table(
            ["scenario", "number of measures that reached their goals", "run"],
            [[f"`{one['story']}`", _share(rows, one["story"]), _run(one)] for one in data["stories"]],
        ),
        "scenarios-missed": markdown_table(
            ["scenario", "measure that missed its goal", "demanded", "reached"],
            [[f"`{row['story']}`", *_words(row)] for row in missed],
        ),
    }


def _told(folder: Path, name: str, remark: str) -> dict[str, list[dict[str, Any]]]:
    result, run = (read_object(folder / file) for file in (f"{name}.json", "run.json"))
    story = {"story": name}
    return {
        "stories": [{**story, "seed": run["seed"], "version": run["versions"]["deatwin"], "remark": remark}],
        "measures": [
            {
                **story,
                **{key: str(row[key]) for key in ("measure", "demanded", "reached")},
                "passed": bool(row["passed"]),
            }
            for row in result["measures"]
        ],
        "recordings": [
            {
                **story,
                "verdict": result["verdict"],
                "causes": list(result["causes"]),
                "recording": recording,
                "base": float(errors["base"]),
                "amended": float(errors["amended"]),
                "black_boxes": dict(errors["black_boxes"]),
            }
            for recording, errors in result["held_out"].items()
        ]
        if name in SYSTEMS
        else [],
        "tasks": [{**story, **{key: row[key] for key in _TASK}} for row in result["errors"]] if name == TASKS else [],
    }


def _recordings(rows: Rows) -> list[str]:
    """The first held-out recording of each scenario: it is the official one, where there is such."""
    first = {row["story"]: row for row in reversed(rows)}
    cells, ahead, beside = [], 0, 0
    for name, system in SYSTEMS.items():
        if name not in first:
            continue
        row = first[name]
        best = _best(row["black_boxes"])
        ahead += best is not None and best < row["amended"]
        beside += best is not None
        causes = ", ".join(row["causes"])
        told = {"named": causes, "ambiguous": f"ambiguous: {causes}"}.get(row["verdict"], row["verdict"])
        cells.append(
            [
                f"{system.recording}, `{name}`",
                system.lacks,
                system.documented,
                told,
                f"{system.loop} loop",
                f"{three_digits(row['base'] / system.scale)} and {three_digits(row['amended'] / system.scale)} {system.unit}",
                UNKNOWN if best is None else f"{three_digits(best / system.scale)} {system.unit}",
            ]
        )
    head = [
        "recording, scenario",
        "effect that the plant lacks",
        "documented physics",
        "effect named by deatwin",
        "simulated in",
        "held-out error of the plant, without and with the effect",
        "held-out error of the best NARX model",
    ]
    return [
        *markdown_table(head, cells),
        "",
        "All errors are rms errors on a held-out recording. The best NARX model was chosen by its error on this recording, "
        f"so the comparison favours the NARX model. The best NARX model has a smaller error than the plant with the effect for {ahead} "
        f"of the {beside} data sets. In closed loop, the feedback suppresses the effect of model errors, so the rms errors are much smaller than in open loop.",
    ]


def _tasks(rows: Rows, measures: Rows) -> list[str]:
    """The errors of all models on the test parts of the standard tasks, under the goals; null is a free run that left."""
    errors = {(row["model"], row["task"]): row["error"] for row in rows}
    units = {row["task"]: row["unit"] for row in rows}
    cells = [
        [model, *(_shown(errors[model, task]) if (model, task) in errors else "" for task in units)]
        for model in dict.fromkeys(row["model"] for row in rows)
    ]
    goals: dict[tuple[bool, str], str] = {}
    for row in measures:
        if row["story"] == TASKS and (found := GOAL.fullmatch(row["measure"])):
            goals[found[2].startswith(PLANT), found[1]] = row["demanded"].split()[2]
    for plant, of in ((True, f"*goal of each {PLANT}*"), (False, "*goal of each model without physics*")):
        cells.insert(0, [of, *(goals.get((plant, task), "") for task in units)])
    return markdown_table(["model in free run", *(f"{task} ({unit})" for task, unit in units.items())], cells)


def _is_shown(row: Mapping[str, Any]) -> bool:
    """Tell if a page shows a measure."""
    return not row["passed"] or any(row["story"] == story and row["measure"].startswith(of) for story, of in SHOWN)


def _shown(error: float | None) -> str:
    return UNKNOWN if error is None else three_digits(error)


def _best(errors: Mapping[str, float | None]) -> float | None:
    """Least error of a NARX model; a free run that left was written as null."""
    return min((e for method, e in errors.items() if method != LINEAR and e is not None), default=None)


def _measures(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    return markdown_table(
        ["scenario", "measure", "demanded", "reached", "met"],
        [[f"`{row['story']}`", *_words(row), "yes" if row["passed"] else "no"] for row in rows],
    )


def _words(row: Mapping[str, Any]) -> list[str]:
    """In a table's cell a vertical bar would end it: the sign of divisibility looks the same."""
    return [row[key].replace("|", "∣") for key in ("measure", "demanded", "reached")]


def _share(rows: Rows, name: str) -> str:
    own = [row["passed"] for row in rows if row["story"] == name]
    return f"{sum(own)} of {len(own)}"


def _run(story: Mapping[str, Any]) -> str:
    known = [] if story["seed"] is None else [f"seed {story['seed']}, deatwin {story['version']}"]
    return "; ".join([*known, *([story["remark"]] if story["remark"] else [])]) or UNKNOWN
