"""What a story reached, as data that are kept with the sources, and the tables that the documents show of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deatwin.plant.errors import DataError
from deatwin.studies.report.quantities import in_interval
from deatwin.studies.report.tables import markdown_table
from deatwin.studies.sweep.json_files import read_object

STORY = "deatwin/control-story/1"
"""Schema of what the tables are made of."""
OF_TRIALS = "random rigs"
"""How measures begin that the trials reach; those have tables of their own, made from more trials."""
QUANTITIES = {
    "bandwidth_Hz": "bandwidth (Hz)",
    "overshoot_percent": "overshoot (%)",
    "gain_margin": "gain margin",
    "rms_error_um": "rms error (µm)",
}
MICRO = 1e6
UNKNOWN = "–"
Rows = Sequence[Mapping[str, Any]]


def story_data(folder: Path | str, remark: str = "") -> dict[str, Any]:
    """Read a story without its trials."""
    found, run = (read_object(Path(folder) / name) for name in ("control-check.json", "run.json"))
    try:
        return {
            "schema": STORY,
            "seed": run["seed"],
            "version": run["versions"]["deatwin"],
            "remark": remark,
            "measures": [row for row in found["measures"] if not row["measure"].startswith(OF_TRIALS)],
            "tracking": [
                {"plant": plant, "controller": name, **one}
                for plant, tracked in found["tracking"].items()
                for name, one in tracked.items()
            ],
            "fleet": list(found["fleet"]),
            "models": list(found["models"]),
            "concealed": [
                {"effect": one["effect"], "diagnosis": one["diagnosis"], "causes": one["causes"], **design}
                for one in found["concealed"]
                for design in one["designs"]
            ],
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{folder}: its control-check.json or run.json is no story's: {error!r}") from None


def story_blocks(data: Mapping[str, Any]) -> dict[str, list[str]]:
    """The lines of the blocks that show a story."""
    run = f"Output of `deatwin scenario control-check`, story part, seed {data['seed']}, deatwin {data['version']}."
    whence = f"{run} {data['remark']}".strip()
    return {
        "tracking": [
            f"{whence} The first table compares each measure with its goal:",
            "",
            *_measures(data["measures"]),
            "",
            "The next table shows, for each controller on each plant, the rms error when it tracks the tones, how many "
            "times larger PI's error is, and the margins of the loop with the identified model. An oracle is designed on "
            "the true plant.",
            "",
            *_tracking(data["tracking"]),
            "",
            "The last table is for one scheduled design on six actuators. Overshoot, and the motion that remains late "
            "after a step, are shares of the step.",
            "",
            *_fleet(data["fleet"]),
        ],
        "models": [
            f"{whence} Each row is a model of the same actuator; one rule designed a controller on each. Each cell "
            "gives the predicted value with its 95 % band, then the value on the true actuator, which lies inside the "
            "band (✓) or outside (✗).",
            "",
            *_models(data["models"]),
        ],
        "concealed-effects": [
            f"{whence} Each row is a design for a rig with an effect that its base model lacks. *Reason* is the check's "
            "first reason for its verdict. The last column judges the design on the true rig by the full limits; the "
            "check keeps a fifth of them in reserve.",
            "",
            *_concealed(data["concealed"]),
        ],
    }


def _measures(rows: Rows) -> list[str]:
    return markdown_table(
        ["measure", "demanded", "reached", "met"],
        [[row["measure"], row["demanded"], row["reached"], "yes" if row["passed"] else "no"] for row in rows],
    )


def _tracking(rows: Rows) -> list[str]:
    alone = {row["plant"]: row["rms_error"] for row in rows if row["controller"] == "PI"}
    return markdown_table(
        ["plant", "controller", "rms error (µm)", "error of PI, relative to this", "gain margin", "phase margin (°)"],
        [
            [
                row["plant"],
                row["controller"],
                _number(row["rms_error"], ".3g", MICRO),
                _over(alone.get(row["plant"]), row["rms_error"]),
                _number(row["gain_margin"], ".3g"),
                _number(row["phase_margin_deg"], ".0f"),
            ]
            for row in rows
        ],
    )


def _fleet(rows: Rows) -> list[str]:
    return markdown_table(
        [
            "actuator",
            "overshoot (%)",
            "remaining motion late after a step (%)",
            "rms error on the tones (µm)",
            "stable",
        ],
        [
            [
                row["actuator"],
                _number(row["overshoot"], ".0f", 100),
                _number(row["ripple"], ".2g", 100),
                _number(row["tones_rms_error"], ".0f", MICRO),
                "yes" if row["stable"] else "no",
            ]
            for row in rows
        ],
    )


def _models(rows: Rows) -> list[str]:
    cells = {(row["model"], row["quantity"]): _promise(row) for row in rows}
    return markdown_table(
        ["model", *QUANTITIES.values()],
        [
            [model, *(cells.get((model, quantity), UNKNOWN) for quantity in QUANTITIES)]
            for model in dict.fromkeys(row["model"] for row in rows)
        ],
    )


def _promise(row: Mapping[str, Any]) -> str:
    ends = [row["predicted"], row["low"], row["high"]]
    predicted = UNKNOWN if None in ends else in_interval(*ends)
    return f"{predicted}; {_number(row['achieved'], '.3g')} {'✓' if row['inside'] else '✗'}"


def _concealed(rows: Rows) -> list[str]:
    return markdown_table(
        ["concealed", "diagnosis", "closed-loop time (s)", "designed from", "verdict", "reason", "on the true rig"],
        [
            [
                row["effect"],
                f"{row['diagnosis']}: {', '.join(row['causes']) or UNKNOWN}",
                f"{row['closed_loop_time']:g}",
                f"{row['source']} model",
                row["verdict"],
                _first(row["reason"]),
                f"{row['truth']}: {row['true_text'].replace(' on the physics plant', '')}",
            ]
            for row in rows
        ],
    )


def _first(reason: str) -> str:
    first, *more = reason.split("; ")
    return f"{first} (and {len(more)} more)" if more else first


def _over(one: float | None, other: float | None) -> str:
    return UNKNOWN if one is None or not other else f"{one / other:.2f}"


def _number(value: float | None, form: str, scale: float = 1.0) -> str:
    """A number in its unit; those that are not finite were written as null."""
    return UNKNOWN if value is None else f"{scale * value:{form}}"
