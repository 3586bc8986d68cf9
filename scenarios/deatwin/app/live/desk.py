"""Contents of the folder that the live view shows, and files that are dropped on its page; no name may lead out of it."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path

from deatwin.plant.errors import DataError, DeatwinError
from deatwin.plant.files.recordings import ENDINGS
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.rigs.rigfile import read_rig

RESULT = "diagnosis.json"
MODEL = "model.json"
WRITTEN = {"figures", "rivals", "next_input.csv"}  # Files of results that are not recordings
DEEPEST = 3
MOST_FILES = 2000
LONGEST_NAME = 100

_FORBIDDEN = re.compile(r'[\x00-\x1f\x7f<>:"|?*]')
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def require_folder(path: Path) -> Path:
    """Return the folder to be shown, after a check."""
    if path.is_dir():
        return path.resolve()
    if path.exists():
        raise DataError(f"{path}: this is a file; give the folder that contains it")
    raise DataError(f"{path}: there is no such folder")


def inside(root: Path, name: str) -> Path:
    """Return the path of a name inside a folder, after a check."""
    home = root.resolve()
    try:
        path = (home / name).resolve()
    except (OSError, RuntimeError, ValueError):  # for example, a loop of links or a null character
        raise DataError(f"{name!r}: this cannot be the name of a file in {root}") from None
    if not path.is_relative_to(home):
        raise DataError(f"{name}: this path lies outside of {root}; only what is in this folder can be used")
    return path


def safe_name(name: str) -> str:
    """Turn a name that a browser sent into the name of a file in one folder."""
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    kept = _FORBIDDEN.sub("_", last).strip().lstrip(".- ").rstrip(". ")
    if not kept or not kept.isprintable():
        raise DataError(
            f"{name[:LONGEST_NAME]!r}: cannot be the name of a file; use letters, digits, spaces, dots, dashes and underscores"
        )
    if len(kept.encode()) > LONGEST_NAME:
        raise DataError(f"{kept[:20]}…: the name is too long; use at most {LONGEST_NAME} letters")
    if _RESERVED.fullmatch(kept):
        raise DataError(f"{kept}: Windows reserves this name; choose another")
    return kept


@dataclass(frozen=True, kw_only=True)
class Desk:
    """Names of the files in a folder, relative to it, with ``/`` between folders, sorted."""

    recordings: tuple[str, ...]  # Files in a recording's format, except those that a diagnosis wrote
    rigs: tuple[str, ...]  # Rig files and calibrated models
    results: tuple[str, ...]  # Folders that hold a diagnosis; ``.`` is the folder itself
    whole: bool = True  # False if the folder contains more than is listed

    @classmethod
    def look(cls, root: Path) -> Desk:
        """List a folder and the folders below it, without hidden ones and links that lead out of it."""
        home = root.resolve()
        files = list(islice(_files(home, home, DEEPEST), MOST_FILES + 1))
        names: dict[str, list[str]] = {"recordings": [], "rigs": [], "results": []}
        for path in files[:MOST_FILES]:
            name = path.relative_to(home)
            if path.name == RESULT:
                names["results"].append(name.parent.as_posix())
            elif path.suffix.lower() == ".toml" or path.name == MODEL:
                names["rigs"].append(name.as_posix())
            elif path.suffix.lower() in ENDINGS and WRITTEN.isdisjoint(name.parts):
                names["recordings"].append(name.as_posix())
        found = {kind: tuple(sorted(listed)) for kind, listed in names.items()}
        return cls(**found, whole=len(files) <= MOST_FILES)


def free_name(root: Path) -> str:
    """Return an unused name for the next folder of results."""
    return next(name for n in count(1) if not os.path.lexists(root / (name := f"result-{n}")))


def _files(home: Path, folder: Path, deeper: int) -> Iterator[Path]:
    """Return the regular files in the folder, sorted by name."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        path = Path(entry.path)
        if entry.name.startswith(".") or not entry.name.isprintable():
            continue
        try:
            if entry.is_symlink() and not path.resolve().is_relative_to(home):
                continue
            if entry.is_file():
                yield path
            elif deeper and entry.is_dir(follow_symlinks=False):
                yield from _files(home, path, deeper - 1)
        except (OSError, RuntimeError):
            continue


MEGABYTE = 1_000_000
UPLOADS = (*ENDINGS, ".toml")


def keep_upload(root: Path, name: str, content: bytes, *, most_bytes: int, asked: ReadOptions = NO_OPTIONS) -> str:
    """Save a valid rig file, or a recording that can be read with the requested options or with others."""
    kept = safe_name(name)
    if len(content) > most_bytes:
        raise DataError(
            f"{kept}: {len(content) / MEGABYTE:.1f} MB; at most {most_bytes / MEGABYTE:g} MB are accepted (--upload-limit)"
        )
    suffix = Path(kept).suffix.lower()
    if suffix not in UPLOADS:
        raise DataError(f'{kept}: files "{suffix}" are not accepted; drop one of {", ".join(UPLOADS)}')
    if os.path.lexists(root / kept):
        raise DataError(f"{kept}: the folder has a file of this name; rename yours")

    def read(path: Path) -> None:
        from deatwin.plant.files.understood import understand

        if suffix == ".toml":
            read_rig(path)
            return
        found = understand(path, asked)
        if not found.recordings and not found.placeholders:
            raise DataError(found.refused)

    _keep(root, kept, content, read)
    return kept


def _keep(root: Path, name: str, content: bytes, read: Callable[[Path], None]) -> None:
    """Write to a temporary name, read, and rename, so that the folder never shows an incomplete or unreadable file."""
    beside = Path(tempfile.mkdtemp(prefix=".upload-", dir=root))
    try:
        (beside / name).write_bytes(content)
        try:
            read(beside / name)
        except DeatwinError as error:  # worded as on the command line, run in the folder
            raise type(error)(str(error).replace(f"{beside}{os.sep}", "")) from None
        with open(root / name, "xb"):  # reserves the name, so that a file that appeared meanwhile is not replaced
            pass
        os.replace(beside / name, root / name)
    except FileExistsError:
        raise DataError(f"{name}: the folder has a file of this name; rename yours") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
