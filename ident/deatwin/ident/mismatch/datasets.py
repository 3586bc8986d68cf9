"""A diagnosis as an xarray dataset: its tables, and the recordings beside what the plants make of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.mismatch.evidence import Evidence, Readings
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.datasets import Variables, clock, columns, dataset

if TYPE_CHECKING:
    from deatwin.ident.mismatch.diagnosis import Diagnosis


_UNITS = {"from_s": "s", "to_s": "s", "from_Hz": "Hz", "to_Hz": "Hz", "excess_dB": "dB"}
Told = Mapping[str, tuple[str, ...]]
"""Of columns: the unit, and what it means where the name does not say it."""


def dataset_of(diagnosis: Diagnosis) -> Any:
    """Tables of causes, parameters and locations, and where there is evidence the readings along the clock.

    Parameters
    ----------
    diagnosis : Diagnosis
        With or without evidence.

    Returns
    -------
    xarray.Dataset
        Parameters in SI; amplitudes in the unit that the attribute ``output_unit`` names. ``document`` is
        ``diagnosis.json``.
    """
    amplitude = diagnosis.output["unit"]
    evidence: Variables = {} if diagnosis.evidence is None else _readings(diagnosis.evidence, amplitude)
    coords: Variables = {} if diagnosis.evidence is None else samples(diagnosis.evidence.experiments)
    detected = {key: value for key, value in diagnosis.detect.items() if isinstance(value, (int, float))}
    return dataset(
        {**_tables(diagnosis, amplitude), **evidence},
        coords,
        {
            "verdict": diagnosis.verdict.value,
            "advice": diagnosis.verdict.advice,
            "sentence": diagnosis.sentence,
            "output_name": diagnosis.output["name"],
            "output_unit": amplitude,
            "noise": diagnosis.noise,
            "model_error": diagnosis.model_error,
            "set": list(diagnosis.names),
            "warnings": list(diagnosis.warnings),
            **detected,
        },
        diagnosis.to_dict(),
    )


def samples(experiments: Any) -> Variables:
    """Coordinates of all samples of several experiments, one after another.

    Parameters
    ----------
    experiments : sequence of Experiment
        In their order.

    Returns
    -------
    mapping of str to tuple
        ``time`` in s, and the numbers of ``experiment`` and ``record`` from 0 on; as `dataset` takes them.
    """
    records = [record for one in experiments for record in one.recordings]
    owners = [number for number, one in enumerate(experiments) for _ in one.recordings]
    within = [number for one in experiments for number in range(len(one.recordings))]
    counts = [record.n_samples for record in records]
    return {
        **clock(records),
        "record": ("sample", np.repeat(within, counts)),
        "experiment": ("sample", np.repeat(owners, counts)),
    }


def _tables(diagnosis: Diagnosis, amplitude: str) -> Variables:
    causes = [
        {"effect": c.effect, "family": c.family, "probability": c.probability, "share_explained": c.share_explained}
        for c in diagnosis.causes
    ]
    added = [
        {"name": f"{c.effect}.{name}", "value": p.value, "low": p.low, "high": p.high, "unit": p.unit}
        for c in diagnosis.causes
        for name, p in c.parameters.items()
    ]
    fitted = [
        {
            "name": name,
            "value": p.value,
            "low": p.low,
            "high": p.high,
            "unit": p.unit,
            "nominal": p.nominal,
            "at_bound": p.at_bound,
            "undetermined": p.undetermined,
        }
        for name, p in diagnosis.parameters.items()
    ]
    smallest = diagnosis.detect.get("smallest_detectable") or {}
    tables: dict[str, Any] = {
        **columns("cause", causes),
        **columns("cause_parameter", added),
        **columns("parameter", fitted),
        **columns("detectable", [{"effect": name, "size": size} for name, size in smallest.items()]),
    }
    return tables | dict(places(diagnosis.locate, amplitude))


def places(located: Mapping[str, Any], amplitude: str) -> Variables:
    """The tables of a location.

    Parameters
    ----------
    located : mapping
        Where the mismatch is, as the file has it.
    amplitude : str
        Unit of amplitudes.

    Returns
    -------
    mapping of str to tuple
        One dimension for each side from which it is looked at.
    """
    found: dict[str, Any] = {}
    rate = f"{amplitude}/s" if amplitude else ""
    units = {**_UNITS, "mean_residual": amplitude, "rms": amplitude, "slope": rate}
    lines = located.get("lines") or {"groups": ()}
    for name, rows in {**located, "lines": lines["groups"]}.items():
        if isinstance(rows, (list, tuple)) and all(isinstance(row, Mapping) for row in rows):
            found |= columns(f"locate_{name}", rows, units)
    if "period_s" in lines:
        found["locate_lines_period"] = ((), lines["period_s"], "s", "period of the input")
        found["locate_lines_periods"] = ((), lines["periods"], "", "periods that were compared")
    return found


def table(dimension: str, rows: Iterable[Mapping[str, Any]], told: Told) -> Variables:
    """A table as `columns` has it, each column with what it means beside its unit.

    Parameters
    ----------
    dimension : str
        Along which the rows stand.
    rows : iterable of mapping
        Flat.
    told : mapping of str to tuple of str
        Unit and meaning of a column, or its unit alone; columns that are not in it have neither.

    Returns
    -------
    mapping of str to tuple
        As `dataset` takes them.
    """
    units = {key: about[0] for key, about in told.items()}
    meanings = {f"{dimension}_{key}": about[1:] for key, about in told.items()}
    return {name: (*entry, *meanings.get(name, ())) for name, entry in columns(dimension, rows, units).items()}


def _readings(evidence: Evidence, amplitude: str) -> Variables:
    records = [record for one in evidence.experiments for record in one.recordings]
    first = records[0]
    size = amplitude_unit(first.output_units[0])[1]

    def joined(readings: Readings) -> np.ndarray:
        return np.concatenate([values.ravel() for one in readings for values in one])

    found: dict[str, Any] = {
        "command": ("sample", np.concatenate([r.inputs[0] for r in records]), first.input_units[0]),
        "measured": ("sample", np.concatenate([r.outputs[0] for r in records]) / size, amplitude),
        "base": ("sample", joined(evidence.base) / size, amplitude),
        "unseen": ("sample", joined(evidence.unseen)),
    }
    if evidence.amended is not None:
        found["amended"] = ("sample", joined(evidence.amended) / size, amplitude)
    return found
