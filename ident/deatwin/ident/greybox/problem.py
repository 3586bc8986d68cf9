"""Residuals of a simulated plant as a function of its parameters in fitted coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from deatwin.ident.greybox.parts import Part, shared
from deatwin.plant.interrupts import obey
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter

Response = tuple[np.ndarray, np.ndarray]  # Residuals (m,), and the derivative of the readings (m, n), SI
STEEPEST = 1e150
"""Largest derivative in a fit, SI per coordinate: squares of larger ones, summed over the samples, would overflow."""

Progress = Callable[[float, str], None]  # Called with the completed share, 0 to 1, and the current work
_STAGE = 1 / 3  # Share of the remaining work that a further fit takes: a search usually consists of about three fits
_USUAL = 8  # Simulations after which a fit is reported as half done; most settle in ten to fifteen


class Watch:
    """Counts simulations, reports progress, and raises an interrupt that CasADi did not pass on."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._left, self._within, self._count, self._doing = 1.0, 0, 0, ""

    def begin(self, doing: str) -> None:
        """Begin the next fit."""
        self._left *= 1.0 - _STAGE if self._doing else 1.0
        self._within, self._doing = 0, doing

    def __call__(self) -> None:
        """Count a simulation."""
        obey()
        self._within += 1
        self._count += 1
        done = self._within / (self._within + _USUAL)
        self._progress(1.0 - self._left * (1.0 - _STAGE * done), f"{self._doing}, {self._count} simulations")


def unwatched() -> Watch:
    """Return a watch that reports to nobody."""
    return Watch(lambda share, doing: None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Residuals of a plant on the counted samples, as a function of the fitted coordinates."""

    plant: Plant  # Plant with starting values
    parts: tuple[Part, ...]  # Samples to be fitted
    names: tuple[str, ...]  # Parameters to be fitted; other free ones keep their values
    watch: Watch = field(default_factory=unwatched)  # Called at each simulation
    response: Response | None = None  # Residuals and derivative at the start, if already known

    def start(self) -> np.ndarray:
        """Coordinates of the plant's present values, shape (n,)."""
        return np.array([p.scale.to_coordinate(p.value) for p in self._fitted])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper coordinates of the physical range, shape (n,) each."""
        lower, upper = np.array([p.ends for p in self._fitted]).reshape(-1, 2).T
        return lower, upper

    def smooth(self) -> np.ndarray:
        """Return which coordinates the readings depend on smoothly, shape (n,): all except the times of events."""
        return np.array([name not in self.plant.event_times for name in self.names], dtype=bool)

    def values(self, coordinates: np.ndarray) -> dict[str, float]:
        """Return SI values of coordinates, clipped to the physical range against rounding."""
        pairs = zip(self._fitted, coordinates, strict=True)
        return {p.name: min(max(p.scale.to_value(float(x)), p.lower), p.upper) for p, x in pairs}

    @property
    def _fitted(self) -> list[Parameter]:
        return [self.plant.parameters[name] for name in self.names]

    def evaluate(self, coordinates: np.ndarray) -> Response | None:
        """Residuals (m,) and derivative of the readings (m, n), SI; None if the plant fails. Shapes: (n,)."""
        if self.response is not None and np.array_equal(coordinates, self.start()):
            return self.response
        self.watch()
        plant = self.plant.with_values(self.values(coordinates))
        free = plant.parameters.free
        columns = [free.index(n) for n in self.names]
        slope = np.array([p.scale.slope(p.value) for p in (plant.parameters[n] for n in self.names)])
        residuals, jacobians, runs = [], [], {}
        for part, timeline, end, counted in shared(plant, self.parts):
            if part.history not in runs:
                runs[part.history] = plant.runner.run_with_sensitivities(**plant.given(timeline, end))
            run, row = runs[part.history], part.row(plant.rig) - 1
            if not run.status.ok or run.sensitivities is None:
                return None
            readings, slopes = run.outputs, run.sensitivities
            if part.reading:
                readings, slopes = part.weight * run.further[:, row], part.weight * run.further_slopes[:, row]
            residuals.append((part.measured - readings[counted + 1]) / part.level)
            jacobians.append(slopes[counted + 1][:, columns] * slope / part.level[:, None])
            if not np.abs(jacobians[-1]).max(initial=0.0) < STEEPEST:  # nor if it is NaN
                return None
        return np.concatenate(residuals), np.vstack(jacobians)
