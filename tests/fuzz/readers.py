"""What every reader must do with whatever bytes it is given, and sound files to start from.

`fuzz.py` (for atheris) and tests/property/test_readers_fuzzed.py share it.
"""

import io
import json
import os
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

import numpy as np

from deatwin.control.checking.result import Check
from deatwin.ident.mismatch import Diagnosis
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.linear.model import LinearModel
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.ident.narx.validate import Validation, validate
from deatwin.ident.nss import NonlinearStateSpace
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.documents import shipped_schema
from deatwin.plant.errors import DeatwinError
from deatwin.plant.files import read_experiment, read_recordings, write_recording
from deatwin.plant.files.formats import apart
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.rigfile import RigFile, read_rig

SEEDS = Path(__file__).parent / "seeds"
SECONDS = 20  # for one file of a few kilobytes; a second is much
TRIAL = 5  # seconds that a library in C may be busy with it
FAULTS = ("SIGSEGV", "SIGBUS", "SIGABRT", "SIGFPE", "SIGILL")  # that atheris takes for its own
LONGEST = 3000  # characters of an error text besides the name of the file

CSV = "time_s,command_V,displacement_mm,temperature_C\n" + "".join(
    f"{0.02 * k:.2f},{2 + 0.1 * k:.4f},{0.3 + 0.01 * k:.5f},{20 + k}\n" for k in range(12)
)
RIG = """\
[film]
material = "VHB 4905"
thickness_mm = 0.5
prestretch = 3.5
frame_diameter_mm = 80.0
electrode_diameter_mm = 35.0
ball = "bonded"
[load]
mass_g = 3
contact_diameter_mm = 6.0
[drive]
gain = 800.0
start_ramp_s = 2.0
start_hold_s = 3.0
command_min_V = 1
command_max_V = 3.75
[sensor]
sample_rate_Hz = 50.0
noise_um = 2.0
resolution_um = 0.5
zero = "displacement at zero volts"
"""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of file: how its name begins and ends, how it is read, what a sound object is, and sound files."""

    ending: str
    read: Callable[[Path], Any]
    require_sound: Callable[[Any], None]
    seeds: Callable[[], tuple[bytes, ...]]


class TooSlow(BaseException):
    """A reader took longer than it may."""


def probe(kind: Kind, content: bytes) -> Any:
    """Read a file of such content: a sound object, or an error of deatwin that names the file, and nothing else.

    Parameters
    ----------
    kind : Kind
    content : bytes

    Returns
    -------
    object or None
        None where the file was refused.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        path = Path(folder) / f"taken{kind.ending}"
        path.write_bytes(content)
        try:
            with limited(), mock.patch.object(apart, "trial", forked if hasattr(os, "fork") else apart.trial):
                found = kind.read(path)
        except DeatwinError as error:
            require_clear(str(error), path)
            found = None
        assert [entry.name for entry in Path(folder).iterdir()] == [path.name], "reading has left a file"
        assert path.read_bytes() == content, "reading has changed the file"
    assert not warned, [str(warning.message) for warning in warned]
    if found is not None:
        kind.require_sound(found)
    return found


def require_clear(text: str, path: Path) -> None:
    """One line that names the file, of a length that can be read."""
    assert path.name in text, text
    rest = text.replace(str(path), "")
    assert len(rest) < LONGEST, f"{len(rest)} characters: {rest[:200]}"
    assert "\x1b" not in rest, repr(rest)


def forked(unpack: Callable[..., object], content: bytes, path: str, *wanted: str) -> apart.Outcome:
    """What `apart.trial` finds, a hundred times as fast: the other process is a copy of this one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of this process: the copy needs none
        child = os.fork()
    if not child:
        try:
            for name in ("SIGALRM", *FAULTS):
                signal.signal(getattr(signal, name), signal.SIG_DFL)
            signal.alarm(TRIAL)
            unpack(content, path, *wanted)
        finally:
            os._exit(0)
    return apart.Outcome.CRASHED if os.WIFSIGNALED(os.waitpid(child, 0)[1]) else apart.Outcome.THROUGH


@contextmanager
def limited() -> Iterator[None]:
    """Raise TooSlow after some seconds, where the system can."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TooSlow

    if not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def read_split(path: Path) -> tuple[Recording, ...]:
    """The recordings of a file, by every way that commands read them."""
    try:
        found = read_recordings(path, allow_gaps=True)
    except DeatwinError:
        return read_recordings(path, input_column="#2", output_column="#3", time_column="#1")
    read_experiment([path], allow_gaps=True)
    return found


