"""MATLAB files: version 5 (and 4, 6, 7) by SciPy, 7.3 (HDF5 behind a user block of 512 bytes) and other HDF5 by h5py.

Signals are numeric vectors named as CSV columns are, alone or as fields of structs, ``signals(2).values`` in an array of
structs, columns of a matrix, ``data(:,2)``, or fields of a compound data set of HDF5. A text ``name`` or ``unit`` beside
the only vector of a struct names that vector or its unit; a struct ``units`` (``units.command = 'V'``) and attributes of
HDF5 name units, too. A scalar ``Ts``, ``dt`` or ``sample_time`` (s), ``fs`` or ``sample_rate`` (Hz) states the clock of a
file without times. Texts go into the provenance.
"""

import hashlib
import io
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.files.csvtable import read_bytes, read_table
from deatwin.plant.files.formats.apart import unpacked
from deatwin.plant.files.formats.arrays import (
    WIDEST,
    ArrayTable,
    array_table,
    numeric,
    of_matrix,
    require_no_scale,
    short_names,
    units_of,
    unscaled,
)
from deatwin.plant.files.formats.description import (
    KEY,
    describe,
    header_with_unit,
    read_description,
    rows_of,
    signals_of,
)
from deatwin.plant.files.formats.optional import reading, require
from deatwin.plant.files.formats.table import Declared, Table, Timing
from deatwin.plant.files.formats.unpacked import require_plain_hdf5, require_sound_level_5
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.rates import sample_time_in
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.recording import Recording
from deatwin.plant.safe_read import clipped

_HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK = 512  # Number of bytes before the HDF5 signature in a file of version 7.3
_SAMPLE_TIMES = ("ts", "dt", "sample_time")
_SAMPLE_RATES = ("fs", "sample_rate")
_NAMES_UNIT = re.compile(r"(?i:units?)\.(.+)|(.+)(?:_(?i:units?)|(?<=[a-z\d])Units?)")
"""Text that names the unit of the signal of this name: ``units.force``, ``force_unit``, ``forceUnit``."""
_OF_UNIT = {"Input": ("InputData", "u"), "Output": ("OutputData", "y"), "Time": ("Ts", "SamplingInstants")}
"""Fields of the data of the System Identification Toolbox, by those of their units without ``Unit``."""
_TIME = "time_s"
_UNREAD = frozenset(
    {"MATLAB_empty", "MATLAB_object_decode"}
)  # Marks of empty arrays, and of objects such as timetables
_UNUSED = ("cell", "object", "function", "opaque", "sparse", "unknown")  # Classes of variables that are ignored


def read_mat(path: str | Path) -> Table:
    """Read a MATLAB file, or the text that ``save -ascii`` writes."""
    content, name = read_bytes(path), str(path)
    if re.match(rb"\s*[-+]?\d", content) and b"\0" not in content[:_USER_BLOCK]:
        return read_table(path)
    newer = _HDF5 in (content[: len(_HDF5)], content[_USER_BLOCK : _USER_BLOCK + len(_HDF5)])
    with reading(name, "HDF5" if newer else "MATLAB"):
        found = unpacked(of_hdf5 if newer else of_level_5, content, name)
    return _table(name, hashlib.sha256(content).hexdigest(), found)


def write_mat(path: str | Path, recording: Recording) -> None:
    """Write a recording as a MATLAB file of version 5: column vectors in SI units, and its description."""
    from scipy.io import savemat

    signals = signals_of(recording, _identifier, taken=[_TIME, KEY])
    columns = dict(zip((signal.header for signal in signals), rows_of(recording), strict=True))
    with open(path, "wb") as file:
        savemat(
            file,
            {_TIME: recording.timepts, **columns, KEY: describe(recording, signals)},
            oned_as="column",
            long_field_names=True,
            do_compression=True,
        )


