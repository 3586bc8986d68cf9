"""The trials on the disk: one file each, whole or absent, all of one version of the code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from deatwin.plant.errors import DataError
from deatwin.plant.files import write_text_atomic
from deatwin.scenarios.control_check.trials import Outcome

__all__ = ["Trials"]

SCHEMA = "deatwin/control-trial/1"
PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control")
"""Whose code decides an outcome, besides that of the trials themselves."""
OWN = ("rigs.py", "trials.py", "calibration.py")


class Trials:
    """The trials of a study.

    Parameters
    ----------
    folder : path
        Of the study; trials go into the folder ``trials`` in it.
    seed : int
        Of the study.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.cases, self.seed, self.code = Path(folder) / "trials", seed, _digest()
        self.cases.mkdir(parents=True, exist_ok=True)

    def put(self, outcome: Outcome) -> None:
        """Write a trial.

        Parameters
        ----------
        outcome : Outcome
            Its result.
        """
        content = {"schema": SCHEMA, "seed": self.seed, "code": self.code, **outcome.to_dict()}
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        write_text_atomic(self._path(outcome.number), text)

    def missing(self, count: int) -> list[int]:
        """The trials that have not been run.

        Parameters
        ----------
        count : int
            Of all.

        Returns
        -------
        list of int
        """
        return [number for number in range(count) if not self._path(number).exists()]

    def get(self, numbers: Sequence[int]) -> tuple[Outcome, ...]:
        """Read trials.

        Parameters
        ----------
        numbers : sequence of int
            Their numbers.

        Returns
        -------
        tuple of Outcome

        Raises
        ------
        DataError
            If one is absent, malformed, or was run with another seed or other code.
        """
        return tuple(self._one(self._path(number)) for number in numbers)

    def _one(self, path: Path) -> Outcome:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            kind = tuple(content.pop(name) for name in ("schema", "seed", "code"))
            if kind == (SCHEMA, self.seed, self.code):  # fields of other code may have other names
                return Outcome.from_dict(content)
        except OSError:
            raise DataError(f"{path}: this trial has not been run") from None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{path}: it must hold a trial ({error}); delete it, and it is run again") from None
        raise DataError(
            f"{path}: this trial was run with another seed or other code; trials of two kinds are not mixed: choose "
            "another folder"
        )

    def _path(self, number: int) -> Path:
        return self.cases / f"{number:03d}.json"


def _digest() -> str:
    """Of all sources that decide an outcome."""
    whole = hashlib.sha256()
    for package in PACKAGES:
        for root in import_module(package).__path__:
            for path in sorted(Path(root).rglob("*.py")):
                whole.update(f"{package}/{path.relative_to(root).as_posix()}".encode() + path.read_bytes())
    for name in OWN:
        whole.update(name.encode() + (Path(__file__).parent / name).read_bytes())
    return whole.hexdigest()