def require_recordings(found: tuple[Recording, ...]) -> None:
    """Finite samples on a rising clock that are written and read back to the last bit; extra channels may have gaps."""
    for recording in found:
        for values in (recording.inputs, recording.outputs, recording.timepts):
            assert np.isfinite(values).all()
        assert not any(np.isinf(values).any() for values in recording.extras.values())
        assert recording.sample_time > 0.0
        assert (np.diff(recording.timepts) > 0.0).all()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "again.csv"
            write_recording(path, recording)
            (again,) = read_recordings(path)
        assert again.inputs.tobytes() == recording.inputs.tobytes()
        assert again.outputs.tobytes() == recording.outputs.tobytes()
        assert list(again.extras) == list(recording.extras)
        for name, values in recording.extras.items():
            assert np.array_equal(again.extras[name], values, equal_nan=True)
        assert (again.sample_time, again.start) == (recording.sample_time, recording.start)


def require_rig(rig: RigFile) -> None:
    """A rig that is written and read back, and that the schema allows."""
    assert read_back(rig) == rig
    assert not list(validator("deatwin/rig/1").iter_errors(rig.to_dict()))


def read_back(rig: RigFile) -> RigFile:
    """The rig once more, of what it writes."""
    return RigFile.from_dict(rig.to_dict(), rig.source)


def require_document(found: Any) -> None:
    """An object that is written as its schema has it, and read back as the same."""
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder) / "first.json", Path(folder) / "second.json"
        found.save(first)
        written = json.loads(first.read_text(encoding="utf-8"))
        faults = [
            f"{list(fault.absolute_path)}: {fault.message[:200]}"
            for fault in validator(written["schema"]).iter_errors(written)
            if fault.validator != "additionalProperties"  # of a later version, kept
        ]
        assert not faults, faults
        type(found).load(first).save(second)
        assert second.read_bytes() == first.read_bytes()


@cache
def validator(schema: str) -> Any:
    """The validator of a shipped schema."""
    import jsonschema

    return jsonschema.Draft202012Validator(shipped_schema(schema))


def recording() -> Recording:
    """A few samples with everything that a file can hold of them."""
    k = np.arange(12.0)
    return Recording.from_arrays(
        2 + 0.1 * k, 1e-4 * (3 + k % 5), 0.02, start=1.0, extras={"temperature": 293.0 + k}, provenance={"rig": "Élan"}
    )


def written(ending: str, save: Callable[[Path], None]) -> bytes:
    """The bytes of a file that something writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"seed{ending}"
        save(path)
        return path.read_bytes()


@cache
def csv_seeds() -> tuple[bytes, ...]:
    """Plain, described, with units in a line of their own, decimal commas, blanks, dates, in other encodings."""
    described = written(".csv", lambda path: write_recording(path, recording()))
    units = "Zeit;command;displacement\n(s);(mV);(µm)\n0,00;1,5;2\n0,02;2,5;2\n0,04;1,5;3\n"
    quoted = '"time_s","command_V","displacement_mm"\n"0.00","1","2"\n"0.02","1.5","2"\n"0.04","1","2"\n'
    nameless = "".join(f" {0.02 * k:.2e}  {k % 3}.0\t{k % 2}\n" for k in range(5))
    blanks = f"# time_s command_V displacement_mm\n{nameless}"
    dates = "time,command_V,displacement_mm\n" + "".join(f"2024-05-01T12:00:0{k}Z,{k % 3},1\n" for k in range(5))
    unix = "timestamp,command_V,displacement_mm\n" + "".join(f"{1759181382000 + 20 * k},{k % 3},1\n" for k in range(5))
    texts = (CSV, units, quoted, blanks, nameless, dates, unix)
    return (described, units.encode("latin-1"), CSV.encode("utf-16"), *(text.encode() for text in texts))


def lvm_text(separator: str, decimal: str, x_columns: str) -> str:
    """A LabVIEW measurement of two segments, as NI's specification of the format has it."""
    apart = [""] if x_columns == "Multi" else []

    def row(tag: str, first: str, second: str) -> str:
        return separator.join([tag, first, *apart, second, ""])

    about = {
        "LabVIEW Measurement": "",
        "Writer_Version": "2",
        "Reader_Version": "2",
        "Separator": {"\t": "Tab", ",": "Comma"}[separator],
        "Decimal_Separator": decimal,
        "Multi_Headings": "Yes",
        "X_Columns": x_columns,
        "Time_Pref": "Relative",
        "Date": "2024/05/01",
        "Time": f"12:00:00{decimal}25",
        "***End_of_Header***": "",
    }
    lines = [f"{tag}{separator}{value}" for tag, value in about.items()]
    for second in (0, 1):
        lines += ["", row("Channels", "2", ""), row("Samples", "5", "5"), row("Date", "2024/05/01", "2024/05/01")]
        lines.append(row("Time", *[f"12:00:0{second}{decimal}2500000000000000000"] * 2))
        lines += [row("Y_Unit_Label", "Volts", "mm"), row("X_Dimension", "Time", "Time")]
        lines += [row("X0", *["0.0".replace(".", decimal)] * 2), row("Delta_X", *["0.2".replace(".", decimal)] * 2)]
        names = ["X_Value", "command", *["X_Value"] * len(apart), "displacement", "Comment"]
        lines += ["***End_of_Header***", separator.join(names)]
        for k in range(5):
            x, u, y = (f"{value:.4f}".replace(".", decimal) for value in (0.2 * k, second + 0.5 * k, 0.25 * k))
            x = "" if x_columns == "No" else x
            lines.append(separator.join([x, u, *[x] * len(apart), y, *(['a "note"'] if k == 0 else [])]))
    return "\r\n".join(lines)


