"""One diagnosis, and what is kept of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.mismatch import Diagnosis
from deatwin.plant.errors import ModelError
from deatwin.scenarios.unexplained_drift.recordings import Case
from deatwin.studies.diagnosing import DiagnosisTask
from deatwin.studies.folder import ResultFolder

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A recording beside simulations."""

    timepts: Array  # shape (n,): Clock times, s
    measured: Array
    base: Array
    answer: Array
    deviation: Array  # shape (n,): Predictive standard deviation of the last, m


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """The answer for one actuator."""

    name: str
    diagnosis: Diagnosis
    tracks: tuple[Track, ...]  # One for each recording

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        tracks = [{key: values.tolist() for key, values in vars(track).items()} for track in self.tracks]
        return {"name": self.name, "diagnosis": self.diagnosis.to_dict(), "tracks": tracks}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The finding that `to_dict` described."""
        tracks = (Track(**{k: np.array(v, dtype=float) for k, v in track.items()}) for track in data["tracks"])
        return cls(name=data["name"], diagnosis=Diagnosis.from_dict(data["diagnosis"]), tracks=tuple(tracks))


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
    kept = Diagnosis.from_dict(diagnosis.to_dict())
    return Finding(name=case.name, diagnosis=kept, tracks=tuple(tracks)), list(own.written)
