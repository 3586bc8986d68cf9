"""The public recordings, divided into training and test parts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from deatwin.ident.narx.terms import Rule
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.files.formats.optional import reading, require
from deatwin.plant.recording import Recording

SILVERBOX_RATE = 1e7 / 2**14  # Hz
ARROW_HEAD, MULTISINE = slice(0, 40_000), slice(40_650, 127_400)
"""Samples of the usual parts; between and after them the input rests or is another signal."""
BOUC_WEN_RATE, BOUC_WEN_PERIOD = 750.0, 8192  # Hz; samples of a multisine
EMPS_STEP = 10  # Samples of 1 ms from one of a black box under control to its next
EMPS_FILES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
EMPS_DECIMATION = (10, 2)
"""Factors of the decimation from 1 kHz to 50 Hz: a stroke takes seconds, and friction changes its sign within tens of
milliseconds."""

EMPS_EDGE = 20  # Samples left out at either end
EMPS_LEAST = 1000  # Fewest samples that the filters can take


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """Candidate terms for the choice of a structure."""

    output_lags: int  # Number of output lags
    input_lags: tuple[int, ...]  # Input lags
    degree: int  # Largest degree
    max_terms: int  # Largest number of terms
    rule: Rule | None = None  # Rule that decides which candidates are kept
    functions: tuple[str, ...] = ()  # Functions of lagged signals that are candidates as well

    @property
    def arguments(self) -> dict[str, object]:
        """Return arguments for an estimator, without the number of terms."""
        return {name: value for name, value in vars(self).items() if name != "max_terms"}


class Learner(Protocol):
    """Interface of an estimator."""

    model_: Any

    def fit(self, recordings: Recording, /) -> Learner:
        """Fit to recordings, and keep the model."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class DataSet:
    """A public data set."""

    name: str  # Name in files and on the page
    title: str
    train: Recording  # Training recording
    test: Recording
    candidates: Candidates
    unit: str  # Unit in which errors are shown
    scale: float  # Size of that unit, in the unit of the output
    files: tuple[Path, ...] = ()  # Files from which it was read
    parts: int = 1  # Parts into which a long training recording is cut to grow structures
    further: Mapping[str, Learner] = field(default_factory=dict)  # Estimators made for this data set, by name


def buck(folder: Path) -> DataSet:
    """The converter, with the candidates of SysIdentPy's documentation."""
    files = tuple(folder / f"buck_{part}.csv" for part in ("id", "valid"))
    tables = [csv_columns(file, ("input", "y")) for file in files]
    train, test = (recorded(t[:, 0], t[:, 1], 1e-5, ("V", "V"), file) for t, file in zip(tables, files, strict=True))
    return DataSet(
        name="buck",
        title="Buck converter",
        train=train,
        test=test,
        unit="V",
        scale=1.0,
        files=files,
        candidates=Candidates(output_lags=2, input_lags=(1, 2), degree=2, max_terms=8),
    )


def silverbox(folder: Path) -> DataSet:
    """Return the oscillator's recordings, with the multisine for training."""
    table, file = silverbox_table(folder)
    require_samples(file, len(table), MULTISINE.stop)
    whole = recorded(table[:, 0], table[:, 1], 1 / SILVERBOX_RATE, ("V", "V"), file)
    return DataSet(
        name="silverbox",
        title="Silverbox",
        unit="mV",
        scale=1e-3,
        files=(file,),
        parts=4,
        train=whole.section(MULTISINE.start, MULTISINE.stop),
        test=whole.section(ARROW_HEAD.start, ARROW_HEAD.stop),
        candidates=Candidates(output_lags=3, input_lags=(0, 1, 2, 3), degree=3, max_terms=15),
    )


def silverbox_table(folder: Path) -> tuple[Array, Path]:
    """All samples of the oscillator: input and output, V, shape (131072, 2)."""
    return _columns(folder, "SNLS80mV", ("V1", "V2"))


