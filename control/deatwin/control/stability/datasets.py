"""Margins with their bands and limit cycles as xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.datasets import PARTS, dataset

if TYPE_CHECKING:
    from deatwin.control.stability.bands import MarginBand
    from deatwin.control.stability.limit_cycles import LimitCycles


_MARGINS = {"gain": "", "phase_deg": "deg", "delay": "s", "disk": ""}


def margins_dataset(band: MarginBand) -> Any:
    """Margins along ``margin``, and the loop over frequency."""
    found = [getattr(band, name) for name in _MARGINS]
    response = band.response
    return dataset(
        {
            "value": ("margin", [one.value for one in found], "", "margin of the model itself"),
            "deviation": (
                "margin",
                [one.deviation for one in found],
                "",
                "standard deviation; of the logarithm for gain and disk",
            ),
            "low": ("margin", [one.low for one in found], "", "lower limit"),
            "loop": ("omega", response.values, "", "open loop L"),
            "covariance": (("omega", "part", "other_part"), response.covariance, "", "of the parts of L"),
        },
        {
            "margin": ("margin", list(_MARGINS)),
            "unit": ("margin", list(_MARGINS.values())),
            "omega": ("omega", response.omega, "rad/s"),
            "frequency_Hz": ("omega", response.omega / (2 * np.pi), "Hz"),
            "part": ("part", list(PARTS)),
            "other_part": ("other_part", list(PARTS)),
        },
        {"modulus": band.modulus, "modulus_low": band.modulus_low, "level": band.level, "radius": band.radius},
    )


def cycles_dataset(found: LimitCycles) -> Any:
    """Limit cycles along ``cycle``, the loop over frequency, the describing function over amplitude."""
    return dataset(
        {
            "cycle_amplitude": (
                "cycle",
                np.array([one.amplitude for one in found], dtype=float),
                "",
                "of the sine at the input of the nonlinearity",
            ),
            "cycle_frequency_Hz": ("cycle", np.array([one.frequency_Hz for one in found], dtype=float), "Hz"),
            "cycle_stable": (
                "cycle",
                np.array([one.stable for one in found], dtype=bool),
                "",
                "whether the loop returns to it",
            ),
            "loop": ("omega", found.loop, "", "open loop L"),
            "describing": ("amplitude", found.describing, "", "describing function N"),
        },
        {"omega": ("omega", found.omega, "rad/s"), "amplitude": ("amplitude", found.amplitudes)},
        {"n_cycles": len(found)},
    )
