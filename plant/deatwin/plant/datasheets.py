"""Converters, amplifier and laser of the thesis' rig, with the values in their data sheets."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import real_numbers
from deatwin.plant.errors import DataError

_KINDS = {"int": (Integral, "a whole number"), "float": (Real, "a number"), "str": (str, "text")}


def quantise(values: ArrayLike, step: float) -> NDArray[np.float64]:
    """Return values rounded to the nearest multiple of a step.

    Parameters
    ----------
    values : array_like
        Values in any unit.
    step : float
        Step in the same unit; 0 returns the values unchanged.

    Returns
    -------
    array
        Rounded values, of the same shape. Ties go to the even multiple; NaN stays NaN.

    Raises
    ------
    DataError
        If the step is not a finite number of at least 0, or a value is not a real number.

    Examples
    --------
    >>> quantise([0.26, -0.26, 1.0], 0.5)
    array([ 0.5, -0.5,  1. ])
    """
    width, array = real_numbers(step, "step"), real_numbers(values, "values")
    if width.ndim or not 0.0 <= width < np.inf:
        raise DataError(f"step is {step!r}: it must be a finite number, at least 0")
    return np.rint(array / width) * width if width > 0.0 else array.copy()


@dataclass(frozen=True, kw_only=True)
class Part:
    """Hardware part of a rig, with the origin of its values.

    Parameters
    ----------
    name : str
        Manufacturer and type.
    source : str
        Document that states the values.
    unconfirmed : tuple of str
        Names of the values that no data sheet confirms.

    Raises
    ------
    DataError
        If a value of this or of a derived class has the wrong type, or lies outside its range.
    """

    name: str
    source: str
    unconfirmed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            kind, called = _KINDS.get(str(field.type), (object, ""))
            if not isinstance(value := getattr(self, field.name), kind) or isinstance(value, bool):
                raise DataError(f"{self.name}: {field.name} is {value!r}; it must be {called}")


@dataclass(frozen=True, kw_only=True)
class Converter(Part):
    """Digital-to-analogue or analogue-to-digital converter.

    Parameters
    ----------
    name, source, unconfirmed
        Name and origin; see `Part`.
    bits : int
        Number of bits of the codes, which run from ``-2**(bits - 1)`` to ``2**(bits - 1) - 1``.
    full_scale : float
        Voltage at the ends of the range, V: the codes span ``-full_scale`` to ``full_scale``.
    limit : float
        Largest rated magnitude of the voltage, V.
    noise : float
        Standard deviation of the converter's own noise, V.
    """

    bits: int
    full_scale: float
    limit: float
    noise: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.bits < 1 or not 0.0 < self.limit <= self.full_scale < math.inf or not 0.0 <= self.noise < math.inf:
            raise DataError(
                f"{self.name}: {self.bits} bits, full scale {self.full_scale:g} V, limit {self.limit:g} V, noise "
                f"{self.noise:g} V: need bits >= 1, 0 < limit <= full scale and noise >= 0"
            )

    @property
    def step(self) -> float:
        """Voltage between successive codes, V."""
        return self.full_scale * 2.0 ** (1 - self.bits)

    def convert(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Return `volts` rounded to the nearest code, and clipped to the first and the last code."""
        return np.clip(quantise(volts, self.step), -self.full_scale, self.full_scale - self.step)


@dataclass(frozen=True, kw_only=True)
class Amplifier(Part):
    """High-voltage amplifier, described by its full scale at input and output.

    Parameters
    ----------
    name, source, unconfirmed
        Name and origin; see `Part`.
    input_full_scale : float
        Command that gives the largest output voltage, V.
    output_full_scale : float
        Largest output voltage, V.
    """

    input_full_scale: float
    output_full_scale: float

    def __post_init__(self) -> None:
        super().__post_init__()
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
    """Laser triangulation sensor with an analogue output.

    Parameters
    ----------
    name, source, unconfirmed
        Name and origin; see `Part`.
    reach : float
        Largest measurable displacement to either side of the reference distance, m.
    output_full_scale : float
        Output voltage at this displacement, V.
    noise : float
        Standard deviation of the noise, m. Prefer a value measured on the rig: a data sheet states the repeatability
        after long averaging, which sampling at 50 Hz does not allow.
    resolution : float
        Quantisation step of the displacement that the sensor computes and outputs as a voltage, m.
    linearity : float
        Largest deviation from a straight line, as a share of the whole range (twice the reach). Over a motion of a
        millimetre, this deviation is not noise but a gain error and a slight curvature.
    scan_time : float
        Duration of one exposure, s.
    averages : int
        Number of exposures averaged for each value.
    """

    reach: float
    output_full_scale: float
    noise: float
    resolution: float
    linearity: float
    scan_time: float
    averages: int

    def __post_init__(self) -> None:
        super().__post_init__()
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
        """Age of a value when it is output, in s: time since the middle of the exposures that were averaged."""
        return 0.5 * self.averages * self.scan_time

    @property
    def metres_per_volt(self) -> float:
        """Displacement per volt of the output, m/V."""
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
"""Analogue output: 0.32 mV per code, a quarter of a volt at the film. The thesis' largest command is 3.75 V."""

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
"""Analogue input: 0.31 mV per code, which is 1.22 µm of the laser's range and more than the laser's own noise."""
