"""Drive and sensor hardware: from the requested command to the applied one, and from the ball to the record.

Slew, clipping, curvature and drift of amplifier and laser are effects, because a diagnosis has to find them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import require_generator
from deatwin.plant.datasheets import (
    ANALOGUE_INPUT,
    HV_AMPLIFIER,
    LK_G152,
    NI_9264,
    Amplifier,
    Converter,
    Laser,
    quantise,
)
from deatwin.plant.errors import DataError


@dataclass(frozen=True, kw_only=True)
class MeasuringChain:
    """Drive and sensor hardware of a rig; by default, the hardware of W. R. Jacobs' thesis as far as it is known.

    Parameters
    ----------
    analogue_output : Converter
        Converter that outputs the commands.
    amplifier : Amplifier
        Amplifier that turns commands into high voltage.
    laser : Laser
        Displacement sensor that points at the ball.
    analogue_input : Converter
        Converter that samples the laser's output.

    Examples
    --------
    >>> chain = MeasuringChain()
    >>> print(f"noise {chain.noise * 1e6:.2f} µm rms, steps of {chain.reading_step * 1e6:.2f} µm")
    noise 0.61 µm rms, steps of 1.22 µm
    """

    analogue_output: Converter = NI_9264
    amplifier: Amplifier = HV_AMPLIFIER
    laser: Laser = LK_G152
    analogue_input: Converter = ANALOGUE_INPUT

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the chain from `data` made by `dataclasses.asdict`; DataError if a part or field is missing."""
        kinds = {"analogue_output": Converter, "amplifier": Amplifier, "laser": Laser, "analogue_input": Converter}
        try:
            parts = {k: kind(**{**data[k], "unconfirmed": tuple(data[k]["unconfirmed"])}) for k, kind in kinds.items()}
        except (KeyError, TypeError) as error:
            raise DataError(f"malformed measuring chain: {error!r}; it needs {', '.join(kinds)}") from None
        return cls(**parts)

    @property
    def command_limit(self) -> float:
        """Largest magnitude of the command for which analogue output and amplifier are rated, V."""
        return min(self.analogue_output.limit, self.amplifier.input_full_scale)

    @property
    def reading_step(self) -> float:
        """Displacement that corresponds to one code of the analogue input, m."""
        return self.analogue_input.step * self.laser.metres_per_volt

    @property
    def noise(self) -> float:
        """Standard deviation of the noise that `record` adds to readings, m.

        The variance is the sum of the variances of the laser's noise, of the analogue input's noise, and of both
        rounding errors. Each rounding error has a twelfth of the squared step as its variance (B. Widrow and I. Kollár,
        "Quantization Noise", Cambridge University Press, 2008). This holds for motion over many steps; at rest, the
        rounding error is constant.
        """
        laser, volts = self.laser, self.analogue_input
        in_volts = volts.noise**2 + volts.step**2 / 12.0
        return math.sqrt(laser.noise**2 + laser.resolution**2 / 12.0 + in_volts * laser.metres_per_volt**2)

    def applied(self, commands: ArrayLike) -> NDArray[np.float64]:
        """Return the commands that reach the amplifier, rounded to the codes of the analogue output.

        Parameters
        ----------
        commands : array_like
            Requested commands, V, of any shape.

        Returns
        -------
        array
            Voltages of the nearest codes, V, of the same shape.

        Raises
        ------
        DataError
            If a command exceeds the rating of analogue output or amplifier, or is not a number.
        """
        wished = np.asarray(commands, dtype=np.float64)
        beyond = ~(np.abs(wished) <= self.command_limit)
        if beyond.any():
            first = int(np.flatnonzero(beyond)[0])
            raise DataError(
                f"command {first}: {wished.flat[first]:g} V; {self.analogue_output.name} and {self.amplifier.name} "
                f"take {-self.command_limit:g} to {self.command_limit:g} V"
            )
        return self.analogue_output.convert(wished)

    def record(self, readings: ArrayLike, rng: np.random.Generator, *, sample_time: float) -> NDArray[np.float64]:
        """Apply lag, range, noise and rounding of laser and analogue input to noise-free readings.

        Parameters
        ----------
        readings : (..., n) array_like
            Displacement from the laser's reference distance at each of n samples, m.
        rng : numpy.random.Generator
            Random generator for the noise of laser and analogue input.
        sample_time : float
            Time between two samples, s.

        Returns
        -------
        (..., n) array
            Recorded readings, m. Displacements beyond the range of laser or analogue input are clipped; NaN stays NaN.

        Raises
        ------
        DataError
            If the sample time is not positive or there are no readings.

        Notes
        -----
        The lag is applied by linear interpolation between samples. Before the first sample, the reading is taken as
        constant. For a sine of 1 Hz, sampled at 50 Hz with a lag of 1.6 ms, the interpolation error is at most 0.06 %
        of the amplitude.
        """
        require_generator(rng)
        given = np.asarray(readings, dtype=np.float64)
        if given.ndim == 0 or given.size == 0 or not 0.0 < sample_time < math.inf:
            raise DataError(
                f"readings of shape {given.shape}, sample time {sample_time:g} s: need readings and a time above 0"
            )
        seen = np.clip(_delayed(given, self.laser.lag / sample_time), -self.laser.reach, self.laser.reach)
        seen = quantise(seen + self.laser.noise * rng.standard_normal(given.shape), self.laser.resolution)
        volts = seen / self.laser.metres_per_volt + self.analogue_input.noise * rng.standard_normal(given.shape)
        return self.analogue_input.convert(volts) * self.laser.metres_per_volt


def _delayed(readings: NDArray[np.float64], samples: float) -> NDArray[np.float64]:
    """Delay rows of readings by a number of samples."""
    now = np.arange(readings.shape[-1], dtype=np.float64)
    before = np.maximum(now - samples, 0.0)
    left, right = np.floor(before).astype(int), np.ceil(before).astype(int)
    share = before - left
    return readings[..., left] * (1.0 - share) + readings[..., right] * share
