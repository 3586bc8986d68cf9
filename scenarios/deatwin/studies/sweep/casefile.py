"""A case as a NetCDF file of version 3, which SciPy, xarray, ncdump and MATLAB read.

The variable ``record`` holds the case as JSON, to the last bit; the others are there to be looked at, by their path in
the case, such as ``result.gain``. ``sha256`` is that of the file with 64 zeros in its place.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.files.replacing import replacing
from deatwin.plant.safe_read import DOCUMENT_BYTES, read_regular

CASE_ENDING = ".nc"
SCHEMA = "deatwin/case-file/1"
RECORD = "record"
MAGIC = b"CDF\x01"
UNKNOWN = b"0" * 64
STATED = re.compile(rb"sha256\0\0\0\0\0\x02\0\0\0\x40([0-9a-f]{64})")
"""The hash attribute in the bytes of a file: name, type, length, value."""
INT32 = np.iinfo(np.int32)
HOLD = "it must hold the result of a case: delete it, and the case is run again"
Array = NDArray[Any]


def encode(record: Mapping[str, Any]) -> bytes:
    """Return the content of a case's file."""
    from scipy.io import netcdf_file

    buffer = io.BytesIO()
    with netcdf_file(buffer, "w") as file:
        file.schema, file.sha256 = SCHEMA, UNKNOWN
        text = np.frombuffer(json.dumps(record, ensure_ascii=True).encode("ascii"), dtype="S1")
        _add(file, RECORD, text, (_length(file, f"{RECORD}_length", text.size),))
        found = list(_variables("", record))
        names = _distinct([path for path, _ in found])
        for (path, values), name in zip(found, names, strict=True):
            variable = _add(file, name, values, _dimensions(file, name, values, names))
            if name != path:
                variable.long_name = path.encode("utf-8", "backslashreplace")
        file.flush()
        content = buffer.getvalue()  # before the file closes the buffer
    return _stating(content, hashlib.sha256(content).hexdigest().encode())


def decode(content: bytes) -> dict[str, Any]:
    """Return the case from a file made by `encode`."""
    from scipy.io import netcdf_file

    stated = STATED.search(content)
    if not content.startswith(MAGIC) or stated is None:
        raise ValueError("no file of a case")
    if hashlib.sha256(_stating(content, UNKNOWN)).hexdigest().encode() != stated[1]:
        raise ValueError("damaged or altered")
    with netcdf_file(io.BytesIO(content), "r", mmap=False) as file:
        record: dict[str, Any] = json.loads(file.variables[RECORD].data.tobytes())
    return record


def read_case(path: Path | str) -> dict[str, Any]:
    """Read the file of a case."""
    try:
        return decode(read_regular(path, DOCUMENT_BYTES, ValueError))
    except OSError:
        raise DataError(f"{path}: this case has not been run") from None
    except ValueError as error:
        raise DataError(f"{path}: {error}; {HOLD}") from None


def write_case(path: Path | str, record: Mapping[str, Any]) -> None:
    """Write the file of a case, completely or not at all."""
    content = encode(record)
    with replacing(path) as half:
        half.write_bytes(content)


def _stating(content: bytes, sha256: bytes) -> bytes:
    """Replace the hash in the file; dimension names, which come first, are not surrounded by zero bytes."""
    return STATED.sub(lambda found: found[0][:-64] + sha256, content, count=1)


def _variables(path: str, value: Any) -> Iterator[tuple[str, Array]]:
    """Return the parts of a value that can be variables, by path; rows of a table become columns."""
    if isinstance(value, (list, tuple)) and value and all(isinstance(row, dict) for row in value):
        value = {key: [row.get(key) for row in value] for key in dict.fromkeys(key for row in value for key in row)}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _variables(f"{path}.{key}" if path else str(key), inner)
    elif (array := _array(value)) is not None:
        yield path, array


def _array(value: Any) -> Array | None:
    """Return a value in the classic format; None for nothing, empty values and unequal lengths."""
    if value is None or (isinstance(value, (str, list, tuple)) and not value):
        return None
    if isinstance(value, str):
        return _letters(value)
    if isinstance(value, (list, tuple)) and isinstance(next((v for v in value if v is not None), None), str):
        return _letters(value) if all(v is None or isinstance(v, str) for v in value) else None
    try:
        array = np.array(value)
        if array.dtype.kind == "O" and all(v is None or isinstance(v, (bool, int, float)) for v in array.flat):
            array = array.astype(np.float64)  # None in an array is NaN
    except (ValueError, OverflowError):  # rows of unequal lengths, or a number too large for a float
        return None
    return _narrowed(array) if array.size and array.dtype.kind in "biuf" else None


def _narrowed(array: Array) -> Array:
    """Convert truth values and large integers, which the format does not have."""
    if array.dtype.kind == "b":
        return array.astype(np.int8)
    if array.dtype.kind in "iu":
        return array.astype(np.int32 if array.min() >= INT32.min and array.max() <= INT32.max else np.float64)
    return array.astype(np.float64, copy=False)


def _letters(value: Any) -> Array | None:
    """Return one or several texts as UTF-8 bytes along a last axis."""
    one = isinstance(value, str)
    texts = np.array([(text or "").encode("utf-8", "backslashreplace") for text in ([value] if one else value)])
    if not texts.dtype.itemsize:
        return None
    letters = texts.view("S1").reshape(texts.size, -1)
    return letters[0] if one else letters


def _distinct(paths: list[str]) -> list[str]:
    """Return unique names that every reader accepts."""
    taken = {RECORD, f"{RECORD}_length"}
    return [_free(_lettered(path), taken) for path in paths]


def _lettered(path: str) -> str:
    name = re.sub(r"[^A-Za-z0-9_.+-]", "_", path)[:200]
    return name if name[:1].isalnum() or name[:1] == "_" else f"_{name}"


def _free(name: str, taken: set[str]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free


def _dimensions(file: Any, name: str, values: Array, names: list[str]) -> tuple[str, ...]:
    """Name one dimension per axis, different from all variables, which xarray would take as coordinates."""
    text = values.dtype.kind == "S"
    own = values.shape[:-1] if text else values.shape
    taken = {*names, *file.dimensions}
    found = [_length(file, _free(f"{name}_{axis}", taken), size) for axis, size in enumerate(own)]
    if text:
        found.append(_length(file, _free(f"{name}_text", taken), values.shape[-1]))
    return tuple(found)


def _length(file: Any, name: str, size: int) -> str:
    file.createDimension(name, size)
    return name


def _add(file: Any, name: str, values: Array, dimensions: tuple[str, ...]) -> Any:
    variable = file.createVariable(name, values.dtype.str[1:] if values.dtype.kind != "S" else "S1", dimensions)
    variable[...] = values
    if values.dtype.kind == "S":
        variable._Encoding = "utf-8"  # xarray then decodes it as text
    return variable
