"""Concealed mechanisms between the command and the film's voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.mechanisms.base import Drive, Mechanism, PlantMechanism, Setting, log_uniform


@dataclass(frozen=True, kw_only=True)
class SlowDipoles(PlantMechanism):
    r"""Polarisation with a broad, lopsided spread of times, as Havriliak and Negami's function has.

    .. math:: V^2 \to V^2 - V\sum_k a_k(V - p_k), \qquad \tau_k\dot p_k = V - p_k
    """

    share: float  # Sum of :math:`a_k`
    centre: float  # s

    name: ClassVar[str] = "slow_dipoles"
    strength: ClassVar[str] = "share"
    largest: ClassVar[float] = 0.2
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "squared_voltage"
    spread: ClassVar[tuple[tuple[float, float], ...]] = (
        (0.1, 0.12),
        (0.4, 0.24),
        (1.5, 0.32),
        (6.0, 0.22),
        (30.0, 0.1),
    )
    """Time against the centre's, and part of the share."""

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(share=cls.largest * rng.uniform(0.1, 0.3), centre=log_uniform(rng, 5.0, 40.0))

    def rewrite(self, signal: Any, build: Any) -> Any:
        share, centre = self.symbols(build)
        voltage = build.signal("field_voltage")
        late = ca.SX(0)
        for k, (ratio, part) in enumerate(self.spread):
            turned = build.state(f"turned_{k}", scale=1e3)
            build.rate(turned, voltage - turned, mass=centre * ratio)
            late += part * (voltage - turned)
        return signal - share * voltage * late


@dataclass(frozen=True, kw_only=True)
class SpaceCharge(PlantMechanism):
    r"""Charge that strong fields push into the film: :math:`\tau\dot V_q = bV|V|/V_0 - V_q` with :math:`V_0` = 2 kV."""

    share: float  # b
    time: float  # s

    name: ClassVar[str] = "space_charge"
    strength: ClassVar[str] = "share"
    largest: ClassVar[float] = 0.15
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "field_voltage"

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(share=cls.largest * rng.uniform(0.1, 0.3), time=log_uniform(rng, 10.0, 120.0))

    def rewrite(self, signal: Any, build: Any) -> Any:
        share, time = self.symbols(build)
        trapped = build.state("trapped_voltage", scale=100.0)
        build.rate(trapped, share * signal * ca.fabs(signal) / 2e3 - trapped, mass=time)
        return signal - trapped


@dataclass(frozen=True, kw_only=True)
class TrapConduction(PlantMechanism):
    r"""Conduction out of traps, :math:`j = \sigma E\,e^{\sqrt{E/E_0}}`, whose current drops voltage over a resistance."""

    resistance: float
    field: float  # :math:`E_0`, V/m

    name: ClassVar[str] = "trap_conduction"
    strength: ClassVar[str] = "resistance"
    largest: ClassVar[float] = 2e9
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "film_voltage"
    order: ClassVar[int] = 1
    conductivity: ClassVar[float] = 2e-14
    """S/m at low field."""
    settles: ClassVar[float] = 5e-5
    """Time in which the voltage settles, s: not seen at 50 samples a second."""

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(resistance=cls.largest * rng.uniform(0.1, 0.3), field=rng.uniform(4e6, 8e6))

    def rewrite(self, signal: Any, build: Any) -> Any:
        resistance, scale = self.symbols(build)
        left, thickness = build.state("voltage_left", scale=1e3), build.own("thickness")
        current = ca.SX(0)
        for point in (p for p in build.signal("film").points if p.active):
            area = point.stretches[0] * point.stretches[1]
            field = left * area / thickness
            density = self.conductivity * field * ca.exp(ca.sqrt(ca.sqrt(field**2 + 1.0) / scale))
            current += density * area * point.volume / thickness
        build.rate(left, signal - left - resistance * current, mass=self.settles)
        return left


@dataclass(frozen=True, kw_only=True)
class LadderElectrode(PlantMechanism):
    """An electrode whose resistance is spread: a ladder of two resistances and two halves of the capacitance."""

    time: float  # Whole resistance times whole capacitance, s

    name: ClassVar[str] = "ladder_electrode"
    strength: ClassVar[str] = "time"
    largest: ClassVar[float] = 0.3
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "film_voltage"

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(time=cls.largest * rng.uniform(0.1, 0.3))

    def rewrite(self, signal: Any, build: Any) -> Any:
        (time,) = self.symbols(build)
        near, far = (build.state(f"{name}_voltage", scale=1e3) for name in ("near", "far"))
        build.rate(near, (signal - near) - (near - far), mass=time / 4)
        build.rate(far, near - far, mass=time / 4)
        # The mean of the squares is what pulls.
        return ca.sqrt((near**2 + far**2) / 2 + 1e-6)


