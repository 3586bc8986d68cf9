"""``run.json``: everything that may differ between runs with equal results."""

from __future__ import annotations

import hashlib
import json
import platform
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from deatwin.plant.files.formats.xlsx import split_sheet
from deatwin.studies.folder import ResultFolder

SCHEMA = "deatwin/run/1"
PACKAGES = ("deatwin", "numpy", "scipy", "casadi", "scikit-learn", "pysindy", "control", "joblib", "matplotlib")


def versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of installed packages and of Python."""
    found = {"python": platform.python_version()}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def hashes(files: Iterable[str | Path]) -> list[dict[str, str]]:
    """Return names and SHA-256 of a run's input files."""
    existing = [path for file in files if (path := Path(split_sheet(file)[0])).is_file()]
    return [{"file": str(f), "sha256": hashlib.sha256(f.read_bytes()).hexdigest()} for f in existing]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Record of a run, made at its start and written at its end."""

    command: Sequence[str]  # The command line
    inputs: Sequence[dict[str, str]]
    seed: int
    jobs: int
    started: datetime = field(default_factory=lambda: datetime.now(UTC))  # Time of the start
    _tick: float = field(default_factory=time.monotonic)

    def finished(self, outputs: Sequence[str]) -> dict[str, Any]:
        """Return the content of ``run.json``."""
        from deatwin.plant.integrator.compiled import compiler

        return {
            "schema": SCHEMA,
            "command": list(self.command),
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": round(time.monotonic() - self._tick, 2),
            "seed": self.seed,
            "jobs": self.jobs,
            "versions": versions(),
            "platform": platform.platform(),
            "compiler": compiler(),
            "inputs": list(self.inputs),
            "outputs": list(outputs),
        }

    def save(self, folder: ResultFolder) -> None:
        """Write ``run.json`` into a folder, with the names of all files there."""
        folder.text("run.json", json.dumps(self.finished([*folder.written, "run.json"]), indent=1) + "\n")
