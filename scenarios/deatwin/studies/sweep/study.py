"""A study of the user's own: cases, a work function, a folder."""

from __future__ import annotations

import inspect
import itertools
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.interrupts import obeying
from deatwin.studies.sweep.results import CASE_SCHEMA, Study
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal, digest, sources_digest
from deatwin.studies.sweep.store import CaseStore

Case = Mapping[str, Any]
Work = Callable[[Case, np.random.Generator], Mapping[str, Any]]
PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control")
VERSIONS = ("deatwin", "numpy", "scipy", "casadi")
DIGITS = 16
"""Length of a case's name: two of ten million cases share one with a chance of 3e-6, which is an error."""


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """Every combination of values.

    Parameters
    ----------
    **axes : iterable
        Values by name.

    Returns
    -------
    list of dict
        The last axis runs fastest.

    Examples
    --------
    >>> grid(mass=[1.0, 2.0], ball=["bonded"])
    [{'mass': 1.0, 'ball': 'bonded'}, {'mass': 2.0, 'ball': 'bonded'}]
    """
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


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
    """Run a function on every case, or go on where a former run stopped.

    Each result is written into the folder as soon as it is there. An error that `work` raises is the result of its
    case: see `Study.failures`. A case is known by its content, so a study may be extended by further cases; it
    is refused if its function, seed, settings, or the version or code of deatwin have changed since its first case.

    Parameters
    ----------
    cases : iterable of mapping
        Each of names to numbers, texts, or None, such as `grid` makes.
    work : callable
        Takes a case and a `numpy.random.Generator` that depends on seed and case alone; returns numbers, texts,
        and arrays by name. A function of a module or of the script; it may not hold values of its own, as a partial
        or a closure does, since these could not be sealed.
    folder : path
        Of the study. On a cluster all workers must see it under this path.
    seed : int
        Of all that is random.
    settings : mapping, optional
        Further plain data that must not change, such as the hash of a file that `work` reads.
    jobs : int, optional
        Worker processes; by default what ``joblib.parallel_config`` says, or 1.
    tell : callable, optional
        Takes the share that is done and a text; by default a bar with the time left, where stderr is a terminal.

    Returns
    -------
    Study

    Raises
    ------
    DataError
        If the folder was begun under another seal, or cases or function are not as described.
    KeyboardInterrupt
        With a line that says what is through; what is stays.
    """
    from deatwin.studies.voice import Voice

    known = _named(cases)
    seal = SweepSeal(
        schema=CASE_SCHEMA, parts={"seed": seed, "settings": dict(settings or {}), **_function(work), **_environment()}
    )
    store = CaseStore(folder, seal, expected=len(known))
    with Voice().progress("study") as bar:
        run_sweep(_Recorded(work=work, seed=seed), known, store, jobs=jobs, tell=tell or bar)
    return Study(store=store, names=tuple(known))


@dataclass(frozen=True, kw_only=True)
class _Recorded:
    """Work whose error is a result too; called in the worker."""

    work: Work
    seed: int

    def __call__(self, case: Case) -> dict[str, Any]:
        rng = np.random.default_rng((self.seed, int(_name(case), 16)))
        try:
            with obeying():
                found = self.work(dict(case), rng)
            return {"case": case, "result": {name: _plain(name, value) for name, value in found.items()}}
        except Exception as error:  # whatever it is, the other cases go on
            return {"case": case, "error": f"{type(error).__name__}: {' '.join(str(error).split())}"}


def _named(cases: Iterable[Case]) -> dict[str, dict[str, Any]]:
    """Cases by the SHA-256 of their content, which is plain data."""
    known: dict[str, dict[str, Any]] = {}
    for number, case in enumerate(cases):
        plain = {str(key): _scalar(number, str(key), value) for key, value in case.items()}
        name = _name(plain)
        if name in known:
            raise DataError(f"case {number} is there twice: {plain}; tell them apart, for instance by a number")
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
    """A value of a result as JSON has it."""
    array = np.asarray(value) if isinstance(value, (np.ndarray, np.generic, Sequence)) else None
    if array is not None and array.dtype.kind in "biuf":
        return array.tolist()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise DataError(f"the result {name} is a {type(value).__name__}; it must be a real number, an array, or a text")


def _function(work: Work) -> dict[str, str]:
    """Name of the function and SHA-256 of the file that it stands in."""
    if not inspect.isfunction(work) or work.__closure__ or work.__name__ == "<lambda>":
        raise DataError(
            "the work must be a function of a module: values inside a partial, a closure or an object could change "
            "unseen; hand them over in the cases or in the module"
        )
    module = sys.modules.get(work.__module__)
    path = getattr(module, "__file__", None)
    try:
        text = Path(path).read_text(encoding="utf-8") if path else inspect.getsource(work)
    except OSError:
        raise DataError(f"the source of {work.__qualname__} cannot be read, so it cannot be sealed") from None
    return {"work": work.__qualname__, "work_source": digest(text)}


def _environment() -> dict[str, Any]:
    from deatwin.studies.provenance import versions

    return {"versions": versions(VERSIONS), "deatwin_sources": sources_digest(PACKAGES)}
