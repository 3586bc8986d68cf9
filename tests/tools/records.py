"""What is known where a goal was missed, and checks whose figures tests measure: kept by hand, shown as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from markdown_tables import markdown_table

from deatwin.scenarios.real_physics.grey_boxes import sources
from deatwin.studies.report.quantities import three_digits

RECORDS = "deatwin/records/1"
"""Schema of what is kept by hand."""


def record_blocks(records: Mapping[str, Any], measured: Mapping[str, Any]) -> dict[str, list[str]]:
    """The lines of the blocks; errors are those of the last run of the standard tasks."""
    errors = {
        (row["task"], row["model"]): f"{three_digits(row['error'])} {row['unit']}"
        for row in measured["tasks"]
        if row["error"]
    }
    published = sources()
    return {
        "tasks-tried": markdown_table(
            ["test part", "model, error", "goal", "what is known"],
            [
                [
                    row["task"],
                    "; ".join(f"{model} {errors[row['task'], model]}" for model in row["models"]),
                    row["goal"],
                    row["tried"],
                ]
                for row in records["tried"]
            ],
        ),
        "tasks-published": markdown_table(published.columns, published.rows),
        "checks": markdown_table(
            ["checked", "compared with", "demanded", "reached"],
            [[row[key] for key in ("question", "source", "demanded", "reached")] for row in records["checks"]],
        ),
    }