@cache
def lvm_seeds() -> tuple[bytes, ...]:
    """Each way to hold x values."""
    ways = (("\t", ".", "No"), ("\t", ",", "One"), (",", ".", "Multi"))
    return tuple(lvm_text(*way).encode() for way in ways)


@cache
def xlsx_seeds() -> tuple[bytes, ...]:
    """A workbook with dates."""
    from datetime import datetime, timedelta

    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["time", "command_V", "displacement_mm"])
    for k in range(6):
        book.active.append([datetime(2024, 5, 1) + timedelta(milliseconds=100 * k), 1.5 * k, k % 2])
    stream = io.BytesIO()
    book.save(stream)
    return (stream.getvalue(),)


@cache
def mat_seeds() -> tuple[bytes, ...]:
    """Version 5 packed and not, with structs and cells, version 4."""
    from scipy.io import savemat

    k = np.arange(12.0)
    table = {"time_s": 0.02 * k, "command_V": 2 + 0.1 * k, "displacement_mm": k % 5}
    nested = {"log": table, "units": {"command": "V"}, "cells": np.array([k, "text"], dtype=object), "fs": 50}
    found = [written(".mat", lambda path: write_recording(path, recording()))]
    for content, packed, version in ((nested, False, "5"), (nested, True, "5"), (table, False, "4")):
        stream = io.BytesIO()
        savemat(stream, content, do_compression=packed, format=version, oned_as="column")
        found.append(stream.getvalue())
    return tuple(found)


def hdf5(*, user_block: int) -> bytes:
    """An HDF5 file with a recording, packed and not, and a group; MATLAB puts 512 bytes of its own before it."""
    import h5py

    k = np.arange(12.0)
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=user_block) as file:
        for name, values in {"time_s": 0.02 * k, "command_V": 2 + 0.1 * k}.items():
            file.create_dataset(name, data=values, chunks=(12,), compression="gzip").attrs["MATLAB_class"] = "double"
        where = file.create_group("log") if user_block else file
        where.create_dataset("displacement_mm", data=k % 5)
        text = file.create_dataset("remark", data=np.frombuffer("on a µ table".encode("utf-16-le"), dtype="<u2"))
        text.attrs["MATLAB_class"] = "char"
    return stream.getvalue()


@cache
def mat73_seeds() -> tuple[bytes, ...]:
    """Version 7.3."""
    return (hdf5(user_block=512),)


@cache
def netcdf_seeds() -> tuple[bytes, ...]:
    """Version 3, with and without a record dimension."""
    from scipy.io import netcdf_file

    found = []
    for length in (12, None):
        stream = io.BytesIO()
        with netcdf_file(stream, "w") as file:
            file.createDimension("time", length)
            for name, values in (("time", 0.02), ("command", 2.0), ("displacement", 3.0)):
                variable = file.createVariable(name, "f8", ("time",))
                variable[:] = values * np.arange(12.0)
                variable.units = {"time": "s", "command": "V", "displacement": "mm"}[name]
            file.title = "a recording"
            file.flush()
            found.append(stream.getvalue())
    return tuple(found)


@cache
def netcdf4_seeds() -> tuple[bytes, ...]:
    """Version 4."""
    return (written(".nc", lambda path: write_recording(path, recording())), hdf5(user_block=0))


@cache
def tdms_seeds() -> tuple[bytes, ...]:
    """As deatwin writes it, and of several segments with waveform properties."""
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    clock = {"wf_increment": 0.02, "wf_start_offset": 0.0, "wf_start_time": np.datetime64("2024-05-06T07:08:09")}
    with TdmsWriter(stream) as writer:
        for part in np.split(np.arange(12.0), 3):
            writer.write_segment(
                [
                    ChannelObject("log", "command", 2 + part, {"unit_string": "V", **clock}),
                    ChannelObject("log", "displacement", part % 5, {"unit_string": "mm", **clock}),
                ]
            )
    return (written(".tdms", lambda path: write_recording(path, recording())), stream.getvalue())


