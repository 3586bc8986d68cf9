"""Structural residual: the part of a change in readings that a refit of the base plant cannot take up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import Part, simulated
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

TOLERANCE = 1e-5  # Relative tolerance of refits: 0.005 % of a residual that is almost entirely structural


@dataclass(frozen=True, kw_only=True, eq=False)
class StructuralScale:
    """Ratio of the structural residual of added physics to the noise."""

    experiment: Experiment  # Experiment whose commands are used
    clean: np.ndarray  # shape (n,): Noise-free readings without the added physics, m
    form: Calibration  # The base plant refitted to `clean`
    noise: float  # Rms of the sensor's noise, m

    @classmethod
    def of(cls, base: Plant, experiment: Experiment, clean: Sequence[np.ndarray], noise: float) -> Self:
        """Refit the base plant to readings without the mechanism."""
        form = descend(base, [_part(experiment, clean)], tolerance=TOLERANCE)
        if not form.status.ok:
            raise SimulationError(f"no refit of the base plant: {form.status.value}")
        return cls(experiment=experiment, clean=np.concatenate(clean), form=form, noise=noise)

    def guess(self, readings: Sequence[np.ndarray]) -> float:
        """Estimate the ratio, to first order, for readings with a mechanism."""
        return min(self._left(readings)) / self.noise

    def ratio(self, readings: Sequence[np.ndarray]) -> float:
        """Return the rms that a full refit leaves beyond that of a clean film, divided by the noise."""
        same, shifted = self._left(readings)
        plant = self.form.plant if same <= shifted else _read_otherwise(self.form.plant)
        refitted = descend(plant, [_part(self.experiment, readings)], tolerance=TOLERANCE)
        if not refitted.status.ok:
            raise SimulationError(f"no refit of the base plant: {refitted.status.value}")
        return root_mean_square(refitted.residuals - self.form.residuals) / self.noise

    def _left(self, readings: Sequence[np.ndarray]) -> tuple[float, float]:
        """Return the rms, m, left by refits of the base plant with its own reading time and with the other one."""
        change = np.concatenate(readings) - self.clean
        both = (change, change + self._advance)
        return tuple(root_mean_square(taken_off(c, self._basis)) for c in both)  # type: ignore[return-value]

    @cached_property
    def _basis(self) -> np.ndarray:
        return tangent_basis(self.form.jacobian)

    @cached_property
    def _advance(self) -> np.ndarray:
        """Return the change of the base plant's readings with the other reading time, shape (n,), m."""
        ends = np.cumsum([r.n_samples for r in self.experiment.recordings])
        part = _part(self.experiment, np.split(self.clean, ends[:-1]))
        other = simulated(_read_otherwise(self.form.plant), [part])
        if other is None:
            raise SimulationError("the base plant cannot be simulated")
        return self.clean - self.form.residuals - other


def _read_otherwise(plant: Plant) -> Plant:
    return plant.with_rig(replace(plant.rig, reading=plant.rig.reading.other_end))


def _part(experiment: Experiment, readings: Sequence[np.ndarray]) -> Part:
    pairs = zip(experiment.recordings, readings, strict=True)
    return Part.whole(Experiment(recordings=tuple(replace(r, outputs=y[None]) for r, y in pairs)))
