"""Residual of a calibrated plant, with the signals that its tests need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.greybox.parts import Part, first_only, level_of, simulated
from deatwin.ident.greybox.problem import Problem
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

if TYPE_CHECKING:
    from deatwin.ident.mismatch.naming.candidate import Candidate
    from deatwin.ident.mismatch.problem import DiagnosisProblem


@dataclass(frozen=True, kw_only=True, eq=False)
class Leftover:
    """Free-run residual over all sound samples, recordings one after another, with its refit's Jacobian and signals."""

    residual: np.ndarray  # (n,), measured minus simulated, over the noise's level, SI
    fitted: np.ndarray  # (n,), bool, samples that the fit saw
    jacobian: np.ndarray  # (n, p), derivative of the readings by the fitted coordinates, SI
    commands: np.ndarray  # (n,), in the command's unit
    readings: np.ndarray  # (n,), simulated, SI
    moved: np.ndarray  # (n,), simulated readings minus those under each experiment's first command held throughout, SI
    timepts: np.ndarray  # (n,), clock times, s
    record: np.ndarray  # (n,), number of the recording
    experiment: np.ndarray  # (n,), number of the experiment
    sample_time: float
    noise: float  # rms of sensor noise, SI
    model_error: float  # rms of the plant's own error after a calibration, SI
    sheet: float = 0.0  # noise that the sensor's data sheet states, SI; 0 if none
    output_unit: str = "m"
    # Number of samples of the first reading, which precede those of further readings; None if there are no others
    first: int | None = None

    @property
    def floor(self) -> float:
        """Return the mean square of noise and model error, SI."""
        return self.noise**2 + self.model_error**2

    @property
    def records(self) -> tuple[slice, ...]:
        """Return where each recording's samples lie."""
        edges = [0, *(np.flatnonzero(np.diff(self.record)) + 1).tolist(), self.record.size]
        return tuple(slice(a, b) for a, b in pairwise(edges))

    @property
    def of_first(self) -> Leftover:
        """Return the residual of the first reading alone."""
        if self.first is None or self.first == self.residual.size:
            return self
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        own: dict[str, Any] = {n: v[: self.first] for n, v in values.items() if isinstance(v, np.ndarray)}
        return replace(self, **own)


def leftover_of(base: Candidate, problem: DiagnosisProblem) -> Leftover:
    """Return residual, Jacobian and signals of a plant, calibrated on the fitted part, on all recordings."""
    # A refit cannot move a parameter beyond its bound, so its column is left out.
    fit = base.calibration
    fitting = Problem(plant=fit.plant, parts=problem.everything, names=fit.names)
    found = fitting.evaluate(fitting.start())
    # cannot happen, since the candidate was simulated on all data; the fitted part is known in any case
    if found is None:
        residual, jacobian, parts = fit.residuals, fit.jacobian, problem.fitted
    else:
        (residual, jacobian), parts = found, problem.everything
    free = [k for k, name in enumerate(fit.names) if name not in fit.at_bound]
    held = _held(fit.plant, parts)
    readings = np.concatenate([part.measured for part in parts]) - residual * level_of(parts)
    of_record = [mask.sum() for part in parts for mask in part.masks]
    of_experiment = [part.size for part in parts]
    return Leftover(
        residual=residual,
        fitted=_fitted(problem, parts),
        jacobian=jacobian[:, free],
        commands=np.concatenate([r.inputs[0, m] for p in parts for r, m in _records(p)]),
        readings=_alike(readings, parts),
        moved=readings - (np.mean(readings) if held is None else held),
        timepts=np.concatenate([part.timepts for part in parts]),
        record=np.repeat(np.arange(len(of_record)), of_record),
        experiment=np.repeat(np.arange(len(of_experiment)), of_experiment),
        sample_time=parts[0].experiment.sample_time,
        noise=base.noise,
        model_error=fit.plant.rig.model_error,
        sheet=fit.plant.rig.noise,
        output_unit=fit.plant.rig.output_unit,
        first=sum(of_experiment[: len(first_only(parts))]),
    )


def _records(part: Part) -> list[tuple]:
    return list(zip(part.experiment.recordings, part.masks, strict=True))


def _fitted(problem: DiagnosisProblem, parts: Sequence[Part]) -> np.ndarray:
    pieces = []
    for whole, early in zip(parts, problem.fitted, strict=True):
        pieces += [seen[mask] for seen, mask in zip(early.masks, whole.masks, strict=True)]
    return np.concatenate(pieces)


def _held(plant: Plant, parts: Sequence[Part]) -> np.ndarray | None:
    """Return the readings if each experiment's first command were held throughout; None if the plant fails."""
    pieces = []
    for part in parts:
        records = part.experiment.recordings
        first = records[0].inputs[:, :1]
        still = tuple(replace(r, inputs=np.repeat(first, r.n_samples, axis=1)) for r in records)
        pieces.append(replace(part, experiment=Experiment(recordings=still)))
    return simulated(plant, pieces)


def _alike(values: np.ndarray, parts: Sequence[Part]) -> np.ndarray:
    """Scale each further reading to the range of the first one."""
    edges = np.cumsum([0, *(part.size for part in parts)])
    names = np.repeat([part.reading for part in parts], np.diff(edges))
    low, high = float(values[names == ""].min()), float(values[names == ""].max())
    found = values.copy()
    for name in dict.fromkeys(part.reading for part in parts if part.reading):
        own = values[names == name]
        span = max(float(np.ptp(own)), np.finfo(float).tiny)
        found[names == name] = low + (own - own.min()) * ((high - low) / span)
    return found
