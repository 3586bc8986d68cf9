"""Columns of the files of public recordings, by the names that their publishers gave them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.files.formats.optional import reading, require


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
