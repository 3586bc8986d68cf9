"""A check as an xarray dataset: findings, margins, and the runs along time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from deatwin.control.checking.checkfile import to_document
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.plant.datasets import columns, dataset

if TYPE_CHECKING:
    from deatwin.control.checking.result import Check


_UNITS = {"time": "s", "phase_deg": "deg", "phase_low_deg": "deg", "delay": "s", "delay_low": "s", "crossover_Hz": "Hz"}


def dataset_of(check: Check) -> Any:
    """Findings and margins as tables, and each run over a time of its own."""
    operating = check.operating
    named = {"steps": check.steps, "sine": check.sine} | {f"other_{k}": r for k, r in enumerate(check.others.values())}
    runs = {name: run for name, run in named.items() if run is not None}
    variables: dict[str, Any] = {
        **columns("finding", [{**asdict(f), "verdict": f.verdict.value} for f in check.findings]),
        **columns("margin", map(asdict, check.table), {**_UNITS, "operating_input": operating.input_unit}),
    }
    for name, run in runs.items():
        variables |= run.variables(f"{name}_time", f"{name}_")
    coords: dict[str, Any] = _times(runs)
    if (predicted := check.predicted) is not None:
        for name, unit in (("middle", predicted.output_unit), ("half_width", predicted.output_unit)):
            variables[f"predicted_{name}"] = ("predicted_time", getattr(predicted, name), unit)
        coords["predicted_time"] = ("predicted_time", predicted.timepts, "s")
    return dataset(
        variables,
        coords,
        {
            "verdict": check.verdict.value,
            "reason": check.reason,
            "sentence": check.sentence,
            "operating_input": operating.input,
            "input_unit": operating.input_unit,
            "output_unit": operating.output_unit,
            "sample_time": operating.sample_time,
            "excited_band_Hz": check.excited_band_Hz,
            "others": list(check.others),
        },
        to_document(check),
    )


def _times(runs: Mapping[str, ClosedLoop]) -> dict[str, Any]:
    return {f"{name}_time": (f"{name}_time", run.timepts, "s") for name, run in runs.items()}
