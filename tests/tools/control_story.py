"""What a story reached, as data that are kept with the sources, and the tables that the documents show of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deatwin.plant.errors import DataError
from deatwin.studies.report.tables import markdown_table
from deatwin.studies.sweep.json_files import read_object

STORY = "deatwin/control-story/2"
"""Schema of what the tables are made of."""
OF_TRIALS = "random rigs"
"""How measures begin that the trials reach; those have tables of their own, made from more trials."""
TABLES = ("tracking", "fleet", "models", "concealed")
"""The story's tables in its order, before those of trials."""


def story_data(folder: Path | str, remark: str = "") -> dict[str, Any]:
    """Read a story without its trials."""
    found, run = (read_object(Path(folder) / name) for name in ("control-check.json", "run.json"))
    try:
        tables = [{key: table[key] for key in ("title", "columns", "rows")} for table in found["tables"]]
        return {
            "schema": STORY,
            "seed": run["seed"],
            "version": run["versions"]["deatwin"],
            "remark": remark,
            "measures": [row for row in found["measures"] if not row["measure"].startswith(OF_TRIALS)],
            "tables": tables[: len(TABLES)],
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{folder}: its control-check.json or run.json is no story's: {error!r}") from None


def story_blocks(data: Mapping[str, Any]) -> dict[str, list[str]]:
    """The lines of the blocks that show a story."""
    run = f"Output of `deatwin scenario control-check`, story part, seed {data['seed']}, deatwin {data['version']}."
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
            f"{whence} Each row is a measure with its required and its achieved value:",
            "",
            *markdown_table(["measure", "demanded", "reached", "met"], measures),
            "",
            "Each row is a controller on a plant: its rms tracking error on the tones, the ratio of PI's error to it, "
            "and the margins of its loop with the identified model (an oracle is designed on the true plant):",
            "",
            *table["tracking"],
            "",
            "Each row is an actuator under the same scheduled design: overshoot and late motion after a step as shares "
            "of the step, the rms error on the tones, and whether both runs are stable:",
            "",
            *table["fleet"],
        ],
        "models": [
            f"{whence} Each row is a model of the same actuator, with the controller that one rule designed on it. "
            "Each cell gives the predicted value with its 95 % band, then the value on the true actuator, and whether "
            "it lies inside the band (✓) or not (✗):",
            "",
            *table["models"],
        ],
        "concealed-effects": [
            f"{whence} Each row is a design for a rig with an effect that its base model lacks: the diagnosis, the "
            "required closed-loop time, the model used for the design, the verdict of the check with its first "
            "reason, and the result on the true rig, judged by the full limits (the check keeps a reserve):",
            "",
            *table["concealed"],
        ],
    }
