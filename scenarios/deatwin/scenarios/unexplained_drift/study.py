"""The running of the story: a case for each diagnosis and for each run of the argument, on the disk when through."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.fleet import Actuator, fleet
from deatwin.scenarios.unexplained_drift.examine import Finding, examine
from deatwin.scenarios.unexplained_drift.recordings import case_of
from deatwin.scenarios.unexplained_drift.repeatability import Drift, Group, Run, drift_of, grouped, runs
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal
from deatwin.studies.sweep.store import CaseStore

CASES = "cases"
"""Folder of the cases."""
EFFORT = 12.0
"""Of a diagnosis, where a run of the argument takes 1."""

Case = Callable[[], dict[str, Any]]
Content = TypeVar("Content")


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """What came out."""

    findings: tuple[Finding, ...]  # One for each actuator
    groups: tuple[Group, ...]
    files: tuple[str, ...]  # That the diagnoses have written, inside the folder


class Answers(CaseStore[SweepSeal]):
    """The cases of the story."""

    def __init__(self, folder: Path, seal: SweepSeal) -> None:
        super().__init__(folder, seal, cases=CASES)

    def files(self, name: str) -> tuple[str, ...]:
        """What the diagnosis of a case has written."""
        return self._read(name, lambda found: tuple(f"diagnoses/{name}/{file}" for file in found["files"]))

    def finding(self, name: str) -> Finding:
        """The answer of a case that is a diagnosis."""
        return self._read(name, lambda found: Finding.from_dict(found["finding"]))

    def drift(self, name: str) -> Drift:
        """The answer of a case that is a run of the argument."""
        return self._read(name, lambda found: Drift(**found["drift"]))

    def _read(self, name: str, build: Callable[[dict[str, Any]], Content]) -> Content:
        found = self.get(name)
        try:
            return build(found)
        except (ModelError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"{self.path(name)}: it must hold a case ({error!r}); delete it, and it is run again"
            ) from None


def carry_out(
    answers: Answers, seed: int, command: Sequence[str], jobs: int, tell: Callable[[float, str], None]
) -> Study:
    """Run every case that has no answer; no diagnosis sees more than its recordings."""
    diagnoses: dict[str, Case] = {
        _slug(actuator): partial(_diagnosed, actuator, answers.folder / "diagnoses" / _slug(actuator), command, seed)
        for actuator in fleet(seed)
    }
    repeats: dict[str, Case] = {f"argument-{n:02d}": partial(_driven, run) for n, run in enumerate(runs(seed))}
    through = answers.names()
    answers.discard([name for name in diagnoses if name in through and not _whole(answers, name)])
    for name in through & set(repeats):
        answers.drift(name)  # a bad one is told of at once
    run_sweep(
        _answered, {**diagnoses, **repeats}, answers, jobs=jobs, tell=tell, efforts=dict.fromkeys(diagnoses, EFFORT)
    )
    return Study(
        findings=tuple(map(answers.finding, diagnoses)),
        groups=grouped([answers.drift(name) for name in repeats]),
        files=tuple(file for name in diagnoses for file in answers.files(name)),
    )


def _answered(case: Case) -> dict[str, Any]:
    return case()


def _diagnosed(actuator: Actuator, folder: Path, command: Sequence[str], seed: int) -> dict[str, Any]:
    finding, files = examine(case_of(actuator), folder, tuple(command), seed)
    return {"finding": finding.to_dict(), "files": files}


def _driven(run: Run) -> dict[str, Any]:
    return {"drift": asdict(drift_of(run.plant, run.history, run.seed))}


def _whole(answers: Answers, name: str) -> bool:
    """Whether a diagnosis can be read, and all that it has written is still there."""
    answers.finding(name)
    return all((answers.folder / file).exists() for file in answers.files(name))


def _slug(actuator: Actuator) -> str:
    return actuator.name.lower().replace(" ", "")
