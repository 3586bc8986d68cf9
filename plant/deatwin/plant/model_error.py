"""Model error of a rig's own equations: the residual against finer ones after a refit.

A diagnosis needs the error that a calibration cannot absorb. Results are cached per user, for rounded parameters.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

import numpy as np

from deatwin.plant.arguments import of_plain_data
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.documents import read_document, write_document
from deatwin.plant.errors import ModelError, SimulationError
from deatwin.plant.integrator.compiled import cache_folder
from deatwin.plant.parameters import Parameter
from deatwin.plant.recording import Experiment
from deatwin.plant.rigs.base import Rig
from deatwin.plant.simulate import RunStatus

if TYPE_CHECKING:
    from deatwin.plant.model import Plant


SCHEMA = "deatwin/model-error/2"
BINS = 12  # Number of intervals of the command in a band
EVALUATIONS = 30  # Largest number of simulations of a refit, which settles in about ten
DIGITS = 2  # Significant digits of rounded parameters; rounding changes the error by a few percent of itself


@runtime_checkable
class Refinable(Protocol):
    """A rig that offers finer equations."""

    def finer(self) -> Rig:
        """Return the rig with finer equations, whose parameters have the same names."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Discrepancy:
    """Error that remains after a plant is calibrated to the simulated readings of a plant with finer equations.

    The error is the reading of the plant with finer equations minus the reading of the calibrated plant. For a rig
    without finer equations, all rms errors are the rig's `model_error`, and the mean error is zero.

    Parameters
    ----------
    rms : float
        Rms error over all readings, SI.
    motion : float
        Standard deviation of the readings of the plant with finer equations, SI; NaN if the rig has no finer equations.
    before : float
        Rms error before the calibration, SI.
    commands : ndarray, shape (n,)
        Centres of n equal intervals of the command, in the unit of the command.
    mean : ndarray, shape (n,)
        Mean error in each interval of the command, SI; NaN in an interval without readings.
    deviation : ndarray, shape (n,)
        Rms error in each interval of the command, SI; NaN in an interval without readings.
    """

    rms: float
    motion: float
    before: float
    commands: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray

    @property
    def share(self) -> float:
        """`rms` divided by `motion`."""
        return self.rms / self.motion if self.motion > 0 else 0.0

    def at(self, commands: np.ndarray) -> np.ndarray:
        """Return the rms errors at `commands`, shape (m,), SI, interpolated linearly between the intervals' centres."""
        seen = np.isfinite(self.deviation)
        return np.interp(commands, self.commands[seen], self.deviation[seen])

    @classmethod
    def between(cls, fine: np.ndarray, coarse: np.ndarray, commands: np.ndarray, before: float) -> Self:
        """Make the discrepancy from the readings of two plants.

        Parameters
        ----------
        fine, coarse : ndarray, shape (n,)
            Readings of the plant with finer equations, and of the calibrated plant, SI.
        commands : ndarray, shape (n,)
            Commands at which the readings were taken, in the unit of the command.
        before : float
            Rms error before the calibration, SI.
        """
        rest = fine - coarse
        edges = np.linspace(commands.min(), commands.max(), BINS + 1)
        which = np.clip(np.searchsorted(edges, commands, side="right") - 1, 0, BINS - 1)
        inside = [rest[which == k] for k in range(BINS)]
        return cls(
            rms=root_mean_square(rest),
            motion=float(np.std(fine)),
            before=before,
            commands=(edges[:-1] + edges[1:]) / 2,
            mean=np.array([part.mean() if part.size else np.nan for part in inside]),
            deviation=np.array([root_mean_square(part) if part.size else np.nan for part in inside]),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data; an interval that was never visited has no numbers."""
        bands = {
            name: [None if np.isnan(v) else float(v) for v in getattr(self, name)]
            for name in ("commands", "mean", "deviation")
        }
        return {"schema": SCHEMA, "rms": self.rms, "motion": self.motion, "before": self.before, **bands}

    @classmethod
    @of_plain_data()
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make the discrepancy from the `data` that `to_dict` returned."""
        commands, mean, deviation = (
            np.array([np.nan if v is None else float(v) for v in data[name]])
            for name in ("commands", "mean", "deviation")
        )
        return cls(
            rms=float(data["rms"]),
            motion=float(data["motion"]),
            before=float(data["before"]),
            commands=commands,
            mean=mean,
            deviation=deviation,
        )


def discrepancy(plant: Plant, experiment: Experiment) -> Discrepancy:
    """Return the residual of a plant against its version with finer equations; cached on disk."""
    commands = np.concatenate([record.inputs[0] for record in experiment.recordings])
    if not isinstance(plant.rig, Refinable):
        return _stated(plant.rig, commands)
    rounded = _rounded(plant)
    file = _file(rounded, experiment)
    found = _read(file)
    if found is None:
        found = _computed(rounded, plant.rig.finer(), experiment, commands)
        write_document(file, found.to_dict())
    return found


def _read(file: Path) -> Discrepancy | None:
    try:
        return read_document(file, SCHEMA, Discrepancy.from_dict)
    except ModelError:  # missing, or written by another version
        return None


def _stated(rig: Rig, commands: np.ndarray) -> Discrepancy:
    middles = np.linspace(commands.min(), commands.max(), BINS)
    return Discrepancy(
        rms=rig.model_error,
        motion=np.nan,
        before=rig.model_error,
        commands=middles,
        mean=np.zeros(BINS),
        deviation=np.full(BINS, rig.model_error),
    )


def _computed(plant: Plant, finer: Rig, experiment: Experiment, commands: np.ndarray) -> Discrepancy:
    simulation = plant.with_rig(finer).simulate(experiment).require()
    if lost := [event for event in simulation.events if event.status is RunStatus.TENSION_LOST]:
        raise SimulationError(f"the film's finer equations cannot serve as a measure here: {lost[0]}")
    fine = np.concatenate([y[0] for y in simulation.outputs])
    fit = _Refit(plant, experiment, fine)
    before = root_mean_square(fit.residuals(fit.start))
    return Discrepancy.between(fine, fine - fit.rest(), commands, before)


class _Refit:
    """Least-squares fit of a plant's free parameters to the readings of another plant."""

    def __init__(self, plant: Plant, experiment: Experiment, target: np.ndarray) -> None:
        self._plant, self._target = plant, target
        self._timeline = plant.timeline(experiment)
        self._rows = np.concatenate(self._timeline.readings) + 1
        self._free: list[Parameter] = [plant.parameters[name] for name in plant.parameters.free]
        self._last: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self.start = np.array([p.scale.to_coordinate(p.value) for p in self._free])

    def rest(self) -> np.ndarray:
        """Return target minus fitted readings, shape (n,), SI."""
        from scipy.optimize import least_squares  # not needed to simulate

        lower, upper = np.array([p.ends for p in self._free]).T
        margin = 1e-9 * (upper - lower)
        found = least_squares(
            self.residuals,
            np.clip(self.start, lower + margin, upper - margin),
            jac=self._jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            ftol=1e-6,
            xtol=1e-6,
            gtol=1e-12,
            max_nfev=EVALUATIONS,
        )
        return self.residuals(found.x)

    def residuals(self, coordinates: np.ndarray) -> np.ndarray:
        """Return target minus readings, shape (n,), SI; very large values where the plant fails."""
        return self._evaluate(coordinates)[0]

    def _jacobian(self, coordinates: np.ndarray) -> np.ndarray:
        return self._evaluate(coordinates)[1]

    def _evaluate(self, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = coordinates.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, *self._simulate(coordinates))
        return self._last[1:]

    def _simulate(self, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pairs = zip(self._free, coordinates, strict=True)
        values = np.array([np.clip(p.scale.to_value(float(x)), p.lower, p.upper) for p, x in pairs])
        run = self._plant.runner.run_with_sensitivities(**{**self._plant.given(self._timeline), "values": values})
        if not run.status.ok or run.sensitivities is None:
            if self._last is None:
                raise SimulationError(f"the plant itself cannot follow these commands: {run.advice}")
            return np.full_like(self._target, 1e3 * np.ptp(self._target)), self._last[2]
        slopes = np.array([p.scale.slope(v) for p, v in zip(self._free, values, strict=True)])
        return self._target - run.outputs[self._rows], -run.sensitivities[self._rows] * slopes


def _rounded(plant: Plant) -> Plant:
    free = [plant.parameters[name] for name in plant.parameters.free]
    return plant.with_values({p.name: float(np.clip(float(f"{p.value:.{DIGITS}g}"), p.lower, p.upper)) for p in free})


def _file(plant: Plant, experiment: Experiment) -> Path:
    """Return the file of a cached result, named after everything on which the result depends."""
    rig = {name: value for name, value in plant.rig.to_dict().items() if name not in ("noise", "model_error")}
    content = plant.to_dict() | {"kind": plant.rig.kind, "rig": rig, "deatwin": version("deatwin"), "schema": SCHEMA}
    content |= {"stages": plant.stages, "steps": plant.steps}
    timeline = plant.timeline(experiment)
    seen = {name: timeline.channels[name] for name in plant.equations.channels if name in timeline.channels}
    digest = hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode())
    digest.update(plant.equations.dynamics.serialize().encode())
    for numbers in (timeline.commands, *timeline.readings, *seen.values()):
        digest.update(np.ascontiguousarray(numbers).tobytes())
    digest.update(repr((timeline.start, timeline.sample_time, sorted(seen))).encode())
    name = digest.hexdigest()[:32]
    folder = cache_folder() / "model_error"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder / f"{name}.json"
