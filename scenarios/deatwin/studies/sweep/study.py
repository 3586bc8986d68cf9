"""Run a user's own study: cases, a work function and a folder."""

from __future__ import annotations

import inspect
import itertools
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.arguments import file_name, instance, taking
from deatwin.plant.arrays import require_seed
from deatwin.plant.errors import DataError
from deatwin.plant.files.replacing import replacing
from deatwin.plant.interrupts import obeying
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal, digest, sources_digest
from deatwin.studies.sweep.store import CaseStore, read_seal
from deatwin.studies.voice import Voice

if TYPE_CHECKING:
    import xarray


Case = Mapping[str, Any]
Work = Callable[[Case, np.random.Generator], Mapping[str, Any]]
PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control")
VERSIONS = ("deatwin", "numpy", "scipy", "casadi")
DIGITS = 16  # Length of a case's name: of ten million cases two share one with probability 3e-6, which is an error


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """Return all combinations of the values of several variables, for example as the cases of `run_study`.

    Parameters
    ----------
    **axes : iterable
        Values of each variable, by the name of the variable.

    Returns
    -------
    list of dict
        One mapping of names to values for each combination; the last variable varies fastest.

    Raises
    ------
    DataError
        If the values of a variable are a single number or text instead of a list.

    Examples
    --------
    >>> grid(mass=[1.0, 2.0], ball=["bonded"])
    [{'mass': 1.0, 'ball': 'bonded'}, {'mass': 2.0, 'ball': 'bonded'}]
    """
    for name, values in axes.items():
        if isinstance(values, str) or not np.iterable(values):
            raise DataError(f"{name} = {values!r}; give a list of values, as {name}=[...]")
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


@taking(folder=file_name, seed=lambda seed, _: require_seed(seed), settings=instance(Mapping, error=DataError))
def run_study(
    cases: Iterable[Case],
    work: Work,
    folder: Path | str,
    *,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    tell: Callable[[float, str], None] | None = None,
) -> Study:
    """Run a function on every case, or resume an earlier run.

    Each result is written to the folder as soon as the case is finished. If `work` raises an error for a case, the
    error message is the result of the case; see `Study.failures`. To extend a study, run it again with additional
    cases: finished cases are not repeated. The function, the seed, the settings, and the version and the code of
    deatwin must not change between the runs of a study.

    Parameters
    ----------
    cases : iterable of mapping
        Cases, each a mapping of names to numbers, texts or None, for example from `grid`.
    work : callable
        Function ``work(case, rng)`` that returns a mapping of names to numbers, texts and arrays. ``rng`` is a
        `numpy.random.Generator` that depends only on the seed and the case. The function must be defined in a module or
        in the script. A partial or a closure is an error, because it contains values that could change unnoticed.
    folder : path
        Folder of the study. On a cluster, all workers must have access to it under this path.
    seed : int
        Seed of all random numbers.
    settings : mapping, optional
        Other plain data that must not change between the runs, such as the hash of a file that `work` reads.
    jobs : int, optional
        Number of worker processes; by default the number set with ``joblib.parallel_config``, otherwise 1.
    tell : callable, optional
        Function that is called with the completed fraction of the study and a text; by default, a progress bar is shown
        on a terminal.

    Raises
    ------
    DataError
        If `folder` is not a path or `settings` not a mapping; if the folder contains a study with another function,
        seed, settings, version or code; if `work` is not a function as described; or if two cases are equal or a case
        contains other values than those described.
    ModelError
        If `seed` is not an integer of at least 0.
    KeyboardInterrupt
        If the user interrupts the run. Finished cases are kept, and the error message states their number.
    """
    from deatwin.studies.provenance import versions

    known = _named(cases)
    parts = {"seed": int(seed), "settings": dict(settings or {}), **_function(work)}
    parts |= {"versions": versions(VERSIONS), "deatwin_sources": sources_digest(PACKAGES)}
    seal = SweepSeal(schema=CASE_SCHEMA, parts=parts)
    store = CaseStore(folder, seal, expected=len(known))
    with Voice().progress("study") as bar:
        run_sweep(_Recorded(work=work, seed=seed), known, store, jobs=jobs, tell=tell or bar)
    return Study(store=store, names=tuple(known))


@dataclass(frozen=True, kw_only=True)
class _Recorded:
    """A work function whose exceptions become results; called in the worker."""

    work: Work
    seed: int

    def __call__(self, case: Case) -> dict[str, Any]:
        rng = np.random.default_rng((self.seed, int(_name(case), 16)))
        try:
            with obeying():
                found = self.work(dict(case), rng)
            return {"case": case, "result": {name: _plain(name, value) for name, value in found.items()}}
        except Exception as error:  # whatever it is, the other cases continue
            return {"case": case, "error": f"{type(error).__name__}: {' '.join(str(error).split())}"}


def _named(cases: Iterable[Case]) -> dict[str, dict[str, Any]]:
    """Return cases by the SHA-256 of their content, which is plain data."""
    known: dict[str, dict[str, Any]] = {}
    if isinstance(cases, Mapping | str) or not isinstance(cases, Iterable):
        raise DataError(f"cases = {cases!r}; give a sequence of cases, as grid(stiffness=[0.9, 1.1]) makes one")
    for number, case in enumerate(cases):
        if not isinstance(case, Mapping) or not all(isinstance(key, str) for key in case):
            raise DataError(
                f'case {number} is {case!r}; it must be a mapping of names to values, as {{"stiffness": 0.9}}'
            )
        plain = {key: _scalar(number, key, value) for key, value in case.items()}
        name = _name(plain)
        if name in known:
            raise DataError(f"case {number} occurs twice: {plain}; distinguish the two, for instance by a number")
        known[name] = plain
    return known


def _name(case: Case) -> str:
    return digest(dict(case))[:DIGITS]


def _scalar(number: int, key: str, value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    if value is None or isinstance(value, (bool, int, str)) or (isinstance(value, float) and np.isfinite(value)):
        return value
    raise DataError(f"case {number}: {key} is {value!r}; it must be a finite number, a text, or None")


def _plain(name: str, value: Any) -> Any:
    """Convert a value of a result for JSON."""
    array = np.asarray(value) if isinstance(value, (np.ndarray, np.generic, Sequence)) else None
    if array is not None and array.dtype.kind in "biuf":
        return array.tolist()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise DataError(f"the result {name} is a {type(value).__name__}; it must be a real number, an array, or a text")


def _function(work: Work) -> dict[str, str]:
    """Return name of the function and SHA-256 of its file."""
    if not inspect.isfunction(work) or work.__closure__ or work.__name__ == "<lambda>":
        raise DataError(
            "the work must be a function of a module, because values inside a partial, a closure or an object could "
            "change unnoticed; pass them in the cases or in the module"
        )
    module = sys.modules.get(work.__module__)
    path = getattr(module, "__file__", None)
    try:
        text = Path(path).read_text(encoding="utf-8") if path else inspect.getsource(work)
    except OSError:
        raise DataError(f"the source of {work.__qualname__} cannot be read, so it cannot be sealed") from None
    return {"work": work.__qualname__, "work_source": digest(text)}


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
