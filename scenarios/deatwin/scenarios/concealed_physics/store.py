"""Results of the cases on the disk: one file each, whole or absent, under one seal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from deatwin.plant.errors import DataError
from deatwin.plant.files import write_text_atomic
from deatwin.scenarios.concealed_physics.seal import Seal

__all__ = ["SCHEMA", "Store"]

SCHEMA = "deatwin/concealed-case/1"
SEAL_FILE = "seal.json"


class Store:
    """The cases of a sealed study.

    Parameters
    ----------
    folder : path
        Of the study; cases go into the folder ``cases`` in it.
    seal : Seal
        Of the study as it is to be run now. It is written if the folder has none.

    Raises
    ------
    DataError
        If the folder was begun under another seal, or holds cases but no seal.
    """

    def __init__(self, folder: Path, seal: Seal) -> None:
        self.seal, self.folder = seal, Path(folder)
        self.cases = self.folder / "cases"
        self.cases.mkdir(parents=True, exist_ok=True)
        path = Path(folder) / SEAL_FILE
        if path.exists():
            seal.require_same(self.sealed(folder), Path(folder))
        elif any(self.cases.glob("*.json")):
            raise DataError(f"{folder} holds cases but no {SEAL_FILE}: what they were run under cannot be known")
        else:
            write_text_atomic(path, json.dumps(seal.to_dict(), indent=1) + "\n")

    @classmethod
    def opened(cls, folder: Path | str) -> Self:
        """The store of a folder, under the seal that it has.

        Parameters
        ----------
        folder : path
            Of a study.

        Returns
        -------
        Store

        Raises
        ------
        DataError
            If it has no seal.
        """
        return cls(Path(folder), cls.sealed(folder))

    @staticmethod
    def sealed(folder: Path | str) -> Seal:
        """The seal of a folder.

        Parameters
        ----------
        folder : path
            Of a study.

        Returns
        -------
        Seal

        Raises
        ------
        DataError
            If it has none.
        """
        path = Path(folder) / SEAL_FILE
        try:
            return Seal.from_dict(json.loads(path.read_text(encoding="utf-8")))
        except OSError:
            raise DataError(f"{path}: no such file; a study is sealed before its first case") from None
        except json.JSONDecodeError as error:
            raise DataError(f"{path}: line {error.lineno}: {error.msg}; it must hold the seal of a study") from None

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Write the result of a case, once.

        Parameters
        ----------
        name : str
            Of the case.
        result : mapping
            Plain data.

        Raises
        ------
        DataError
            If the folder has been sealed anew since.
        """
        if self.sealed(self.folder).hash != self.seal.hash:
            raise DataError(f"{self.folder}: sealed anew since this case was begun; its result is not written")
        content = {"schema": SCHEMA, "seal": self.seal.hash, "name": name, **_finite(dict(result))}
        write_text_atomic(self._path(name), json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")

    def get(self, name: str) -> dict[str, Any]:
        """Read the result of a case.

        Parameters
        ----------
        name : str
            Of the case.

        Returns
        -------
        dict

        Raises
        ------
        DataError
            If there is none, or it was run under another seal.
        """
        path = self._path(name)
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except OSError:
            raise DataError(f"{path}: this case has not been run") from None
        except json.JSONDecodeError as error:
            raise DataError(f"{path}: line {error.lineno}: {error.msg}; it must hold the result of a case") from None
        if found.get("seal") != self.seal.hash:
            raise DataError(f"{path}: this case was run under another seal than {SEAL_FILE} states")
        return found

    def missing(self, names: Sequence[str]) -> list[str]:
        """The cases that have not been run.

        Parameters
        ----------
        names : sequence of str
            All cases.

        Returns
        -------
        list of str
            In the same order.
        """
        return [name for name in names if not self._path(name).exists()]

    def _path(self, name: str) -> Path:
        return self.cases / f"{name}.json"


def _finite(data: Any) -> Any:
    """Plain data without what JSON does not know: what is not finite becomes null."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
