"""TDMS files of LabVIEW, by nptdms (NI, "TDMS File Format Internal Structure"; LabVIEW help, "Set Waveform Attribute").

A channel is a column, ``group/channel`` if two groups have one of its name. ``wf_increment`` and ``wf_start_offset``
state the clock where no channel holds times, ``unit_string`` (or DAQmx's ``NI_UnitDescription``) the unit,
``wf_xunit_string`` that of the clock;
``wf_start_time`` goes into the provenance.
"""

import hashlib
import io
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.files.csvtable import read_bytes
from deatwin.plant.files.formats.arrays import ArrayTable, array_table, require_no_scale, units_of
from deatwin.plant.files.formats.description import (
    KEY,
    describe,
    plain_header,
    read_description,
    rows_of,
    signals_of,
    unmistakable,
)
from deatwin.plant.files.formats.optional import reading, require
from deatwin.plant.files.formats.table import Declared, Timing
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.recording import Recording
from deatwin.plant.safe_read import clipped, in_words

STARTED = "wf_start_time"
_UNDATED = np.datetime64("1904-01-02")  # after the date that LabVIEW writes for none, in any time zone
_GROUP = "recording"
_BROKEN_OFF = ("Last segment", "Data size")  # Messages about an interrupted acquisition, which keeps its data


def read_tdms(path: str | Path) -> ArrayTable:
    """Read a TDMS file."""
    content, name = read_bytes(path), str(path)
    nptdms = require("nptdms", f"{name}: a TDMS file")
    with reading(name, "TDMS", logger="nptdms", harmless=_BROKEN_OFF):
        _require_held(nptdms.TdmsFile.read_metadata(io.BytesIO(content)), len(content), name)
        file = nptdms.TdmsFile.read(io.BytesIO(content))
        found = [channel for group in file.groups() for channel in group.channels() if len(channel)]
        values = [_seconds(np.asarray(channel[:])) for channel in found]
        timings, dates = [_timing(channel, name) for channel in found], tuple(map(_started, found))
        declared = _declared(file, found, name)
    common = Counter(channel.name for channel in found)
    headers = [c.name if common[c.name] == 1 else f"{c.group_name}/{c.name}" for c in found]
    table = array_table(
        name,
        hashlib.sha256(content).hexdigest(),
        dict(zip(headers, values, strict=True)),
        {header: _unit(channel, name) for header, channel in zip(headers, found, strict=True)},
        declared=declared,
        timings=dict(zip(headers, timings, strict=True)),
    )
    paths = {f"{c.group_name}/{c.name}": header for c, header in zip(found, headers, strict=True)}
    return replace(table, dates=dates, places=paths)


def write_tdms(path: str | Path, recording: Recording) -> None:
    """Write a recording as a TDMS file: waveforms in SI units in one group, and their description."""
    nptdms = require("nptdms", "a TDMS file")
    signals = signals_of(recording, plain_header, taken=[])
    clock = {
        "wf_increment": recording.sample_time,
        "wf_start_offset": recording.start,
        "wf_samples": recording.n_samples,
    }
    channels = [
        nptdms.ChannelObject(_GROUP, signal.header, row, {"unit_string": unmistakable(signal.unit), **clock})
        for signal, row in zip(signals, rows_of(recording), strict=True)
    ]
    root = nptdms.RootObject({KEY: describe(recording, signals)})
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([root, nptdms.GroupObject(_GROUP), *channels])


def _require_held(file: Any, held: int, path: str) -> None:
    """Raise an error if a file declares more samples than it has bytes, or than can be read."""
    count = sum(len(channel) for group in file.groups() for channel in group.channels())
    if count > held:
        raise DataError(f"{path}: it declares {count} samples and has {in_words(held)}; it is damaged")


def _declared(file: Any, channels: list[Any], path: str) -> Declared:
    """Return what the file declares besides its channels."""
    if KEY in file.properties:
        start = channels[0].properties.get("wf_start_offset", 0.0) if channels else 0.0
        return read_description(str(file.properties[KEY]), path, start=float(start))
    notes = {key: value for key, value in file.properties.items() if isinstance(value, str) and value}
    started = {str(c.properties[STARTED]) for c in channels if STARTED in c.properties}
    return Declared(provenance=notes | ({STARTED: started.pop()} if len(started) == 1 else {}))


def _started(channel: Any) -> np.datetime64 | None:
    """Return the date of a waveform's first sample; None without one, which LabVIEW writes as the year 1904."""
    date = channel.properties.get(STARTED)
    return np.datetime64(date) if date is not None and np.datetime64(date) > _UNDATED else None


def _timing(channel: Any, path: str) -> Timing | None:
    """Return the clock of a waveform; None if the increment is 0, LabVIEW's default."""
    increment = float(channel.properties.get("wf_increment", 0.0))
    start = float(channel.properties.get("wf_start_offset", 0.0))
    if not (0.0 < increment < np.inf and np.isfinite(start)):
        return None
    said = str(channel.properties.get("wf_xunit_string", "")).strip()
    unit = UNITS[find_unit(said or "s")]
    if unit.si != "s":
        raise DataError(
            f'{path}: the x values of the waveform "{clipped(channel.name)}" are in "{clipped(said)}" (wf_xunit_string); a '
            "recording needs times"
        )
    step, first = unit.to_si(np.array([increment, start])).tolist()
    return Timing(sample_time=step, start=first)


def _unit(channel: Any, path: str) -> str:
    """Return the unit in a channel's properties."""
    # nptdms has applied the scales that DAQmx describes in properties NI_...; wf_... describe the clock
    own = {key: value for key, value in channel.properties.items() if not key.startswith(("NI_", "wf_"))}
    require_no_scale(own, channel.name, path)
    return " ".join(units_of(channel.properties))


def _seconds(values: np.ndarray) -> np.ndarray:
    """Return time stamps as seconds since the first; other values are unchanged."""
    return (values - values[0]) / np.timedelta64(1, "s") if values.dtype.kind == "M" else values
