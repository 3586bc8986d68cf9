"""Read the results of a study one by one, or as one table of arrays."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.arguments import file_name, taking
from deatwin.plant.errors import DataError
from deatwin.plant.files.replacing import replacing
from deatwin.studies.sweep.store import CaseStore, read_seal

if TYPE_CHECKING:
    import xarray


CASE_SCHEMA = "deatwin/study-case/1"
DATASET_SCHEMA = "deatwin/study/1"
ERROR = "error"


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Results of the finished cases of a study.

    Parameters
    ----------
    store : CaseStore
        Store that holds the results.
    names : tuple of str
        Names of the cases, in the order in which the results are returned.
    """

    store: CaseStore
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        """Yield each case with its ``result``, or with its ``error``."""
        return map(self.store.get, self.names)

    @property
    def failures(self) -> dict[str, str]:
        """Error messages of the cases that ended in an error, by the name of the case."""
        return {found["name"]: found[ERROR] for found in self if ERROR in found}

    def discard_failures(self) -> None:
        """Remove the cases that ended in an error, so that the next run repeats them."""
        self.store.discard(self.failures)

    def to_xarray(self) -> xarray.Dataset:
        """Return all results as a dataset with the dimension ``case``; this needs xarray (the extra ``files``).

        The values that define a case are coordinates. For a case that ended in an error, numbers are NaN, texts are
        empty, and the variable ``error`` contains the message.

        Raises
        ------
        DataError
            If xarray is not installed, if a result has different shapes or types in different cases, or if a result has
            the name of a coordinate or of the variable ``error``.
        """
        try:
            import xarray
        except ImportError:
            raise DataError('results as an array need xarray: pip install "xarray>=2024.6"') from None
        found = list(self)
        results = [each.get("result", {}) for each in found]
        coords = {
            key: ("case", _column(key, [each["case"].get(key) for each in found]))
            for key in _keys(each["case"] for each in found)
        }
        variables: dict[str, Any] = {}
        for key in _keys(results):
            column = _column(key, [result.get(key) for result in results])
            variables[key] = (("case", *(f"{key}_{axis}" for axis in range(column.ndim - 1))), column)
        messages = _column(ERROR, [each.get(ERROR, "") for each in found])
        attributes = {"schema": DATASET_SCHEMA, "seal": self.store.seal.hash}
        attributes["sealed"] = json.dumps(dict(self.store.seal.parts), ensure_ascii=False)
        if ERROR in variables or (both := set(coords) & set(variables)):
            name = ERROR if ERROR in variables else min(both)
            raise DataError(f"a result is called {name}, but this name is already used: rename it in the work function")
        return xarray.Dataset(
            {**variables, ERROR: ("case", messages)}, coords={"case": list(self.names), **coords}, attrs=attributes
        )

    def to_netcdf(self, path: Path | str) -> None:
        """Write the dataset of `to_xarray` to one NetCDF file, completely or not at all.

        Parameters
        ----------
        path : path
            File to write; this needs h5netcdf (the extra ``files``).

        Raises
        ------
        DataError
            Same as for `to_xarray`, or if the file cannot be written.
        """
        with replacing(path) as half:
            self.to_xarray().to_netcdf(half, engine="h5netcdf")


@taking(folder=file_name)
def open_study(folder: Path | str) -> Study:
    """Open a study on disk, with all finished cases, sorted by name.

    Parameters
    ----------
    folder : path
        Folder of the study, as given to `run_study`.

    Raises
    ------
    DataError
        If `folder` is not a path, or the folder does not contain a study.
    """
    store = CaseStore(folder, read_seal(folder))
    return Study(store=store, names=tuple(sorted(store.names())))


def _keys(rows: Any) -> list[str]:
    """Return all keys in the order of their first occurrence."""
    return list(dict.fromkeys(key for row in rows for key in row))


def _column(key: str, values: list[Any]) -> np.ndarray[Any, Any]:
    """Return one value per case; NaN or an empty text if there is none."""
    there = [value for value in values if value is not None]
    if any(isinstance(value, str) for value in there):
        if not all(isinstance(value, str) for value in there):
            raise DataError(f"{key} is a text in some cases and a number in others")
        return np.array(["" if value is None else value for value in values], dtype=object)
    if there and len(there) == len(values) and not isinstance(there[0], list):
        return np.array(values)
    arrays = [np.asarray(value, dtype=float) for value in there]  # null inside an array is NaN
    shapes = sorted({array.shape for array in arrays})
    if len(shapes) > 1:
        raise DataError(f"{key} has arrays of several shapes, {shapes[0]} and {shapes[1]}: bring them to one")
    whole = np.full((len(values), *(shapes[0] if shapes else ())), np.nan)
    for number, value in enumerate(values):
        if value is not None:
            whole[number] = np.asarray(value, dtype=float)
    return whole
