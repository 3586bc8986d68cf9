"""Save files that are dropped on the page under a safe name, or refuse them in one line."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from deatwin.app.live.desk import safe_name
from deatwin.plant.errors import DataError, DeatwinError
from deatwin.plant.files.recordings import ENDINGS
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions

MEGABYTE = 1_000_000
UPLOADS = (*ENDINGS, ".toml")


def keep_upload(
    root: Path,
    name: str,
    content: bytes,
    *,
    most_bytes: int,
    asked: ReadOptions = NO_OPTIONS,
) -> str:
    """Save a valid rig file, or a recording that can be read with the requested options or with others."""
    kept = safe_name(name)
    if len(content) > most_bytes:
        raise DataError(
            f"{kept}: {len(content) / MEGABYTE:.1f} MB; at most {most_bytes / MEGABYTE:g} MB are taken (--upload-limit)"
        )
    suffix = Path(kept).suffix.lower()
    if suffix not in UPLOADS:
        raise DataError(f'{kept}: files "{suffix}" are not taken; drop one of {", ".join(UPLOADS)}')
    if os.path.lexists(root / kept):
        raise DataError(f"{kept}: the folder has a file of this name; rename yours")

    def read(path: Path) -> None:
        from deatwin.plant.files.understood import understand
        from deatwin.plant.rigs.rigfile import read_rig

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