@cache
def plant_seeds() -> tuple[bytes, ...]:
    """A plant with two effects."""
    from deatwin.plant import Creep, thesis_plant

    plant = CalibratedPlant.nominal(thesis_plant().with_effects(Creep()))
    return (written(".json", plant.save),)


@cache
def narx_seeds() -> tuple[bytes, ...]:
    """One output, and two."""
    one = NarxModel.from_terms({"y(k-1)": 0.8, "u(k-1)": 0.1, "u(k-2)^2": 0.02, "1": 0.1}, sample_time=0.02)
    return (written(".json", one.save),)


@cache
def linear_seeds() -> tuple[bytes, ...]:
    """An ARX model."""
    from deatwin.ident.narx.linear import Arx

    rng = np.random.default_rng(1)
    u = rng.normal(size=60)
    y = np.convolve(u, [0.0, 0.5, 0.3])[:60] + 0.01 * rng.normal(size=60)
    return (written(".json", Arx().fit([Recording.from_arrays(u, y, 0.1)]).model_.save),)


@cache
def states_seeds() -> tuple[bytes, ...]:
    """A state space with a direction and a function."""
    model = NonlinearStateSpace(
        terms=["tanh(s1,1)", "x1^2 u"],
        transition=[[0, 0.5, 1, 0.2, 0.1]],
        output=[[0, 1, 0, 0, 0]],
        directions=[[0, 1, 1, 0, 0]],
        free_directions=[[False, True, True, False, False]],
        sample_time=0.1,
    )
    return (written(".json", model.save),)


@cache
def theta_seeds() -> tuple[bytes, ...]:
    """Parameters along three times."""
    model = NarxModel.from_terms({"y(k-1)": 0.8, "u(k-1)": 0.1}, sample_time=0.02)
    trajectory = ThetaTrajectory(
        model=model,
        timepts=np.array([0.02, 0.04, 0.06]),
        theta=np.array([[0.8, 0.79, 0.78], [0.1, 0.1, 0.11]]),
        theta_cov=np.tile(1e-4 * np.eye(2), (3, 1, 1)),
        drift_variance=np.array([1e-6, 0.0]),
        log_likelihood=-12.5,
    )
    return (written(".json", trajectory.save),)


@cache
def validation_seeds() -> tuple[bytes, ...]:
    """Of a model on noise."""
    rng = np.random.default_rng(2)
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 0.3}, sample_time=0.1)
    noise = Recording.from_arrays(rng.normal(size=200), rng.normal(size=200), 0.1)
    return (written(".json", validate(model, noise, max_lag=3).save),)


def exported(path: Path) -> Any:
    """The controller of a check as C source."""
    from deatwin.app.commands.export import _Given

    return _Given.load(str(path)).source(name="loop")


def require_source(found: Any) -> None:
    """C source that bears the name."""
    assert "loop" in found.text and "\x1b" not in found.text


def stored(name: str) -> Callable[[], tuple[bytes, ...]]:
    """A file that deatwin wrote once, with its long lists cut."""
    return lambda: ((SEEDS / name).read_bytes(),)


def document(cls: Any, seeds: Callable[[], tuple[bytes, ...]]) -> Kind:
    """A kind of document."""
    return Kind(ending=".json", read=cls.load, require_sound=require_document, seeds=seeds)


def table(ending: str, seeds: Callable[[], tuple[bytes, ...]]) -> Kind:
    """A kind of recording."""
    return Kind(ending=ending, read=read_split, require_sound=require_recordings, seeds=seeds)


RECORDINGS: Mapping[str, Kind] = {
    "csv": table(".csv", csv_seeds),
    "lvm": table(".lvm", lvm_seeds),
    "xlsx": table(".xlsx", xlsx_seeds),
    "mat": table(".mat", mat_seeds),
    "mat73": table(".mat", mat73_seeds),
    "tdms": table(".tdms", tdms_seeds),
    "netcdf": table(".nc", netcdf_seeds),
    "netcdf4": table(".nc", netcdf4_seeds),
}
RIGS: Mapping[str, Kind] = {
    "rig": Kind(ending=".toml", read=read_rig, require_sound=require_rig, seeds=lambda: (RIG.encode(),))
}
DOCUMENTS: Mapping[str, Kind] = {
    "plant": document(CalibratedPlant, plant_seeds),
    "narx": document(NarxModel, narx_seeds),
    "linear": document(LinearModel, linear_seeds),
    "states": document(NonlinearStateSpace, states_seeds),
    "diagnosis": document(Diagnosis, stored("diagnosis.json")),
    "check": document(Check, stored("check.json")),
    "theta": document(ThetaTrajectory, theta_seeds),
    "validation": document(Validation, validation_seeds),
    "controller": Kind(ending=".json", read=exported, require_sound=require_source, seeds=stored("check.json")),
}
KINDS: Mapping[str, Kind] = {**RECORDINGS, **RIGS, **DOCUMENTS}
