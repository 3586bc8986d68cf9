"""How much of a mechanism is left once the base plant was refitted: its structural residual, against the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, calibrate
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

__all__ = ["StructuralScale"]

TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class StructuralScale:
    """The base plant in all forms that its rig file leaves open, refitted to a film without mechanisms.

    Parameters
    ----------
    experiment : Experiment
        The commands that count.
    forms : tuple of Calibration
        Of each form to the clean film's noise-free readings, the best first.
    noise : float
        Rms of the sensor's noise, m.
    """

    experiment: Experiment
    forms: tuple[Calibration, ...]
    noise: float

    @classmethod
    def of(cls, nominal: Plant, near: dict[str, float], experiment: Experiment, clean: Sequence[np.ndarray], noise: float) -> Self:
        """Refit the base plant to a clean film.

        Parameters
        ----------
        nominal : Plant
            The plant that the experimenter has.
        near : dict of str to float
            The film's own values, where the fit starts.
        experiment : Experiment
            The commands that count.
        clean : sequence of ndarray
            Noise-free readings without mechanisms, for each record, m.
        noise : float
            Rms of the sensor's noise, m.

        Returns
        -------
        StructuralScale
        """
        part = _part(experiment, clean)
        rigs = (nominal.rig, *nominal.rig.rivals())
        forms = [calibrate(nominal.with_rig(rig).with_values(near), [part], tolerance=TOLERANCE) for rig in rigs]
        return cls(
            experiment=experiment, forms=tuple(sorted((f for f in forms if f.status.ok), key=lambda f: f.rms)), noise=noise
        )

    @property
    def rest(self) -> float:
        """What the base plant leaves of the clean film itself, rms, m."""
        return self.forms[0].rms

    def guess(self, change: np.ndarray) -> float:
        """The ratio for what a mechanism adds to the readings, to first order of the refit.

        Parameters
        ----------
        change : ndarray, shape (n,)
            Readings with the mechanism minus those without, m.

        Returns
        -------
        float
        """
        slopes = self.forms[0].jacobian
        basis, _ = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0))
        left = change - basis @ (basis.T @ change)
        return float(np.sqrt(np.mean(left**2))) / self.noise

    def ratio(self, readings: Sequence[np.ndarray]) -> float:
        """Rms over noise of what a full refit of the best form leaves beyond what it leaves of the clean film.

        Parameters
        ----------
        readings : sequence of ndarray
            Noise-free, with the mechanism, for each record, m.

        Returns
        -------
        float
        """
        part = _part(self.experiment, readings)
        refitted = [calibrate(form.plant, [part], tolerance=TOLERANCE) for form in self.forms]
        best = self.forms[0].residuals
        left = [float(np.sqrt(np.mean((f.residuals - best) ** 2))) for f in refitted if f.status.ok]
        return min(left) / self.noise


def _part(experiment: Experiment, readings: Sequence[np.ndarray]) -> Part:
    pairs = zip(experiment.recordings, readings, strict=True)
    return Part.whole(Experiment(recordings=tuple(replace(r, outputs=y[None]) for r, y in pairs)))