def _table(path: str, sha256: str, found: Mapping[str, Any]) -> ArrayTable:
    """Make a table from the vectors of a file, given by name."""
    short = _titled(found)
    arrays = {short[name]: value for name, value in found.items() if isinstance(value, np.ndarray)}
    columns = {name: value.ravel() for name, value in arrays.items() if value.size > 1 and value.size in value.shape}
    lengths = {values.size for values in columns.values()}
    matrices = {name: of_matrix(name, value, lengths) for name, value in arrays.items()}
    for signals in matrices.values():
        columns |= signals
    texts = {short[name]: value for name, value in found.items() if isinstance(value, str)}
    described = texts.pop(KEY, None)
    if described is not None:
        declared = read_description(described, path)
        single = {signal.header for signal in declared.signals} | {_TIME}  # a recording may have one sample
        columns |= {name: arrays[name].ravel() for name in single & set(arrays)}
    else:
        if not columns:
            raise DataError(
                f"{path}: there are no vectors of numbers in it; a recording needs its signals as vectors (tables, timetables and "
                "other objects of MATLAB cannot be read; writetable and writetimetable write them as CSV)"
            )
        named = {name: match for name in found if (match := _NAMES_UNIT.fullmatch(name))}
        units: dict[str, str] = {
            place: found[name]
            for name, match in named.items()
            if isinstance(found[name], str)
            for place in _with_unit(match[1] or match[2], found)
        }
        beside = _beside(found, "units?")
        for name, unit in beside.items():
            fields = {key.rpartition(".")[2]: value for key, value in found.items() if _struct(key) == _struct(name)}
            require_no_scale({**fields, "units": unit}, name, path)
        units = {short.get(name, name): text for name, text in (beside | units).items()}
        for name, signals in matrices.items():
            units |= dict(zip(signals, _units_of_columns(units.get(name, ""), len(signals)), strict=True))
        notes = {name: text for name, text in texts.items() if name not in units and text}
        table = array_table(
            path,
            sha256,
            columns,
            {name: str(text) for name, text in units.items()},
            declared=Declared(timing=_timing(arrays, units, path), provenance=notes),
        )
        paths = {name: short[name] for name in found}
        places = {place: short[name] for name, place in short_names(found).items()} | paths
        rate = sample_time_in([f"{name.rpartition('.')[2]} = {text}" for name, text in notes.items()])
        return replace(table, places=places, rate=rate)
    return array_table(path, sha256, columns, {}, declared=declared)


def _titled(found: Mapping[str, Any]) -> dict[str, str]:
    """Return short names; that of the only vector in a struct is a text ``name`` beside it, if no other is equal."""
    short = short_names(found)
    titles = {
        name: text for name, text in _beside(found, "name|label").items() if found[name].size in found[name].shape
    }
    taken = [*titles.values(), *(name for full, name in short.items() if full not in titles)]
    return short | {name: title for name, title in titles.items() if title.strip() and taken.count(title) == 1}


def _beside(found: Mapping[str, Any], field: str) -> dict[str, str]:
    """Return the texts in a field of this name for the only vector in its struct."""
    structs: dict[str, list[str]] = {}
    for name, value in found.items():
        if isinstance(value, np.ndarray) and value.size > 1:
            structs.setdefault(_struct(name), []).append(name)
    said = {
        _struct(name): text
        for name, text in found.items()
        if isinstance(text, str) and re.fullmatch(rf"(?i).+\.({field})", name)
    }
    return {structs[struct][0]: text for struct, text in said.items() if len(structs.get(struct, ())) == 1}


def _struct(name: str) -> str:
    """Return the name of the struct that holds a field."""
    return name.rpartition(".")[0]


def _with_unit(name: str, found: Mapping[str, Any]) -> list[str]:
    """Return the names of the signals whose unit a text names."""
    struct, _, field = name.rpartition(".")
    fields = [f"{struct}.{other}".lstrip(".") for other in _OF_UNIT.get(field, ())]
    return [name] if name in found else [other for other in fields if other in found] or [name]


def _units_of_columns(said: str, count: int) -> list[str]:
    """Return the units of the signals of a matrix: its one unit, or those of its lines."""
    lines = said.split("\n")
    return lines if len(lines) == count else [" ".join(lines)] * count


def _timing(arrays: Mapping[str, np.ndarray], units: Mapping[str, str], path: str) -> Timing | None:
    """Return the clock that a scalar states; None if it states none."""
    stated = {}
    for name, scalar in arrays.items():
        if scalar.size == 1 and scalar.dtype.kind in "fiu":
            bare, own = split_unit(name)
            unit = UNITS[find_unit(units.get(name, "")) or own]
            number = float(unit.to_si(scalar.ravel().astype(np.float64))[0])
            if bare.lower() in _SAMPLE_TIMES and unit.si in ("", "s"):
                stated[name] = number
            if bare.lower() in _SAMPLE_RATES and unit.si in ("", "Hz") and number > 0.0:
                stated[name] = 1.0 / number
    timings = {name: Timing(sample_time=value) for name, value in stated.items() if 0.0 < value < np.inf}
    for name, timing in timings.items():
        first, value = next(iter(timings.items()))
        if not value.agrees(timing.sample_time):
            raise DataError(
                f"{path}: {clipped(first)} states a sample time of {value.sample_time:g} s, {clipped(name)} one of "
                f"{timing.sample_time:g} s; correct one of them"
            )
    return next(iter(timings.values()), None)


