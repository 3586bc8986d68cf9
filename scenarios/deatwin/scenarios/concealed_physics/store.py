"""Results of the cases on the disk: one file each, whole or absent, under the seal of the study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from deatwin.scenarios.concealed_physics.seal import Seal
from deatwin.studies.sweep.store import CaseStore, read_seal


class Store(CaseStore[Seal]):
    """The cases of a sealed study."""

    def __init__(self, folder: Path | str, seal: Seal) -> None:
        super().__init__(folder, seal)

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Write the result of a case; one that is there already is left as it is."""
        super().put(name, _finite(dict(result)))

    @classmethod
    def opened(cls, folder: Path | str) -> Self:
        """The store of a folder, under the seal that it has."""
        return cls(folder, read_seal(Seal, folder))


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
