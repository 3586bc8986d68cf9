"""What a story reached, as data that are kept with the sources, and the tables that the documents show of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markdown_tables import markdown_table

from deatwin.studies.sweep.store import read_object

STORY = "deatwin/control-story/2"
"""Schema of what the tables are made of."""
OF_TRIALS = "random rigs"
"""How measures begin that the trials reach; those have tables of their own, made from more trials."""
TABLES = ("tracking", "fleet", "models", "concealed")
"""The story's tables in its order, before those of trials."""


def story_data(folder: Path | str, remark: str = "") -> dict[str, Any]:
    """Read a story without its trials."""
    found, run = (read_object(Path(folder) / name) for name in ("control-check.json", "run.json"))
    tables = [{key: table[key] for key in ("title", "columns", "rows")} for table in found["tables"]]
    return {
        "schema": STORY,
        "seed": run["seed"],
        "version": run["versions"]["deatwin"],
        "remark": remark,
        "measures": [row for row in found["measures"] if not row["measure"].startswith(OF_TRIALS)],
        "tables": tables[: len(TABLES)],
    }


def story_blocks(data: Mapping[str, Any]) -> dict[str, list[str]]:
    """The lines of the blocks that show a story."""
    part = f"story part, seed {data['seed']}, deatwin {data['version']}"
    run = f"The results below are from `deatwin scenario control-check` ({part})."
    whence = f"{run} {data['remark']}".strip()
    measures = [
        [row["measure"], row["demanded"], row["reached"], "yes" if row["passed"] else "no"] for row in data["measures"]
    ]
    table = {
        name: markdown_table(given["columns"], given["rows"])
        for name, given in zip(TABLES, data["tables"], strict=True)
    }
    return {
        "tracking": [
            f"{whence} An *inverse* computes the command from the reference by the inverse of the model's static curve. An "
            "*inverse with dynamics* also inverts the model's linear dynamics. An *oracle* is designed by the same method, "
            "but on the true plant instead of the model.",
            "",
            *markdown_table(["measure", "demanded", "reached", "met"], measures),
            "",
            "The next table compares controllers that track tones on two simulated plants: the nominal rig, and the "
            "*specification* of the six actuators, which has hysteresis. The margins are those of the loop with the "
            "identified model.",
            "",
            *table["tracking"],
            "",
            "The last table shows one scheduled controller on six actuators. The reference is a series of constant levels. "
            "Overshoot and rms motion are in per cent of the step between two levels.",
            "",
            *table["fleet"],
        ],
        "models": [
            f"{whence} For each of five models of one actuator, a controller was designed by lambda tuning with one "
            "closed-loop time. Each cell gives the predicted value, its 95 % band, and the value measured on the true "
            "actuator. The mark ✓ means that the measured value lies inside the band, and ✗ means that it lies outside.",
            "",
            *table["models"],
        ],
        "concealed-effects": [
            f"{whence} Each row of the table is a controller for a rig with an effect that the base plant lacks. *Reason* "
            "is the first reason that the check gives. On the true rig, the full limits apply; the check uses limits that "
            "are tightened by a fifth.",
            "",
            *table["concealed"],
        ],
    }
