"""Concealed mechanisms between the command and the film's voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.generator.mechanism import Draw, Drive, Mechanism, PlantMechanism


@dataclass(frozen=True, kw_only=True)
class SlowDipoles(PlantMechanism, place=Place.DRIVE, signal="squared_voltage", largest=0.2):
    """Polarisation V^2 - V sum_k a_k (V - p_k) with tau_k dp_k/dt = V - p_k, of times as broad and lopsided as
    Havriliak and Negami's."""

    share: float = Draw.part()  # Sum of a_k
    centre: float = Draw.log_uniform(5.0, 40.0)  # s

    times: ClassVar[tuple[float, ...]] = (0.1, 0.4, 1.5, 6.0, 30.0)  # Relative to the centre
    parts: ClassVar[tuple[float, ...]] = (0.12, 0.24, 0.32, 0.22, 0.1)  # Parts of the share

    def law(self, signal: Any, build: Any, share: Any, centre: Any) -> Any:
        voltage = build.signal("field_voltage")
        late = ca.SX(0)
        for k, (ratio, weight) in enumerate(zip(self.times, self.parts, strict=True)):
            turned = build.state(f"turned_{k}", scale=1e3)
            build.rate(turned, voltage - turned, mass=centre * ratio)
            late += weight * (voltage - turned)
        return signal - share * voltage * late


@dataclass(frozen=True, kw_only=True)
class SpaceCharge(PlantMechanism, place=Place.DRIVE, signal="field_voltage", largest=0.15):
    r"""Charge that strong fields push into the film: :math:`\tau\dot V_q = bV|V|/V_0 - V_q` with :math:`V_0` = 2 kV."""

    share: float = Draw.part()  # b
    time: float = Draw.log_uniform(10.0, 120.0)  # s

    def law(self, signal: Any, build: Any, share: Any, time: Any) -> Any:
        trapped = build.state("trapped_voltage", scale=100.0)
        build.rate(trapped, share * signal * ca.fabs(signal) / 2e3 - trapped, mass=time)
        return signal - trapped


@dataclass(frozen=True, kw_only=True)
class TrapConduction(PlantMechanism, place=Place.DRIVE, signal="film_voltage", order=1, largest=2e9):
    r"""Conduction out of traps, :math:`j = \sigma E\,e^{\sqrt{E/E_0}}`, whose current drops voltage over a resistance."""

    resistance: float = Draw.part()
    field: float = Draw.uniform(4e6, 8e6)  # E_0, V/m

    conductivity: ClassVar[float] = 2e-14  # At low field, S/m
    settles: ClassVar[float] = 5e-5  # Time in which the voltage settles, s: not seen at 50 samples a second

    def law(self, signal: Any, build: Any, resistance: Any, scale: Any) -> Any:
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
class LadderElectrode(PlantMechanism, place=Place.DRIVE, signal="film_voltage", largest=0.3):
    """An electrode whose resistance is spread: a ladder of two resistances and two halves of the capacitance."""

    time: float = Draw.part()  # Whole resistance times whole capacitance, s

    def law(self, signal: Any, build: Any, time: Any) -> Any:
        near, far = (build.state(f"{name}_voltage", scale=1e3) for name in ("near", "far"))
        build.rate(near, (signal - near) - (near - far), mass=time / 4)
        build.rate(far, near - far, mass=time / 4)
        # The mean of the squares is what pulls.
        return ca.sqrt((near**2 + far**2) / 2 + 1e-6)


@dataclass(frozen=True, kw_only=True)
class CrackedElectrode(PlantMechanism, place=Place.FILM, signal="electrode_share", largest=0.5):
    """A crack that runs round the electrode's rim cuts it off, within a part of a second."""

    share: float = Draw.part()
    at: float = Draw.during(0.2, 0.8)  # When it begins, s
    lasts: float = Draw.uniform(0.05, 0.4)  # s

    def law(self, signal: Any, build: Any, share: Any, at: Any, lasts: Any) -> Any:
        run = ca.fmin(ca.fmax((build.time - at) / lasts, 0.0), 1.0)
        return signal * (1 - share * run**2 * (3 - 2 * run))

    def catalogue_values(self) -> dict[str, float]:
        return {"electrode_loss.share": self.share, "electrode_loss.at": self.at + self.lasts / 2}


@dataclass(frozen=True, kw_only=True)
class RateLimit(PlantMechanism, place=Place.DRIVE, signal="amplifier_voltage", order=1, largest=2e-3):
    """An amplifier whose current limits its rate, sharply; down by another rate than up."""

    slowness: float = Draw.part()  # Upwards, s/V
    ratio: float = Draw.log_uniform(0.2, 1.5)  # Falling rate over rising rate

    width: ClassVar[float] = 5.0  # Lag of the amplifier when it rises at its full rate, V
    fastest: ClassVar[float] = 1e-6
    """No amplifier is quicker than this, s/V; nothing of it is seen at 50 samples a second."""

    def law(self, signal: Any, build: Any, slowness: Any, ratio: Any) -> Any:
        voltage = build.state("limited_voltage", scale=1e3)
        behind = (signal - voltage) / self.width
        build.rate(voltage, ca.fmin(ca.fmax(behind, -ratio), 1.0), mass=slowness + self.fastest)
        return voltage


@dataclass(frozen=True, kw_only=True)
class HardClip(Mechanism, largest=0.5):
    """An output that stops dead at a level."""

    depth: float = Draw.part(0.2, 0.5)  # Share of the command's range that is cut off
    top: float = Draw.by(lambda rng, setting, largest: float(np.abs(setting.commands).max()))  # Ends of that range, V
    bottom: float = Draw.by(lambda rng, setting, largest: float(np.abs(setting.commands).min()))

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        limit = self.top - self.depth * (self.top - self.bottom)
        return replace(drive, commands=np.clip(drive.commands, -limit, limit))


@dataclass(frozen=True, kw_only=True)
class GroundShift(Mechanism, largest=0.1):
    """Two grounds that differ: a voltage is added to every command, at rest too."""

    offset: float = Draw.signed()  # V of the command

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        return replace(drive, commands=drive.commands + self.offset, rest_command=drive.rest_command + self.offset)

    def catalogue_values(self) -> dict[str, float]:
        return {"amplifier_offset.offset": self.offset}


@dataclass(frozen=True, kw_only=True)
class TransportDelay(Mechanism, largest=0.08):
    """Every command begins to act late, at the very instant, whole sample or not."""

    time: float = Draw.part(0.05, 0.2)  # s

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        late = np.concatenate([drive.times[:1], drive.times + self.time])
        first = np.concatenate([[drive.rest_command], drive.commands])
        channels = {name: np.concatenate([values[:1], values]) for name, values in drive.channels.items()}
        return replace(drive, times=late, commands=first, channels=channels)

    def catalogue_values(self) -> dict[str, float]:
        return {"delay.time": self.time}