@dataclass(frozen=True, kw_only=True)
class CrackedElectrode(PlantMechanism):
    """A crack that runs round the electrode's rim cuts it off, within a part of a second."""

    share: float
    at: float  # When it begins, s
    lasts: float  # s

    name: ClassVar[str] = "cracked_electrode"
    strength: ClassVar[str] = "share"
    largest: ClassVar[float] = 0.5
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "electrode_share"

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(
            share=cls.largest * rng.uniform(0.1, 0.3),
            at=setting.seconds * rng.uniform(0.2, 0.8),
            lasts=rng.uniform(0.05, 0.4),
        )

    def rewrite(self, signal: Any, build: Any) -> Any:
        share, at, lasts = self.symbols(build)
        run = ca.fmin(ca.fmax((build.time - at) / lasts, 0.0), 1.0)
        return signal * (1 - share * run**2 * (3 - 2 * run))

    def catalogue_values(self) -> dict[str, float]:
        return {"electrode_loss.share": self.share, "electrode_loss.at": self.at + self.lasts / 2}


@dataclass(frozen=True, kw_only=True)
class RateLimit(PlantMechanism):
    """An amplifier whose current limits its rate, sharply; down by another rate than up."""

    slowness: float  # Upwards, s/V
    ratio: float  # Falling rate over rising rate

    name: ClassVar[str] = "rate_limit"
    strength: ClassVar[str] = "slowness"
    largest: ClassVar[float] = 2e-3
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "amplifier_voltage"
    order: ClassVar[int] = 1
    width: ClassVar[float] = 5.0
    """How far behind the amplifier is when it rises at its full rate, V."""
    fastest: ClassVar[float] = 1e-6
    """No amplifier is quicker than this, s/V; nothing of it is seen at 50 samples a second."""

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(slowness=cls.largest * rng.uniform(0.1, 0.3), ratio=log_uniform(rng, 0.2, 1.5))

    def rewrite(self, signal: Any, build: Any) -> Any:
        slowness, ratio = self.symbols(build)
        voltage = build.state("limited_voltage", scale=1e3)
        behind = (signal - voltage) / self.width
        build.rate(voltage, ca.fmin(ca.fmax(behind, -ratio), 1.0), mass=slowness + self.fastest)
        return voltage


@dataclass(frozen=True, kw_only=True)
class HardClip(Mechanism):
    """An output that stops dead at a level."""

    depth: float  # Share of the command's range that is cut off
    top: float  # Of that range, V
    bottom: float

    name: ClassVar[str] = "hard_clip"
    strength: ClassVar[str] = "depth"
    largest: ClassVar[float] = 0.5

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        size = np.abs(setting.commands)
        return cls(depth=cls.largest * rng.uniform(0.2, 0.5), top=float(size.max()), bottom=float(size.min()))

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        limit = self.top - self.depth * (self.top - self.bottom)
        return replace(drive, commands=np.clip(drive.commands, -limit, limit))


@dataclass(frozen=True, kw_only=True)
class GroundShift(Mechanism):
    """Two grounds that differ: a voltage is added to every command, at rest too."""

    offset: float  # V of the command

    name: ClassVar[str] = "ground_shift"
    strength: ClassVar[str] = "offset"
    largest: ClassVar[float] = 0.1

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(offset=rng.choice([-1.0, 1.0]) * cls.largest * rng.uniform(0.1, 0.3))

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        return replace(drive, commands=drive.commands + self.offset, rest_command=drive.rest_command + self.offset)

    def catalogue_values(self) -> dict[str, float]:
        return {"amplifier_offset.offset": self.offset}


@dataclass(frozen=True, kw_only=True)
class TransportDelay(Mechanism):
    """Every command begins to act late, at the very instant, whole sample or not."""

    time: float  # s

    name: ClassVar[str] = "transport_delay"
    strength: ClassVar[str] = "time"
    largest: ClassVar[float] = 0.08

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(time=cls.largest * rng.uniform(0.05, 0.2))

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        late = np.concatenate([drive.times[:1], drive.times + self.time])
        first = np.concatenate([[drive.rest_command], drive.commands])
        channels = {name: np.concatenate([values[:1], values]) for name, values in drive.channels.items()}
        return replace(drive, times=late, commands=first, channels=channels)

    def catalogue_values(self) -> dict[str, float]:
        return {"delay.time": self.time}
