"""The data sheets of the drive and the sensor: converters, amplifier and laser of the thesis' rig.

Each part carries what its data sheet says and where that stands; `Part.unconfirmed` names the values that were
taken from memory of a data sheet or assumed, because the sheet itself was not at hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.errors import DataError


def quantise(values: ArrayLike, step: float) -> NDArray[np.float64]:
    """Return values rounded to the nearest multiple of a step.

    Parameters
    ----------
    values : array_like
        In any unit.
    step : float
        In the same unit; 0 leaves the values as they are.

    Returns
    -------
    array
        Of the same shape. Halfway cases go to the even multiple; NaN stays.

    Raises
    ------
    DataError
        If the step is negative or not finite.

    Examples
    --------
    >>> quantise([0.26, -0.26, 1.0], 0.5)
    array([ 0.5, -0.5,  1. ])
    """
    if not 0.0 <= step < np.inf:
        raise DataError(f"step {step:g}: it must be a finite number, at least 0")
    array = np.asarray(values, dtype=np.float64)
    return np.rint(array / step) * step if step > 0.0 else array.copy()


@dataclass(frozen=True, kw_only=True)
class Part:
    """A part of the rig with the origin of its values.

    Parameters
    ----------
    name : str
        Maker and type.
    source : str
        Where the values stand.
    unconfirmed : tuple of str
        Names of the values that were not read in a data sheet.
    """

    name: str
    source: str
    unconfirmed: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Converter(Part):
    """Digital to analogue or analogue to digital.

    Parameters
    ----------
    name, source, unconfirmed
        As for every `Part`.
    bits : int
        Of its codes, which are from ``-2**(bits - 1)`` to ``2**(bits - 1) - 1``.
    full_scale : float
        Voltage between which, and its negative, the codes lie, V.
    limit : float
        Largest voltage, of either sign, for which it is rated, V.
    noise : float
        Standard deviation of its own noise, V.
    """

    bits: int
    full_scale: float
    limit: float
    noise: float = 0.0

    def __post_init__(self) -> None:
        if self.bits < 1 or not 0.0 < self.limit <= self.full_scale < math.inf or not self.noise >= 0.0:
            raise DataError(
                f"{self.name}: {self.bits} bits, full scale {self.full_scale:g} V, limit {self.limit:g} V, noise "
                f"{self.noise:g} V: need bits >= 1, 0 < limit <= full scale and noise >= 0"
            )

    @property
    def step(self) -> float:
        """Voltage of one code, V."""
        return self.full_scale * 2.0 ** (1 - self.bits)

    def convert(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Voltages as codes have them: rounded, and clipped to the first and the last.

        Parameters
        ----------
        volts : array_like
            V.

        Returns
        -------
        array
            V, of the same shape.
        """
        return np.clip(quantise(volts, self.step), -self.full_scale, self.full_scale - self.step)


@dataclass(frozen=True, kw_only=True)
class Amplifier(Part):
    """High-voltage amplifier, as far as the thesis describes it: a gain and its ends.

    Parameters
    ----------
    name, source, unconfirmed
        As for every `Part`.
    input_full_scale : float
        Command at which it gives its full output, V.
    output_full_scale : float
        That output, V.
    """

    input_full_scale: float
    output_full_scale: float

    def __post_init__(self) -> None:
        if not (0.0 < self.input_full_scale < math.inf and 0.0 < self.output_full_scale < math.inf):
            raise DataError(
                f"{self.name}: full scale {self.input_full_scale:g} V in, {self.output_full_scale:g} V out: "
                "both must be above 0"
            )

    @property
    def gain(self) -> float:
        """Film volts per command volt."""
        return self.output_full_scale / self.input_full_scale


@dataclass(frozen=True, kw_only=True)
class Laser(Part):
    """Triangulating displacement sensor with an analogue output.

    Parameters
    ----------
    name, source, unconfirmed
        As for every `Part`.
    reach : float
        Displacement from its reference distance, to either side, that it can measure, m. Its analogue output
        goes to `output_full_scale` there.
    output_full_scale : float
        V.
    noise : float
        Standard deviation of its noise, m. A data sheet's repeatability holds after averaging that a record of
        50 Hz leaves no time for: what is measured on the rig is better.
    resolution : float
        Step of its digital value, m.
    linearity : float
        Largest departure from a straight line over the whole range, as a share of that range (twice the reach).
        It is no noise: over the millimetre that a ball moves it acts as a gain error and a slight curvature.
    scan_time : float
        Time of one exposure, s.
    averages : int
        Exposures of which each value is the mean.
    """

    reach: float
    output_full_scale: float
    noise: float
    resolution: float
    linearity: float
    scan_time: float
    averages: int

    def __post_init__(self) -> None:
        magnitudes = (self.noise, self.resolution, self.linearity, self.scan_time)
        ranges = (self.reach, self.output_full_scale)
        if not (all(0.0 < r < math.inf for r in ranges) and all(0.0 <= m < math.inf for m in magnitudes)):
            raise DataError(
                f"{self.name}: reach and output must be above 0; noise, resolution, linearity and scan time at least 0"
            )
        if self.averages < 1:
            raise DataError(f"{self.name}: {self.averages} averages: need at least one")

    @property
    def lag(self) -> float:
        """Age of a value when it appears, s: to the middle of the exposures that it averages."""
        return 0.5 * self.averages * self.scan_time

    @property
    def metres_per_volt(self) -> float:
        """Displacement per volt of its output, m/V."""
        return self.reach / self.output_full_scale


NI_9264 = Converter(
    name="National Instruments NI-9264",
    source="NI-9145 EtherCAT chassis configuration, 'NI-9264 Vendor Configuration Extensions' (ni.com/docs): nominal "
    "range ±10.5 V. Bits and rated ±10 V: NI-9264 data sheet.",
    unconfirmed=("bits", "limit"),
    bits=16,
    full_scale=10.5,
    limit=10.0,
)
"""Analogue output: 0.32 mV a code, a quarter of a volt at the film; the largest command of the thesis is 3.75 V."""

HV_AMPLIFIER = Amplifier(
    name="high-voltage amplifier, type unknown",
    source="W. R. Jacobs' thesis, chapter 2: 12 kV for 15 V. It names no type, so bandwidth, slew rate, current and "
    "polarities are not known.",
    input_full_scale=15.0,
    output_full_scale=12e3,
)

LK_G152 = Laser(
    name="Keyence LK-G152",
    source="W. R. Jacobs' thesis, chapter 2, names the type. Values: Keyence LK-G catalogue; the thesis does not give "
    "the scan time and the averages that were set.",
    unconfirmed=("reach", "output_full_scale", "noise", "resolution", "linearity", "scan_time", "averages"),
    reach=40e-3,
    output_full_scale=10.0,
    noise=0.5e-6,
    resolution=0.1e-6,
    linearity=0.0005,
    scan_time=200e-6,
    averages=16,
)

ANALOGUE_INPUT = Converter(
    name="C Series analogue input in an NI-9144, type unknown",
    source="W. R. Jacobs' thesis, chapter 2, names the NI-9144, which is an EtherCAT chassis with eight slots and no "
    "converter of its own ('NI 9144 Expansion Chassis Under the Hood', ni.com): 16 bit over ±10 V are assumed.",
    unconfirmed=("bits", "full_scale", "limit", "noise"),
    bits=16,
    full_scale=10.0,
    limit=10.0,
)
"""0.31 mV a code, which is 1.22 µm of the laser: more than the laser's own noise."""
