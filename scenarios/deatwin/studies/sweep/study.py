"""Run a user's own study: cases, a work function and a folder."""

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
DIGITS = 16  # Length of a case's name: of ten million cases two share one with probability 3e-6, which is an error


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """Return every combination of values.

    Parameters
    ----------
    **axes : iterable
        Values of each name.

    Returns
    -------
    list of dict
        Combinations; the last axis varies fastest.

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
    """Run a function on every case, or resume an earlier run.

    Each result is written to the folder as soon as it is known. If `work` raises an error, this error is the result of
    the case; see `Study.failures`. Cases are identified by their content, so a study can be extended. A study is
    refused if its function, seed or settings, or the version or code of deatwin, have changed since its first case.

    Parameters
    ----------
    cases : iterable of mapping
        Mappings from names to numbers, texts or None, for example from `grid`.
    work : callable
        Function ``work(case, rng)`` that returns a mapping of names to numbers, texts and arrays; ``rng`` is a
        `numpy.random.Generator` that depends on seed and case alone. The function must be defined in a module or in the
        script: a partial or a closure is refused, because changes of the values that it holds could not be noticed.
    folder : path
        Folder of the study. On a cluster all workers must see it under this path.
    seed : int
        Seed of all random numbers.
    settings : mapping, optional
        Further plain data that must not change, such as the hash of a file that `work` reads.
    jobs : int, optional
        Number of worker processes; by default that of ``joblib.parallel_config``, or 1.
    tell : callable, optional
        Callback that receives the completed share and a text; by default a progress bar on a terminal.

    Raises
    ------
    DataError
        If the folder holds a study with another function, seed, settings, version or code, or cases or function are not
        as described.
    KeyboardInterrupt
        If the user interrupts; finished cases are kept, and the text says how many there are.
    """
    from deatwin.studies.provenance import versions
    from deatwin.studies.voice import Voice

    known = _named(cases)
    parts = {"seed": seed, "settings": dict(settings or {}), **_function(work)}
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
    for number, case in enumerate(cases):
        plain = {str(key): _scalar(number, str(key), value) for key, value in case.items()}
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
