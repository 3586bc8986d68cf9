"""Loop gains over frequency at the operating point: of the model, with its band, and of the plants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.app.check_report.view import View
from deatwin.control.controllers.base import Controller
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.narx import linearise
from deatwin.control.linear.plant import linearise_plant
from deatwin.control.stability.bands import MarginBand, band_margins

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_POINTS = 400  # points of each half of the grid, one logarithmic and one even, to resolve a narrow resonance
_LOWEST = 0.05  # lowest frequency, as a share of the closed loop's bandwidth


@dataclass(frozen=True, kw_only=True, eq=False)
class Loops:
    """Loop gains at the controller's operating point."""

    frequency_Hz: Array  # shape (n,): Hz
    values: dict[str, Complex]  # shape (n,): Loop gains of the model and of each plant that has a state of rest there
    band: MarginBand | None  # Margins of the model's loop, from the model's covariance; None if the loop is unstable

    @classmethod
    def of(cls, view: View, controller: Controller) -> Loops:
        """Compute the loop gains."""
        at, reading = controller.operating_input, view.plants["plant"].rig.reading
        models = {"model": linearise(view.model, at).in_loop(reading)}
        for name, plant in view.plants.items():
            linear = linearise_plant(plant, at)
            if linear.operating_output is not None:
                models[name] = linear.in_loop(plant.rig.reading)
        h = controller.sample_time
        lowest, highest = _LOWEST / (2 * np.pi * controller.closed_loop_time), 0.5 / h
        frequency = np.union1d(np.geomspace(lowest, highest, _POINTS), np.linspace(lowest, highest, _POINTS)).clip(
            max=highest
        )
        law = controller.local(at).feedback_response(2 * np.pi * frequency, h)
        values = {name: np.asarray(law * m.response(2 * np.pi * frequency)) for name, m in models.items()}
        stable = view.check.margins is not None and view.check.margins.phase_deg > 0.0
        return cls(frequency_Hz=frequency, values=values, band=_band(models["model"], controller) if stable else None)


def _band(linear: LinearModel, controller: Controller) -> MarginBand:
    numerator, denominator = controller.local(controller.operating_input).feedback
    return band_margins(linear, numerator, denominator)