def of_level_5(content: bytes, path: str) -> dict[str, Any]:
    """Return names and values in a file of version 5; fields of structs are named ``struct.field``."""
    from scipy.io import loadmat, whosmat

    require_sound_level_5(content, path)
    listed = whosmat(io.BytesIO(content))
    # Unused variables such as cells are not loaded, so that no memory is allocated for what they declare.
    left = {n for n, shape, kind in listed if kind in _UNUSED or (kind == "struct" and math.prod(shape) > WIDEST)}
    used = [name for name, _, _ in listed if name not in left]
    held = loadmat(io.BytesIO(content), variable_names=used)
    return dict(pair for name, value in held.items() if not name.startswith("__") for pair in _values(name, value))


def _values(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a variable, or the fields of the structs in an array; character arrays become texts."""
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names:
        for k, struct in enumerate(value.ravel(order="F") if value.size <= WIDEST else (), start=1):
            place = f"{name}({k})" if value.size > 1 else name
            for field in value.dtype.names:
                yield from _values(f"{place}.{field}", struct[field])
    elif value.dtype.kind == "U":
        yield name, "\n".join(value.ravel().tolist())
    elif value.dtype.kind in "fiubc":
        yield name, value
    elif value.size == 1 and isinstance(text := value.item(), np.ndarray) and text.dtype.kind == "U":
        yield from _values(name, text)  # a cell with one text


def of_hdf5(content: bytes, path: str) -> dict[str, Any]:
    """Return names and values in a file of version 7.3; fields of structs are named ``struct.field``."""
    h5py = require("h5py", f"{path}: a MATLAB file of version 7.3, or another HDF5 file,")
    values: dict[str, Any] = {}
    with h5py.File(io.BytesIO(content), "r") as file:
        require_plain_hdf5(file, path)
        found: list[tuple[str, Any]] = []
        file.visititems(lambda name, node: found.append((name, node)))
        found = [pair for name, node in found if not name.startswith("#") for pair in _structs(name, node, file)]
        for name, node in (("", file), *found):
            for key, number in numeric(node.attrs).items():
                if sample_time_in([f"{key} = {number}"]):
                    values[f"{name.replace('/', '.')}.{key}".lstrip(".")] = str(number)
            if not isinstance(node, h5py.Dataset) or not _UNREAD.isdisjoint(node.attrs):
                continue
            kind = np.bytes_(node.attrs.get("MATLAB_class", b"")).decode()
            if kind == "char":  # UTF-16 code units, stored by columns
                values[name.replace("/", ".")] = node[()].T.astype("<u2").tobytes().decode("utf-16-le")
            elif node.dtype.names and not kind:
                values |= _fields(name.replace("/", "."), node)
            elif node.dtype.kind in "fiub" and kind not in ("cell", "function_handle"):
                place = name.replace("/", ".")
                values[place] = unscaled(
                    np.asarray(node[()]), node.attrs, place, path
                ).T  # MATLAB stores arrays by columns
                if said := units_of(node.attrs):  # those of several signals each on a line
                    values[f"units.{place}"] = ("\n" if min(node.shape, default=0) > 1 else " ").join(said)
    return values


def _fields(place: str, node: Any) -> dict[str, Any]:
    """Return the fields of numbers in a compound data set, and their units, which one attribute may list."""
    names, said = node.dtype.names, units_of(node.attrs)
    said = re.split(r"\s*[,;]\s*", said[0]) if len(said) == 1 < len(names) else said
    values = {f"{place}.{name}": node[name] for name in names if node.dtype[name].kind in "fiub"}
    return values | {
        f"units.{place}.{name}": unit for name, unit in zip(names, said, strict=False) if len(said) == len(names)
    }


def _structs(name: str, node: Any, file: Any) -> Iterator[tuple[str, Any]]:
    """Yield a node of a file of version 7.3; for a field of an array of structs, which refers to them, its nodes."""
    h5py = require("h5py", name)
    referring = isinstance(node, h5py.Dataset) and node.dtype == h5py.ref_dtype and "MATLAB_class" not in node.attrs
    if not referring or node.size > WIDEST:
        yield name, node
        return
    struct, _, field = name.rpartition("/")
    for k, reference in enumerate(node[()].ravel(), start=1):  # by columns, as MATLAB counts
        if reference:
            yield f"{struct}({k})/{field}", file[reference]


def _identifier(name: str, unit: str) -> str:
    """Return a signal's name and unit as a MATLAB variable name; empty if that is impossible."""
    header = header_with_unit(name, unit)
    return header if re.fullmatch(r"[A-Za-z]\w{0,62}", header, re.ASCII) else ""
