"""NetCDF files, by xarray: version 4 through h5netcdf, version 3 through SciPy.

The variables along one dimension, of all groups, are the columns, as are the rows of one with a few trials,
``u(1,:)``; an attribute such as ``units`` names the unit. The clock starts at the date of a coordinate that counts
``seconds since`` it (https://cfconventions.org, section 4.4).
"""

import hashlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.files.csvtable import read_bytes
from deatwin.plant.files.formats.apart import unpacked
from deatwin.plant.files.formats.arrays import (
    WIDEST,
    ArrayTable,
    array_table,
    of_matrix,
    short_names,
    units_of,
    unscaled,
)
from deatwin.plant.files.formats.description import KEY, read_description
from deatwin.plant.files.formats.optional import reading, require
from deatwin.plant.files.formats.table import Declared
from deatwin.plant.files.formats.unpacked import Metered, require_plain_hdf5
from deatwin.plant.recording import Recording

_ENGINES = {b"CDF": "scipy", b"\x89HD": "h5netcdf"}


def read_netcdf(path: str | Path) -> ArrayTable:
    """Read a NetCDF file."""
    content, name = read_bytes(path), str(path)
    if content[:3] not in _ENGINES:
        raise DataError(f"{name}: not a NetCDF file")
    with reading(name, "NetCDF"):
        found, attributes = unpacked(variables_of, content, name)
    columns = {header: values for header, (values, _) in found.items()}
    units = {header: re.sub(r"(?i)\s+since .+", "", unit) for header, (_, unit) in found.items()}
    described = attributes.pop(KEY, None)
    return array_table(
        name,
        hashlib.sha256(content).hexdigest(),
        columns,
        units,
        declared=read_description(described, name) if described else Declared(provenance=attributes),
    )


def variables_of(content: bytes, path: str) -> tuple[dict[str, tuple[np.ndarray, str]], dict[str, str]]:
    """Return the variables along one dimension with their units, and the texts that are attributes of the file."""
    xarray, engine = _xarray(f"{path}: a NetCDF file"), _ENGINES[content[:3]]
    options: dict[str, Any] = {"engine": engine, "decode_times": False, "mask_and_scale": False}
    groups = [""]
    if engine == "h5netcdf":
        options["phony_dims"] = "access"  # HDF5 files of other programs may have no named dimensions
        h5py = require("h5py", path)
        with h5py.File(io.BytesIO(content), "r") as file:
            require_plain_hdf5(file, path)
            file.visititems(lambda name, node: groups.append(name) if isinstance(node, h5py.Group) else None)
    found: dict[str, tuple[np.ndarray, str]] = {}
    attributes: dict[str, str] = {}
    for group in groups:
        with xarray.open_dataset(Metered(content, path), group=group or None, **options) as dataset:
            for key, variable in dataset.variables.items():
                wide = variable.ndim == 2 and 1 < min(variable.shape) <= WIDEST
                if wide or (variable.ndim and sum(size > 1 for size in variable.shape) <= 1):
                    name = ".".join([*group.split("/"), str(key)]).lstrip(".")
                    values = unscaled(np.array(variable.values), variable.attrs, name, path)
                    found[name] = values if wide else values.ravel(), " ".join(units_of(variable.attrs))
            attributes |= {str(key): value for key, value in dataset.attrs.items() if isinstance(value, str)}
    short = short_names(found) if len(groups) > 1 else {name: name for name in found}
    lengths = {values.size for values, _ in found.values() if values.ndim == 1}
    columns: dict[str, tuple[np.ndarray, str]] = {}
    for name, (values, unit) in found.items():
        signals = {short[name]: values} if values.ndim == 1 else of_matrix(short[name], values, lengths)
        columns |= {header: (signal, unit) for header, signal in signals.items()}
    return columns, attributes


def write_netcdf(path: str | Path, recording: Recording) -> None:
    """Write a recording as a NetCDF file of version 4, in the form of `Recording.to_xarray`."""
    _xarray("a NetCDF file")
    dataset = recording.to_xarray()
    plain = {name: {"_FillValue": None} for name in dataset.variables}
    dataset.to_netcdf(path, engine="h5netcdf", encoding=plain)


def _xarray(purpose: str) -> Any:
    """Import xarray and the packages for files of version 4."""
    return [require(package, purpose) for package in ("h5py", "h5netcdf", "xarray")][-1]
