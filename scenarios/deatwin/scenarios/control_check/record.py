"""The trials on the disk: one file each, whole or absent, all of one seed and one version of the code."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from deatwin.plant.errors import DataError
from deatwin.scenarios.control_check.trials import Outcome
from deatwin.studies.sweep.seal import SweepSeal, sources_digest
from deatwin.studies.sweep.store import CaseStore

SCHEMA = "deatwin/control-trial/1"
PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control")
"""Whose code decides an outcome, besides that of the trials themselves."""
OWN = ("rigs.py", "trials.py", "calibration.py")


class _Seal(SweepSeal):
    """Seed and code; each trial bears both."""

    def stamp(self, name: str) -> dict[str, Any]:
        return {"schema": self.schema, **self.parts}


class Trials(CaseStore[SweepSeal]):
    """The trials of a study."""

    def __init__(self, folder: Path, seed: int) -> None:
        super().__init__(folder, _Seal(schema=SCHEMA, parts={"seed": seed, "code": _digest()}), cases="trials")

    def outcomes(self, numbers: Iterable[int]) -> tuple[Outcome, ...]:
        """Read trials."""
        return tuple(self._outcome(name_of(number)) for number in numbers)

    def _outcome(self, name: str) -> Outcome:
        found = self.get(name)
        content = {key: value for key, value in found.items() if key not in self.seal.stamp(name)}
        try:
            return Outcome.from_dict(content)
        except TypeError as error:
            raise DataError(
                f"{self.path(name)}: it must hold a trial ({error}); delete it, and it is run again"
            ) from None


def name_of(number: int) -> str:
    """What a trial is called."""
    return f"{number:03d}"


def _digest() -> str:
    """Of all sources that decide an outcome."""
    return sources_digest(PACKAGES, [Path(__file__).parent / name for name in OWN])
