"""Tables and samples of a diagnosis in the form of xarray datasets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from deatwin.ident.mismatch.located import LocationSummary
from deatwin.plant.datasets import Variables, clock, columns
from deatwin.plant.records import plain

_UNITS = {"from_s": "s", "to_s": "s", "from_Hz": "Hz", "to_Hz": "Hz", "excess_dB": "dB"}
Told = Mapping[str, tuple[str, ...]]
"""Columns with their units, and their meaning if the name does not state it."""


def samples(experiments: Any) -> Variables:
    """Return the coordinates of all samples for `dataset`: time in s, numbers of experiment and record, from 0."""
    records = [record for one in experiments for record in one.recordings]
    owners = [number for number, one in enumerate(experiments) for _ in one.recordings]
    within = [number for one in experiments for number in range(len(one.recordings))]
    counts = [record.n_samples for record in records]
    return {
        **clock(records),
        "record": ("sample", np.repeat(within, counts)),
        "experiment": ("sample", np.repeat(owners, counts)),
    }


def places(located: LocationSummary | None, amplitude: str) -> Variables:
    """Return the tables of a location: one dimension each for time, frequency, region and place."""
    if located is None:
        return {}
    found: dict[str, Any] = {}
    rate = f"{amplitude}/s" if amplitude else ""
    units = {**_UNITS, "mean_residual": amplitude, "rms": amplitude, "slope": rate}
    sides = {
        "time": located.time,
        "frequency": located.frequency,
        "lines": () if located.lines is None else located.lines.groups,
        "region": located.region,
        "place": located.place,
        "response": located.response or (),
    }
    for name, rows in sides.items():
        found |= columns(f"locate_{name}", plain(rows), units)
    if (lines := located.lines) is not None:
        found["locate_lines_period"] = ((), lines.period_s, "s", "period of the input")
        found["locate_lines_periods"] = ((), lines.periods, "", "periods that were compared")
    return found


def table(dimension: str, rows: Iterable[Mapping[str, Any]], told: Told) -> Variables:
    """Return a table as `columns` has it, each column with the unit and the meaning that `told` gives it."""
    units = {key: about[0] for key, about in told.items()}
    meanings = {f"{dimension}_{key}": about[1:] for key, about in told.items()}
    return {name: (*entry, *meanings.get(name, ())) for name, entry in columns(dimension, rows, units).items()}
