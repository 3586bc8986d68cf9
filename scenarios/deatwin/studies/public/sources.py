"""Find the public recordings: in the user's folder, or downloaded by the package nonlinear_benchmarks."""

from __future__ import annotations

import importlib
import io
import os
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType

from deatwin.plant.errors import DataError
from deatwin.studies.provenance import hashes
from deatwin.studies.report.story import Table
from deatwin.studies.stories import DATA_VARIABLE

PACKAGE = "nonlinear_benchmarks"


@dataclass(frozen=True, kw_only=True)
class Source:
    """Publisher of a set of recordings."""

    title: str  # Name of the set
    published: str
    loader: str = ""


_FILE = tomllib.loads(files(__package__).joinpath("sources.toml").read_text(encoding="utf-8"))
SOURCES: Mapping[str, Source] = MappingProxyType({name: Source(**known) for name, known in _FILE.items()})
"""Sources by the name of the set's folder, as in ``sources.toml``."""


def data_folder(given: Path | None, name: str) -> Path:
    """Return the folder of public recordings: the given one, that of the environment variable, or a download."""
    root = given or os.environ.get(DATA_VARIABLE)
    if not root:
        return downloaded(name)
    folder = Path(root) / name
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; the recordings of {name} must be in it")
    return folder


def downloaded(name: str) -> Path:
    """Return the folder to which nonlinear_benchmarks downloads a set, once."""
    wanted = f"the scenario needs the recordings {name}: give their folder with --data or {DATA_VARIABLE}"
    loader = SOURCES[name].loader
    if not loader:
        raise DataError(wanted)
    try:
        load = getattr(importlib.import_module(PACKAGE), loader)
    except ModuleNotFoundError:
        raise DataError(f"{wanted}, or pip install {PACKAGE}, which downloads them") from None
    try:
        with redirect_stdout(io.StringIO()):  # the package prints messages, and stdout may be reserved for results
            files = load(data_file_locations=True)
    except Exception as error:  # of the network, the archive or the package, which passes on all of them
        raise DataError(
            f"{PACKAGE} could not download the recordings {name} ({error}); give their folder with --data or "
            f"{DATA_VARIABLE}"
        ) from error
    return Path(files if isinstance(files, str | os.PathLike) else files[0]).parent


def origins(given: Path | None, files: Mapping[str, Iterable[Path]]) -> Table:
    """Describe publishers, origins and hashes of a page's recordings."""
    rows = [
        [SOURCES[name].title, SOURCES[name].published, _way(given), Path(one["file"]).name, one["sha256"]]
        for name, read in files.items()
        for one in hashes(read)
    ]
    columns = ["recordings", "published", "read from", "file", "SHA-256"]
    return Table(title="Where the recordings come from", columns=columns, rows=rows)


def _way(given: Path | None) -> str:
    if given:
        return "the folder given by --data"
    if os.environ.get(DATA_VARIABLE):
        return f"the folder given by {DATA_VARIABLE}"
    try:
        return f"the download of {PACKAGE} {version(PACKAGE)}"
    except PackageNotFoundError:
        return f"the download of {PACKAGE}"
