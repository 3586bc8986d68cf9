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

__all__ = ["Finding", "Track", "examine"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A recording beside simulations.

    Parameters
    ----------
    timepts : ndarray, shape (n,)
        Clock times, s.
    measured, base, answer : ndarray, shape (n,)
        Readings, those of the calibrated base plant, and those of the plant that the diagnosis ends with, m.
    deviation : ndarray, shape (n,)
        Predictive standard deviation of the last, m.
    """

    timepts: Array
    measured: Array
    base: Array
    answer: Array
    deviation: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """The answer for one actuator.

    Parameters
    ----------
    name : str
        Of the actuator.
    diagnosis : Diagnosis
        As its file has it.
    tracks : tuple of Track
        One for each recording.
    """

    name: str
    diagnosis: Diagnosis
    tracks: tuple[Track, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        tracks = [{key: values.tolist() for key, values in vars(track).items()} for track in self.tracks]
        return {"name": self.name, "diagnosis": self.diagnosis.to_dict(), "tracks": tracks}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The finding that `to_dict` described.

        Parameters
        ----------
        data : mapping
            As a file gives it back.

        Returns
        -------
        Finding

        Raises
        ------
        ModelError, KeyError, TypeError, ValueError, AttributeError
            If it is none.
        """
        tracks = (Track(**{k: np.array(v, dtype=float) for k, v in track.items()}) for track in data["tracks"])
        return cls(name=data["name"], diagnosis=Diagnosis.from_dict(data["diagnosis"]), tracks=tuple(tracks))


def examine(case: Case, folder: Path, command: Sequence[str], seed: int) -> tuple[Finding, list[str]]:
    """Diagnose a case, and write the diagnosis with its report.

    Parameters
    ----------
    case : Case
        Without its drift.
    folder : path
        For the files.
    command : sequence of str
        For the record of the run.
    seed : int
        Of everything random.

    Returns
    -------
    Finding
        The answer.
    list of str
        Names of the files in the folder.

    Raises
    ------
    ModelError
        If the diagnosis ends without a model.
    """
    own = ResultFolder(folder)
    task = DiagnosisTask(plant=case.plant, experiments=case.experiments, files=(), command=command, seed=seed)
    diagnosis = task.run(own, lambda share, text: None)
    evidence, model = diagnosis.evidence, diagnosis.model
    if evidence is None or model is None:
        raise ModelError(f"{case.name}: the diagnosis has no model")
    tracks = []
    for experiment, base in zip(case.experiments, evidence.base, strict=True):
        predicted = model.predict(experiment)
        tracks += [
            Track(timepts=r.timepts, measured=r.outputs[0], base=b, answer=mean, deviation=deviation)
            for r, b, mean, deviation in zip(
                experiment.recordings, base, predicted.mean, predicted.deviation, strict=True
            )
        ]
    kept = Diagnosis.from_dict(diagnosis.to_dict())
    return Finding(name=case.name, diagnosis=kept, tracks=tuple(tracks)), list(own.written)
