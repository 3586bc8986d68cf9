"""Tables of a check: its operating point, and margins with a row for each linear model that the loop may meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.control.controllers.base import Controller
from deatwin.control.linear.family import LinearFamily
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.stability.bands import MarginBand, stable_probability
from deatwin.control.stability.loops import family_margins
from deatwin.control.stability.margins import Margins

QUANTILE = 0.025  # Quantile over the draws by which margins are judged
BAND = "model, linearised"
"""Source of margins whose lower limits follow from the model's covariance without draws."""
LOWS = {"gain": "gain_low", "phase_deg": "phase_low_deg", "delay": "delay_low", "disk": "disk_low"}
"""Fields of the margins of a row, each with the field of its lower limit."""


@dataclass(frozen=True, kw_only=True)
class OperatingPoint:
    """Operating point at which the model was linearised.

    Parameters
    ----------
    input : float
        Constant input, in its unit.
    output : float or None
        Output at rest, in its unit; None if the model does not settle.
    static_gain : float or None
        Static gain, output unit per input unit; None if the model does not settle.
    status : LinearStatus
        Status of the linear model, which states whether a controller can be designed at this operating point.
    sample_time : float
        Sampling time, s.
    input_unit, output_unit : str
        Units of input and output.
    """

    input: float
    output: float | None
    static_gain: float | None
    status: LinearStatus
    sample_time: float
    input_unit: str
    output_unit: str

    @classmethod
    def of(cls, linear: LinearModel) -> Self:
        """Return the operating point of the model `linear`, which may have any status."""
        settles = linear.operating_output is not None
        return cls(
            input=linear.operating_input,
            output=linear.operating_output,
            static_gain=linear.static_gain if settles else None,
            status=linear.status,
            sample_time=linear.sample_time,
            input_unit=linear.input_unit,
            output_unit=linear.output_unit,
        )


@dataclass(frozen=True, kw_only=True)
class MarginRow:
    """Margins of one loop. A margin is 0 if the loop is unstable, and infinite if no change makes the loop unstable.

    Parameters
    ----------
    source : str
        Linearised system in the loop: ``model``, ``plant``, or the name of another plant. In the row ``model,
        linearised``, the lower limits follow from the parameters' covariance to first order (`band_margins`) instead of
        draws. In rows that end with ``in large motions``, the plant is linearised without friction and hysteresis.
    operating_input : float
        Constant input at the operating point, in the input's unit.
    time : float or None
        Time on the experiment's clock, s; None unless the model varies in time.
    gain, phase_deg, delay, disk, crossover_Hz : float
        Gain margin (factor), phase margin (degrees), delay margin (s), disk margin and crossover frequency (Hz) with
        the estimated parameters.
    gain_low, phase_low_deg, delay_low, disk_low : float
        2.5 % quantiles of these margins over the draws, in the same units; for ``model, linearised`` lower limits of
        the 95 % band.
    stable_share : float
        Share of the draws with a stable loop; 0 if the loop with the estimated parameters is unstable. For ``model,
        linearised``: 1 if all loops in the 95 % band are stable, otherwise the probability of stability to first order.
    samples : int
        Number of draws, including the estimated parameters.
    """

    source: str
    operating_input: float
    time: float | None
    gain: float
    phase_deg: float
    delay: float
    disk: float
    crossover_Hz: float
    gain_low: float
    phase_low_deg: float
    delay_low: float
    disk_low: float
    stable_share: float
    samples: int


def rows_of_family(
    source: str, family: LinearFamily, controller: Controller, times: Sequence[float | None] | None = None
) -> tuple[MarginRow, ...]:
    """Return the margins of a controller over operating points (or times) and draws."""
    rows = []
    for point, operating_input in enumerate(family.operating_inputs):
        found = family_margins(family, point, controller.local(float(operating_input)))
        rows.append(
            _row(source, float(operating_input), None if times is None else times[point], found, family.exists[point])
        )
    return tuple(rows)


def row_of_band(band: MarginBand, linear: LinearModel, crossover_Hz: float) -> MarginRow:
    """Return margins with limits, by linear propagation of the model's covariance; `crossover_Hz` is the highest."""
    return MarginRow(
        source=BAND,
        operating_input=linear.operating_input,
        time=None,
        crossover_Hz=crossover_Hz,
        **{name: getattr(band, name).value for name in LOWS},
        **{low: getattr(band, name).low for name, low in LOWS.items()},
        stable_share=stable_probability(band),
        samples=1,
    )


def _row(
    source: str, operating_input: float, time: float | None, found: Margins, exists: NDArray[np.bool_]
) -> MarginRow:
    stable = found.stable & exists

    def low(values: NDArray[np.float64]) -> float:
        # An order statistic, because interpolation between infinite margins gives NaN.
        worst = np.quantile(np.where(stable, values, 0.0), QUANTILE, method="lower")
        return float(min(worst, values[0] if stable[0] else 0.0))

    return MarginRow(
        source=source,
        operating_input=operating_input,
        time=time,
        crossover_Hz=float(found.crossover[0] / (2 * np.pi)),
        **{name: float(getattr(found, name)[0]) if stable[0] else 0.0 for name in LOWS},
        **{lowest: low(getattr(found, name)) for name, lowest in LOWS.items()},
        stable_share=float(stable.mean()) if stable[0] else 0.0,
        samples=stable.size,
    )