def cascaded_tanks(folder: Path) -> DataSet:
    """The two tanks, with an overflow at 10 V."""
    table, file = _columns(folder, "dataBenchmark", ("uEst", "uVal", "yEst", "yVal"))
    train, test = (recorded(table[:, i], table[:, i + 2], 4.0, ("V", "V"), file) for i in (0, 1))
    return DataSet(
        name="tanks",
        title="Cascaded tanks",
        train=train,
        test=test,
        unit="V",
        scale=1.0,
        files=(file,),
        candidates=Candidates(output_lags=3, input_lags=(1, 2, 3), degree=3, max_terms=15),
    )


def bouc_wen(folder: Path) -> DataSet:
    """The simulated Bouc-Wen benchmark: two periods of the training multisine, and the test multisine."""
    force, motion = bouc_wen_signals(folder / "train.h5", "multisine", 4 * BOUC_WEN_PERIOD)
    kept = slice(2 * BOUC_WEN_PERIOD)
    return DataSet(
        name="bouc_wen",
        title="Bouc-Wen",
        unit="mm",
        scale=1e-3,
        files=(folder / "train.h5", folder / "test.h5"),
        train=recorded(force[kept], motion[kept], 1 / BOUC_WEN_RATE, ("N", "m")),
        test=bouc_wen_test(folder, "multisine"),
        candidates=Candidates(output_lags=3, input_lags=(0, 1, 2, 3), degree=3, max_terms=15),
    )


def bouc_wen_signals(file: Path, name: str, least: int = BOUC_WEN_PERIOD) -> tuple[Array, Array]:
    """Force in N and displacement in m of a signal of the benchmark, shapes (n,)."""
    force, motion = hdf5_vectors(file, name, ("u", "y"))
    require_samples(file, force.size, least)
    return force, motion


def bouc_wen_test(folder: Path, name: str) -> Recording:
    """A test signal of the benchmark, as sampled."""
    return recorded(*bouc_wen_signals(folder / "test.h5", name), 1 / BOUC_WEN_RATE, ("N", "m"))


def emps(folder: Path) -> DataSet:
    """The positioning system: force in, velocity out, decimated."""
    files = tuple(folder / name for name in EMPS_FILES)
    train, test = (_emps(path) for path in files)
    return DataSet(
        name="emps",
        title="EMPS",
        train=train,
        test=test,
        unit="mm/s",
        scale=1e-3,
        files=files,
        candidates=Candidates(output_lags=2, input_lags=(0, 1, 2), degree=3, max_terms=12),
    )


def _emps(path: Path) -> Recording:
    from scipy.signal import decimate

    data = matlab_vectors(path, ("vir", "qm", "gtau"))
    require_samples(path, data["qm"].size, EMPS_LEAST)
    force = data["vir"] * data["gtau"][0]  # motor force as recorded, which already includes the pulses
    position, step = data["qm"], 1e-3
    for factor in EMPS_DECIMATION:
        force, position = (decimate(signal, factor, ftype="fir") for signal in (force, position))
        step *= factor
    within = slice(EMPS_EDGE, -EMPS_EDGE)  # the filters have no samples beyond the ends
    return recorded(force[within], np.gradient(position, step)[within], step, ("N", "m/s"), path)


def emps_deviation(train: Recording, test: Recording) -> DataSet:
    """The controlled positioning system: velocity of the reference in, deviation of the position from it out."""

    def deviation(record: Recording) -> Recording:
        reference, position = record.inputs[0], record.outputs[0]
        velocity, step = np.gradient(reference, record.sample_time), EMPS_STEP * record.sample_time
        return recorded(velocity[::EMPS_STEP], (position - reference)[::EMPS_STEP], step, ("m/s", "m"))

    return DataSet(
        name=f"emps_{test.start:g}",
        title="EMPS",
        unit="µm",
        scale=1e-6,
        train=deviation(train),
        test=deviation(test),
        candidates=Candidates(output_lags=2, input_lags=(0, 1, 2), degree=3, max_terms=12),
    )


