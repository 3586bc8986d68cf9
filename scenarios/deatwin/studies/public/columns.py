"""Columns of the files of public recordings, by the names that their publishers gave them; a fault is one error."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.files.csvtable import read_bytes
from deatwin.plant.files.formats.apart import unpacked
from deatwin.plant.files.formats.optional import reading, require
from deatwin.plant.files.formats.unpacked import require_plain_hdf5, require_sound_level_5
from deatwin.plant.safe_read import clipped

LARGEST = 100_000_000  # Most bytes of such a file; the largest published one has some 5 million

NUMERIC = frozenset(
    {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
)
"""Classes of MATLAB's variables that hold numbers."""


def require_file(path: Path) -> Path:
    """Return the path of a required file."""
    if not path.is_file():
        raise DataError(f"{path}: no such file; --data or DEATWIN_DATA must name the folder of public recordings")
    return path


def require_samples(path: Path, found: int, needed: int) -> None:
    """Raise an error for a file with too few samples, because it is truncated or another version."""
    if found < needed:
        raise DataError(f"{path}: it has {found} samples; the published file has at least {needed}: download it again")


def csv_columns(path: Path, names: Sequence[str]) -> Array:
    """Return columns of a CSV file with one header line. Shapes: returns (n, len(names))."""
    content = read_bytes(require_file(path), LARGEST)
    with reading(str(path), "CSV"):
        head, *lines = content.decode("utf-8-sig").splitlines() or [""]
        headers = [name.strip().strip('"') for name in head.split(",")]
        _require_names(path, names, headers)
        places = [headers.index(name) for name in names]
        found = np.genfromtxt(lines, delimiter=",", usecols=places, dtype=float, ndmin=2)
    return _finite(path, found, names)


def matlab_vectors(
    path: Path, names: Sequence[str], *, single: Sequence[str] = (), optional: Sequence[str] = ()
) -> Mapping[str, Array]:
    """Return vectors of a MATLAB file of version 5. Shapes: returns (n,)."""
    content = read_bytes(require_file(path), LARGEST)
    with reading(str(path), "MATLAB"):
        plain, held = unpacked(level_5_numbers, content, str(path), *names, *single, *optional)
        _require_names(path, [*names, *single], plain)
        _require_names(path, [name for name in (*names, *single, *optional) if name in plain], list(held))
        vectors = [*names, *(name for name in optional if name in held)]
        found = {name: _vector(path, name, held[name]) for name in (*vectors, *single)}
    _require_one_length(path, [found[name] for name in vectors], vectors)
    for name in single:
        if found[name].size != 1:
            raise DataError(f'{path}: "{name}" has {found[name].size} values; it must have one')
    return found


def level_5_numbers(content: bytes, path: str, *wanted: str) -> tuple[list[str], dict[str, Any]]:
    """Return the names of the numeric variables, and the requested variables."""
    from scipy.io import loadmat, whosmat

    require_sound_level_5(content, path)
    plain = [name for name, _, kind in whosmat(io.BytesIO(content)) if kind in NUMERIC]
    return plain, loadmat(io.BytesIO(content), variable_names=[name for name in wanted if name in plain])


def hdf5_vectors(path: Path, group: str, names: Sequence[str]) -> tuple[Array, ...]:
    """Return vectors of a group in an HDF5 file. Shapes: returns (n,)."""
    require("h5py", str(path))
    content = read_bytes(require_file(path), LARGEST)
    with reading(str(path), "HDF5"):
        there, held = unpacked(hdf5_arrays, content, str(path), group, *names)
        _require_names(path, names, there)
        found = tuple(_vector(path, name, held[name]) for name in names)
    _require_one_length(path, found, names)
    return found


def hdf5_arrays(content: bytes, path: str, group: str, *wanted: str) -> tuple[list[str], dict[str, Any]]:
    """Return the names of a group's datasets, and the requested datasets."""
    h5py = require("h5py", path)
    with h5py.File(io.BytesIO(content), "r") as file:
        require_plain_hdf5(file, path)
        held = file[group] if group in file else {}
        there = [name for name in held if isinstance(held[name], h5py.Dataset)]
        return there, {name: held[name][()] for name in wanted if name in there}


def _vector(path: Path, name: str, value: Any) -> Array:
    values = np.asarray(value)
    if values.dtype.kind not in "fiub":
        raise DataError(f'{path}: "{name}" does not hold numbers')
    return _finite(path, values.astype(float).ravel()[:, None], (name,))[:, 0]


def _finite(path: Path, found: Array, names: Sequence[str]) -> Array:
    if not len(found):
        raise DataError(f"{path}: it holds no samples")
    rows, columns = np.nonzero(~np.isfinite(found))
    if rows.size:
        raise DataError(f'{path}: sample {rows[0] + 1} of "{names[columns[0]]}" is not a finite number')
    return found


def _require_names(path: Path, names: Sequence[str], found: Sequence[str]) -> None:
    for name in names:
        if name not in found:
            there = ", ".join(f'"{clipped(one, 30)}"' for one in found[:10]) or "nothing that can be used"
            raise DataError(f'{path}: no "{name}"; the file has {there}')


def _require_one_length(path: Path, found: Sequence[Array], names: Sequence[str]) -> None:
    if len({values.size for values in found}) > 1:
        lengths = ", ".join(f'"{name}" {values.size}' for name, values in zip(names, found, strict=True))
        raise DataError(f"{path}: its vectors must have one length; they have {lengths}")
