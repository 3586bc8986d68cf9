"""Run the story: a case for each diagnosis and for each run of the argument, on the disk when through."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from operator import call
from pathlib import Path
from typing import Any, Self

import numpy as np

from deatwin.ident.mismatch import Diagnosis
from deatwin.plant import Actuator, Experiment, ModelError, Plant, Recording, fleet, specification
from deatwin.plant.arrays import Array
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.records import plain, read
from deatwin.scenarios.unexplained_drift.repeatability import Drift, Group, History, drift_of, grouped, runs
from deatwin.studies.diagnosing import DiagnosisTask
from deatwin.studies.folder import ResultFolder
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal
from deatwin.studies.sweep.store import CaseStore

VISITS = ((32.0, 80.0), (1020.0, 40.0))
"""Clock time at which the actuator is driven, and for how long, s. In between it rests at 0 V: effects that follow the
drive start anew, effects that follow the clock go on. The first visit begins when the ball of the first actuator has
worn down the grease over which it snaps from 10 to 30 s: the diagnosis takes that for outliers and refuses the
recording."""
CASES = "cases"  # Folder of the cases
EFFORT = 12.0  # Work of a diagnosis; a run of the argument takes 1

Work = Callable[[], dict[str, Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Everything known of an actuator whose drift is concealed."""

    name: str  # ``DEA 1`` to ``DEA 6``
    plant: Plant  # The specification: six alike, with hysteresis and without a drift
    experiments: tuple[Experiment, ...]  # One for each of `VISITS`, each from rest


def case_of(actuator: Actuator) -> Case:
    """Record an actuator with the thesis' noise, as an experimenter would."""
    rng = np.random.default_rng((*actuator.seed, 3))
    step = actuator.plant.rig.sample_time
    experiments = []
    for start, duration in VISITS:
        commands = band_limited_noise(rng, duration, step)
        planned = Recording.from_arrays(commands, np.zeros_like(commands), step, start=start)
        experiments.append(actuator.record(Experiment(recordings=(planned,)), rng))
    return Case(name=actuator.name, plant=specification(), experiments=tuple(experiments))


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A recording beside simulations; all signals in m, shape (n,)."""

    timepts: Array  # shape (n,): Clock times, s
    measured: Array
    base: Array
    answer: Array
    deviation: Array  # shape (n,): Predictive standard deviation of the last, m


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """The diagnosis of one actuator."""

    name: str
    diagnosis: Diagnosis
    tracks: tuple[Track, ...]  # One for each recording

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"name": self.name, "diagnosis": self.diagnosis.to_dict(), "tracks": plain(self.tracks)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read what `to_dict` made."""
        tracks = tuple(read(Track, track) for track in data["tracks"])
        return cls(name=data["name"], diagnosis=Diagnosis.from_dict(data["diagnosis"]), tracks=tracks)


def examine(case: Case, folder: Path, command: Sequence[str], seed: int) -> tuple[Finding, list[str]]:
    """Diagnose a case, and write the diagnosis with its report."""
    own = ResultFolder(folder)
    task = DiagnosisTask(plant=case.plant, experiments=case.experiments, files=(), command=command, seed=seed)
    diagnosis = task.run(own, lambda share, text: None)
    readings, model = diagnosis.readings, diagnosis.model
    if readings is None or model is None:
        raise ModelError(f"{case.name}: the diagnosis has no model")
    tracks = []
    for experiment, base in zip(case.experiments, readings.base, strict=True):
        predicted = model.predict(experiment)
        tracks += [
            Track(timepts=r.timepts, measured=r.outputs[0], base=b, answer=mean, deviation=deviation)
            for r, b, mean, deviation in zip(
                experiment.recordings, base, predicted.mean, predicted.deviation, strict=True
            )
        ]
    return Finding(name=case.name, diagnosis=diagnosis, tracks=tuple(tracks)), list(own.written)


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All trials and comparisons of the study."""

    findings: tuple[Finding, ...]  # One for each actuator
    groups: tuple[Group, ...]
    files: tuple[str, ...]  # Files of the diagnoses, inside the folder


class Answers(CaseStore):
    """The cases of the story."""

    def __init__(self, folder: Path, seal: SweepSeal) -> None:
        super().__init__(folder, seal, cases=CASES)

    def files(self, name: str) -> tuple[str, ...]:
        """List the files that the diagnosis of a case has written."""
        return self.read(name, lambda found: tuple(f"diagnoses/{name}/{file}" for file in found["files"]))

    def finding(self, name: str) -> Finding:
        """Read a case that is a diagnosis."""
        return self.read(name, lambda found: Finding.from_dict(found["finding"]))

    def drift(self, name: str) -> Drift:
        """Read a case that is a run of the argument."""
        return self.read(name, lambda found: read(Drift, found["drift"]))


def carry_out(
    answers: Answers, seed: int, command: Sequence[str], jobs: int, tell: Callable[[float, str], None]
) -> Study:
    """Run all cases without a result; each diagnosis receives only its recordings."""
    named = {actuator.name.lower().replace(" ", ""): actuator for actuator in fleet(seed)}
    diagnoses: dict[str, Work] = {
        name: partial(_diagnosed, actuator, answers.folder / "diagnoses" / name, command, seed)
        for name, actuator in named.items()
    }
    repeats: dict[str, Work] = {f"argument-{n:02d}": partial(_driven, *run) for n, run in enumerate(runs(seed))}
    through = answers.names()
    answers.discard([name for name in diagnoses if name in through and not _whole(answers, name)])
    for name in through & set(repeats):
        answers.drift(name)  # a bad one is told of at once
    run_sweep(call, {**diagnoses, **repeats}, answers, jobs=jobs, tell=tell, efforts=dict.fromkeys(diagnoses, EFFORT))
    return Study(
        findings=tuple(map(answers.finding, diagnoses)),
        groups=grouped([answers.drift(name) for name in repeats]),
        files=tuple(file for name in diagnoses for file in answers.files(name)),
    )


def _diagnosed(actuator: Actuator, folder: Path, command: Sequence[str], seed: int) -> dict[str, Any]:
    finding, files = examine(case_of(actuator), folder, tuple(command), seed)
    return {"finding": finding.to_dict(), "files": files}


def _driven(plant: Plant, history: History, seed: tuple[int, ...]) -> dict[str, Any]:
    return {"drift": asdict(drift_of(plant, history, seed))}


def _whole(answers: Answers, name: str) -> bool:
    """Test that a diagnosis can be read, and that all its files are still there."""
    answers.finding(name)
    return all((answers.folder / file).exists() for file in answers.files(name))