def emps_averaged(path: Path, count: int) -> Recording:
    """Motor voltage in, position out: the mean voltage of each `count` samples of 1 ms, the position at their beginning."""
    data = matlab_vectors(path, ("qm", "vir"))
    n = data["qm"].size // count * count
    voltage = data["vir"][:n].reshape(-1, count).mean(axis=1)
    return recorded(voltage, data["qm"][:n:count], 1e-3 * count, ("V", "m"), path)


def recorded(inputs: Array, outputs: Array, step: float, units: tuple[str, str], path: Path | None = None) -> Recording:
    """Make the recording of a data set. Shapes: `inputs, outputs` (n,)."""
    return Recording.from_arrays(
        inputs,
        outputs,
        step,
        input_names=("input",),
        output_names=("output",),
        input_units=units[:1],
        output_units=units[1:],
        provenance={} if path is None else {"file": path.name},
    )


def _columns(folder: Path, stem: str, names: Sequence[str]) -> tuple[Array, Path]:
    """Return columns of a set published as both CSV and MAT, and the file that exists."""
    matlab = folder / f"{stem}.mat"
    file = folder / f"{stem}.csv"
    if file.is_file() or not matlab.is_file():
        return csv_columns(file, names), file
    return np.column_stack(list(matlab_vectors(matlab, names).values())), matlab


def require_samples(path: Path, found: int, needed: int) -> None:
    """Raise an error for a file with too few samples, because it is truncated or another version."""
    if found < needed:
        raise DataError(f"{path}: it has {found} samples; the published file has at least {needed}: download it again")


def csv_columns(path: Path, names: Sequence[str]) -> Array:
    """Return columns of a CSV file with one header line. Shapes: returns (n, len(names))."""
    _require_file(path)
    with reading(str(path), "CSV"), path.open(encoding="utf-8-sig") as file:
        headers = [name.strip().strip('"') for name in file.readline().split(",")]
        _require_names(path, names, headers)
        places = [headers.index(name) for name in names]
        table = np.asarray(np.genfromtxt(file, delimiter=",", usecols=places, dtype=float, ndmin=2))
    _require_sound(path, dict(zip(names, table.T, strict=True)))
    return table


def matlab_vectors(path: Path, names: Sequence[str], *, optional: Sequence[str] = ()) -> Mapping[str, Array]:
    """Return vectors of a MATLAB file of version 5. Shapes: returns (n,)."""
    from scipy.io import loadmat

    _require_file(path)
    with reading(str(path), "MATLAB"):
        held = loadmat(path, variable_names=[*names, *optional])
        _require_names(path, names, held)
        vectors = {name: held[name].astype(float).ravel() for name in (*names, *optional) if name in held}
    _require_sound(path, vectors)
    return vectors


def hdf5_vectors(path: Path, group: str, names: Sequence[str]) -> tuple[Array, ...]:
    """Return vectors of a group in an HDF5 file. Shapes: returns (n,)."""
    h5py = require("h5py", str(path))
    _require_file(path)
    with reading(str(path), "HDF5"), h5py.File(path, "r") as file:
        held = file.get(group, {})
        _require_names(path, names, held)
        vectors = {name: held[name][()].astype(float).ravel() for name in names}
    _require_sound(path, vectors)
    return tuple(vectors.values())


def _require_file(path: Path) -> None:
    if not path.is_file():
        raise DataError(f"{path}: no such file; --data or DEATWIN_DATA must name the folder of public recordings")


def _require_names(path: Path, names: Sequence[str], found: Collection[str]) -> None:
    for name in names:
        if name not in found:
            raise DataError(f'{path}: no "{name}"; the published file has it: download it again')


def _require_sound(path: Path, vectors: Mapping[str, Array]) -> None:
    """Raise an error unless vectors (n,) have finite numbers and one length; constants have one value."""
    lengths = {name: values.size for name, values in vectors.items() if values.size != 1}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f'"{name}" has {n}' for name, n in lengths.items())
        raise DataError(f"{path}: its signals differ in length ({told} samples); download it again")
    for name, values in vectors.items():
        if not (finite := np.isfinite(values)).all():
            at = int(np.argmin(finite))
            raise DataError(
                f'{path}: "{name}" is {values[at]} at sample {at}; the published file is finite: download it again'
            )
