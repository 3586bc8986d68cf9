"""The concealed mechanisms: of the film, between the command and its voltage, at the ball, of the sensor, and those that no effect describes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.generator.mechanism import Draw, Drive, Mechanism, PlantMechanism, Reading


def _invariant(first: float, second: float) -> float:
    """Return the first invariant of an incompressible film."""
    return first**2 + second**2 + (first * second) ** -2


def _decades(time: Any, first: Any) -> Any:
    """Return the decades of time since clock 0, counted from the time `first`."""
    return ca.log10(1 + ca.fmax(time, 0.0) / first)


class PowerLawCreep(PlantMechanism, place=Place.FILM, signal="film", largest=60e3):
    r"""Creep in the area of the film whose relaxation follows a power law of time."""

    modulus: float = Draw.part()  # Sum of :math:`\mu w_k`, Pa
    exponent: float = Draw.uniform(0.0, 0.3)  # n
    fastest: float = Draw.uniform(2.0, 6.0)  # Shortest time, s

    ratios: ClassVar[tuple[float, ...]] = (1.0, 3.2, 10.0, 32.0)

    def law(self, signal: Any, build: Any, modulus: Any, exponent: Any, fastest: Any) -> Any:
        total = sum(ratio**-exponent for ratio in self.ratios)
        energy = ca.SX(0)
        for number, point in enumerate(signal.points):
            area = ca.log(point.stretches[0] * point.stretches[1])
            for k, ratio in enumerate(self.ratios):
                flowed = build.state(f"flowed_area_{number}_{k}", scale=0.1)
                build.guess(flowed, np.log(np.prod(signal.prestretches)))
                build.rate(flowed, area - flowed, mass=fastest * ratio)
                energy += 1.5 * modulus * ratio**-exponent / total * point.volume * (area - flowed) ** 2
        return replace(signal, relaxing=signal.relaxing + energy)


class LogarithmicRelaxation(PlantMechanism, place=Place.FILM, signal="film", rank=2, largest=0.08):
    """The film's tension falls by the same share in each decade of time."""

    loss: float = Draw.part()  # Share for each decade
    first: float = Draw.uniform(10.0, 60.0)  # Where the first decade begins, s

    def law(self, signal: Any, build: Any, loss: Any, first: Any) -> Any:
        return replace(signal, elastic=(1 - loss * _decades(build.time, first)) * signal.elastic)


class ChainDamage(PlantMechanism, place=Place.FILM, signal="film", rank=1, largest=0.15):
    r"""Damage at each point by the largest energy it has held: :math:`d = d_\infty(1 - e^{-(\hat w - w_0)/m})`."""

    damage: float = Draw.part()  # :math:`d_\\infty`, share of the network's stress
    energy: float = Draw.log_uniform(2e3, 2e4)  # m, J/m³

    def law(self, signal: Any, build: Any, damage: Any, scale: Any) -> Any:
        modulus, lost = build.parameter("shear_modulus"), ca.SX(0)
        for number, point in enumerate(signal.points):
            first, second = point.stretches
            density = modulus / 2 * (first**2 + second**2 + 1 / (first * second) ** 2 - 3)
            largest = build.state(f"largest_energy_{number}", scale=1e5, start=density)
            build.guess(largest, build.own("shear_modulus") / 2 * (_invariant(*signal.prestretches) - 3))
            # Only upwards, within a few milliseconds.
            build.rate(largest, ca.fmax(density - largest, 0.0), mass=4e-3)
            beyond = ca.fmax(largest - build.at_rest(f"energy_at_rest_{number}", density), 0.0)
            lost += damage * (1 - ca.exp(-beyond / scale)) * point.volume * density
        return replace(signal, elastic=signal.elastic - lost)


class ExponentialStiffening(PlantMechanism, place=Place.FILM, signal="film", largest=10e3):
    r"""Fibres that stiffen exponentially: :math:`\frac{\mu}{2b}(e^{bx} - 1 - bx)` in :math:`x = I_1 - I_1^p`."""

    modulus: float = Draw.part()  # Pa
    exponent: float = Draw.uniform(0.05, 0.2)  # b

    def law(self, signal: Any, build: Any, modulus: Any, b: Any) -> Any:
        mounted = build.constant("mounted_invariant", _invariant(*signal.prestretches))

        def density(first: Any, second: Any) -> Any:
            x = first**2 + second**2 + 1 / (first * second) ** 2 - mounted
            return modulus / (2 * b) * (ca.exp(b * x) - 1 - b * x)

        return replace(signal, elastic=signal.elastic + sum(p.volume * density(*p.stretches) for p in signal.points))


class AgeingPermittivity(PlantMechanism, place=Place.PARAMETER, signal="permittivity", largest=0.12):
    """The permittivity changes by the same share in each decade of time."""

    change: float = Draw.signed()  # Share for each decade
    first: float = Draw.uniform(10.0, 60.0)  # Where the first decade begins, s

    def law(self, signal: Any, build: Any, change: Any, first: Any) -> Any:
        return signal * (1 + change * _decades(build.time, first))


class DilutedPermittivity(PlantMechanism, place=Place.FILM, signal="film", largest=0.3):
    r"""Dipoles that the stretch dilutes: :math:`\varepsilon \propto (\lambda_1\lambda_2)^{-c}` from the prestretch on."""

    exponent: float = Draw.part()  # c

    def law(self, signal: Any, build: Any, exponent: Any) -> Any:
        mounted = build.constant("mounted_area", np.prod(signal.prestretches))
        pairs = zip(signal.points, signal.capacitances, strict=True)
        diluted = [c * (p.stretches[0] * p.stretches[1] / mounted) ** -exponent if p.active else c for p, c in pairs]
        return replace(signal, capacitances=diluted)


class SlowDipoles(PlantMechanism, place=Place.DRIVE, signal="squared_voltage", largest=0.2):
    """Polarisation V^2 - V sum_k a_k (V - p_k), tau_k dp_k/dt = V - p_k, with Havriliak and Negami's times."""

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


class SpaceCharge(PlantMechanism, place=Place.DRIVE, signal="field_voltage", largest=0.15):
    r"""Charge that strong fields push into the film: :math:`\tau\dot V_q = bV|V|/V_0 - V_q` with :math:`V_0` = 2 kV."""

    share: float = Draw.part()  # b
    time: float = Draw.log_uniform(10.0, 120.0)  # s

    def law(self, signal: Any, build: Any, share: Any, time: Any) -> Any:
        trapped = build.state("trapped_voltage", scale=100.0)
        build.rate(trapped, share * signal * ca.fabs(signal) / 2e3 - trapped, mass=time)
        return signal - trapped


class TrapConduction(PlantMechanism, place=Place.DRIVE, signal="film_voltage", rank=1, largest=2e9):
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


class LadderElectrode(PlantMechanism, place=Place.DRIVE, signal="film_voltage", largest=0.3):
    """An electrode whose resistance is spread: a ladder of two resistances and two halves of the capacitance."""

    time: float = Draw.part()  # Whole resistance times whole capacitance, s

    def law(self, signal: Any, build: Any, time: Any) -> Any:
        near, far = (build.state(f"{name}_voltage", scale=1e3) for name in ("near", "far"))
        build.rate(near, (signal - near) - (near - far), mass=time / 4)
        build.rate(far, near - far, mass=time / 4)
        # The mean of the squares is what pulls.
        return ca.sqrt((near**2 + far**2) / 2 + 1e-6)


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


class RateLimit(PlantMechanism, place=Place.DRIVE, signal="amplifier_voltage", rank=1, largest=2e-3):
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


class HardClip(Mechanism, largest=0.5):
    """An output that stops dead at a level."""

    depth: float = Draw.part(0.2, 0.5)  # Share of the command's range that is cut off
    top: float = Draw.by(lambda rng, setting, largest: float(np.abs(setting.commands).max()))  # Ends of that range, V
    bottom: float = Draw.by(lambda rng, setting, largest: float(np.abs(setting.commands).min()))

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        limit = self.top - self.depth * (self.top - self.bottom)
        return replace(drive, commands=np.clip(drive.commands, -limit, limit))


class GroundShift(Mechanism, largest=0.1):
    """Two grounds that differ: a voltage is added to every command, at rest too."""

    offset: float = Draw.signed()  # V of the command

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        return replace(drive, commands=drive.commands + self.offset, rest_command=drive.rest_command + self.offset)

    def catalogue_values(self) -> dict[str, float]:
        return {"amplifier_offset.offset": self.offset}


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


class StopOperators(PlantMechanism, place=Place.BALL, signal="force", largest=3e-3):
    """Prandtl and Ishlinskii's hysteresis, F = -sum_k F_h/(5 r_k) sigma_k, by five elements that slip at r_k:
    d(sigma_k)/dt = v while |sigma_k| < r_k or v sigma_k < 0, else 0."""

    widest: float = Draw.by(lambda rng, setting, largest: float(np.ptp(setting.displacement)) * rng.uniform(0.1, 0.3))
    """Largest r_k, m; the smallest is an eighth of it."""
    force: float = Draw.part()  # F_h, N

    ratios: ClassVar[tuple[float, ...]] = (0.125, 0.21, 0.354, 0.595, 1.0)

    def law(self, signal: Any, build: Any, widest: Any, force: Any) -> Any:
        velocity, held = build.signal("velocity"), ca.SX(0)
        for k, ratio in enumerate(self.ratios):
            share = build.state(f"stop_{k}", scale=10.0, start=0.0)
            near = ca.fmin(ca.fmax((ca.fabs(share) - 0.95) / 0.05, 0.0), 1.0)
            free = ca.if_else(velocity * share < 0, 1.0, 1 - near)
            build.rate(share, velocity * free, mass=widest * ratio)
            held += share / len(self.ratios)
        return signal - force * held


class BristleFriction(PlantMechanism, place=Place.BALL, signal="force", largest=3e-3):
    """LuGre friction -(sigma_0 z + sigma_1 dz/dt), dz/dt = v - sigma_0 |v| z/g(v), g = F_c [1 + 0.25 exp(-(v/v_s)^2)]
    (Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995) 419)."""

    force: float = Draw.part()  # F_c, N
    bend: float = Draw.uniform(1e-6, 4e-6)  # F_c/sigma_0, m

    damping: ClassVar[float] = 50.0

    def law(self, signal: Any, build: Any, force: Any, bend: Any) -> Any:
        velocity = build.signal("velocity")
        share = build.state("bristles", scale=50.0, start=0.0)  # a percent of friction is no error
        grip = 1 + 0.25 * ca.exp(-((velocity / 1e-3) ** 2))
        bending = velocity - ca.fabs(velocity) * share / grip
        build.rate(share, bending, mass=bend)
        return signal - force * (share + self.damping * bending)


class TurbulentDrag(PlantMechanism, place=Place.BALL, signal="force", largest=10.0):
    r"""Air that is pressed through a gap: :math:`F = -c\,v\,|v|^{3/4}`, as in smooth turbulent flow."""

    coefficient: float = Draw.part()  # c, N (s/m)^1.75

    def law(self, signal: Any, build: Any, coefficient: Any) -> Any:
        velocity = build.signal("velocity")
        return signal - coefficient * velocity * (velocity**2 + 1e-10) ** 0.375


class RoundedStop(PlantMechanism, place=Place.BALL, signal="force", largest=1e5):
    r"""A round stop that is pressed in: Hertz' :math:`kd^{3/2}`, damped with the depth."""

    position: float = Draw.by(
        lambda rng, setting, largest: float(np.quantile(setting.displacement, rng.uniform(0.6, 0.85)))
    )
    """Displacement at the first touch, m."""
    stiffness: float = Draw.part(0.02, 0.1)  # k, N/m^1.5

    def law(self, signal: Any, build: Any, position: Any, stiffness: Any) -> Any:
        depth = ca.fmax(build.signal("displacement") - position, 0.0)
        damped = ca.fmin(ca.fmax(1 + 30.0 * build.signal("velocity"), 0.0), 3.0)
        return signal - stiffness * depth * ca.sqrt(depth + 1e-9) * damped


class HardeningSpring(PlantMechanism, place=Place.BALL, signal="force", largest=60.0):
    r"""A spring at the ball that hardens: :math:`F = -k\,[a\sinh(y/a) - y]`."""

    reach: float = Draw.by(lambda rng, setting, largest: float(np.max(setting.displacement)) * rng.uniform(0.6, 1.2))
    """The displacement a, m."""
    stiffness: float = Draw.part()  # k, N/m

    def law(self, signal: Any, build: Any, reach: Any, stiffness: Any) -> Any:
        y = build.signal("displacement")
        return signal - stiffness * (reach * ca.sinh(y / reach) - y)


class TwinModes(PlantMechanism, place=Place.BALL, signal="force", largest=1e-3):
    """Two equal masses on springs at the ball, tuned a tenth apart: a split mode of a holder."""

    mass: float = Draw.part()
    frequency: float = Draw.uniform(4.0, 12.0)  # Frequency of the lower mode, Hz
    damping_ratio: float = Draw.uniform(0.01, 0.04)

    def law(self, signal: Any, build: Any, mass: Any, frequency: Any, ratio: Any) -> Any:
        for number, tuned in enumerate((1.0, 1.1)):
            stretch = build.state(f"spring_{number}", scale=1e-3, start=0.0)
            speed = build.state(f"mass_speed_{number}", scale=0.05, start=0.0)
            omega = 2 * np.pi * frequency * tuned
            pull = omega**2 * stretch + 2 * ratio * omega * (speed - build.signal("velocity"))
            build.rate(stretch, speed - build.signal("velocity"))
            build.rate(speed, -pull)
            signal = signal + mass / 2 * pull
        return signal


class SecondOrderSensor(PlantMechanism, place=Place.SENSOR, signal="reading", rank=20, largest=0.05):
    r"""A filter of second order: :math:`T^2\ddot r + 2\zeta T\dot r + r = y`."""

    time: float = Draw.part()  # T, s
    damping_ratio: float = Draw.uniform(0.6, 1.0)  # :math:`\zeta`

    def law(self, signal: Any, build: Any, time: Any, ratio: Any) -> Any:
        shown = build.state("shown", scale=1e-3)
        rising = build.state("rising", scale=1e-3)  # T times the rate of what is shown
        build.rate(shown, rising, mass=time)
        build.rate(rising, signal - shown - 2 * ratio * rising, mass=time)
        return shown


class WarmingSensor(Mechanism, largest=1e-4):
    """The zero moves by the same way in each decade of time."""

    change: float = Draw.signed()
    first: float = Draw.uniform(10.0, 60.0)  # Where the first decade begins, s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values + self.change * np.log10(1 + np.maximum(reading.times, 0.0) / self.first)


class KnockedSensor(Mechanism, largest=1e-4):
    """A knock shifts all further readings, from one sample to the next; a fifth of it goes back within a second."""

    at: float = Draw.during(0.2, 0.8)  # s
    change: float = Draw.signed()  # Lasting part, m

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        since = np.maximum(reading.times - self.at, 0.0)
        return reading.values + (reading.times >= self.at) * self.change * (1 + 0.25 * np.exp(-since / 0.5))

    def catalogue_values(self) -> dict[str, float]:
        return {"sensor_jump.change": self.change, "sensor_jump.at": self.at}


class CrookedOptics(Mechanism, largest=200.0):
    r"""Triangulation that was not made straight: :math:`r = y/(1 - \kappa y)`."""

    curvature: float = Draw.signed()  # :math:`\kappa`, 1/m

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values / (1 - self.curvature * reading.values)


class HardCeiling(Mechanism, largest=0.5):
    """A reading that stops dead at a level."""

    depth: float = Draw.part(0.2, 0.5)  # Share of the motion's range that is cut off
    top: float = Draw.by(lambda rng, setting, largest: float(setting.displacement.max()))  # Ends of that range, m
    bottom: float = Draw.by(lambda rng, setting, largest: float(setting.displacement.min()))

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return np.minimum(reading.values, self.top - self.depth * (self.top - self.bottom))


class ThermostatSwing(PlantMechanism, place=Place.FILM, signal="film", rank=2, largest=0.1):
    """A room that is heated on and off: the modulus follows its temperature, up and down exponentially."""

    change: float = Draw.signed()
    period: float = Draw.uniform(25.0, 70.0)  # s
    phase: float = Draw.uniform(0.0, 1.0)  # Share of a period that is over at clock 0

    def law(self, signal: Any, build: Any, change: Any, period: Any, phase: Any) -> Any:

        def warmth(share: Any) -> Any:
            """0 to 1: heated for 0.4 of each period, at a time constant of a fourth of it."""
            at = share - ca.floor(share)
            top, bottom = 1 - np.exp(-1.6), 1 - np.exp(-2.4)
            return ca.if_else(at < 0.4, (1 - ca.exp(-4 * at)) / top, 1 - (1 - ca.exp(-4 * (at - 0.4))) / bottom)

        swing = warmth(ca.fmax(build.time, 0.0) / period + phase) - warmth(phase)
        return replace(signal, elastic=(1 + change * swing) * signal.elastic)


class MainsHum(Mechanism, largest=1e-4):
    """A tone in the reading with a weak second harmonic, whose phase wanders a little."""

    amplitude: float = Draw.part()  # m
    frequency: float = Draw.log_uniform(0.05, 15.0)  # Hz
    phase: float = Draw.uniform(-np.pi, np.pi)  # At clock 0, rad

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        passed = np.diff(reading.times, prepend=reading.times[0])
        wander = np.cumsum(0.01 * np.sqrt(passed) * rng.standard_normal(passed.size))
        angle = 2 * np.pi * self.frequency * reading.times + self.phase + wander
        return reading.values + self.amplitude * (np.cos(angle) + 0.08 * np.cos(2 * angle))

    def catalogue_values(self) -> dict[str, float]:
        return {"periodic_disturbance.amplitude": self.amplitude, "periodic_disturbance.frequency": self.frequency}


def _fading(kept: np.ndarray, pushes: np.ndarray) -> np.ndarray:
    """Sum pushes, x_k = kept_k x_{k-1} + pushes_k, from 0. Shapes: `kept, pushes` (n,); returns (n,)."""
    here, found = 0.0, np.empty(pushes.size)
    for k, (share, push) in enumerate(zip(kept, pushes, strict=True)):
        found[k] = here = share * here + push
    return found


class CrossoverDeadZone(Mechanism, largest=0.4):
    """An amplifier of two halves that leave a gap where one hands over to the other."""

    level: float = Draw.by(
        lambda rng, setting, largest: float(np.quantile(np.abs(setting.commands), rng.uniform(0.4, 0.7)))
    )
    """Centre of the gap, V of the command."""
    width: float = Draw.part()  # Half width of the gap, V

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        beyond = np.abs(drive.commands) - self.level
        passed = self.level + np.sign(beyond) * np.maximum(np.abs(beyond) - self.width, 0.0)
        # Far below the gap the lower half works alone.
        share = np.clip(np.abs(drive.commands) / self.level * 2, 0.0, 1.0)
        size = np.abs(drive.commands) + share * (passed - np.abs(drive.commands))
        return replace(drive, commands=np.sign(drive.commands) * size)


class ChargingHeat(PlantMechanism, place=Place.FILM, signal="film", rank=3, largest=20.0):
    """Charging currents heat the film, each by the square of its step of voltage; the warm film is softer."""

    softening: float = Draw.part()  # Share of the modulus lost for a heat of 1: steps of 1 kV ten times a second
    time: float = Draw.uniform(3.0, 12.0)

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        steps = np.diff(drive.commands, prepend=drive.rest_command)
        passed = np.diff(drive.times, prepend=drive.times[0])
        heat = _fading(np.exp(-passed / self.time), (0.8 * steps) ** 2 / (10.0 * self.time))
        return replace(drive, channels={**drive.channels, "charging_heat": heat})

    def law(self, signal: Any, build: Any, softening: Any, _: Any) -> Any:
        return replace(signal, elastic=signal.elastic / (1 + softening * build.channel("charging_heat", 0.0)))


class GainWander(Mechanism, largest=0.08):
    """The amplifier's gain wanders at random, and comes back within some seconds."""

    deviation: float = Draw.part()  # Standard deviation, as a share
    time: float = Draw.log_uniform(0.5, 6.0)

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        wander = _wandering(drive.times, self.time, rng)
        return replace(drive, commands=drive.commands * (1 + self.deviation * wander))


class InterferenceBursts(Mechanism, largest=3e-4):
    """Short bursts in the reading at random times, each with its own frequency and size."""

    amplitude: float = Draw.part()  # Typical size, m
    apart: float = Draw.uniform(4.0, 12.0)  # Mean time between two, s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        disturbed, time = reading.values.copy(), float(reading.times[0])
        while (time := time + rng.exponential(self.apart)) < reading.times[-1]:
            since = reading.times - time
            size, frequency, phase = rng.exponential(), rng.uniform(2.0, 12.0), rng.uniform(0, 2 * np.pi)
            shape = np.exp(-np.abs(since) / rng.uniform(0.2, 0.8)) * np.cos(2 * np.pi * frequency * since + phase)
            disturbed += self.amplitude * size * np.where(since >= 0, shape, 0.0)
        return disturbed


class OneWayDamper(PlantMechanism, place=Place.BALL, signal="force", largest=3.0):
    """Air that leaves the chamber below the film easily, and comes back through a narrow valve."""

    coefficient: float = Draw.part()  # On the way up, N s/m

    def law(self, signal: Any, build: Any, coefficient: Any) -> Any:
        velocity = build.signal("velocity")
        return signal - coefficient * (velocity - (velocity**2 + 1e-12) ** 0.5) / 2


class CapacitiveCrosstalk(Mechanism, largest=1e-4):
    """Every change of the high voltage couples into the sensor's cable, which forgets it within a second or so."""

    coupling: float = Draw.signed()  # m for a step of one volt of the command
    time: float = Draw.log_uniform(0.1, 1.0)  # s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        kept = np.exp(-np.median(np.diff(reading.times)) / self.time)
        steps = np.diff(reading.commands, prepend=reading.commands[0])
        return reading.values + self.coupling * _fading(np.full(steps.size, kept), steps)


class ClockSkew(Mechanism, largest=2e-3):
    """Two clocks that run apart: commands come later and later against the readings."""

    skew: float = Draw.part()  # s for each s

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        return replace(drive, times=drive.times + self.skew * np.maximum(drive.times, 0.0))


class ThermalWander(Mechanism, largest=0.3e-6):
    """A sensor's zero that follows the air of the room: slow and random."""

    deviation: float = Draw.part(1.0, 1.0)  # m
    time: float = Draw.log_uniform(20.0, 60.0)  # s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values + self.deviation * _wandering(reading.times, self.time, rng)


class TimingJitter(Mechanism, largest=2e-3):
    """Readings that are taken a little early or late, each independently of the others."""

    deviation: float = Draw.part(1.0, 1.0)  # s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        from scipy.interpolate import CubicSpline

        late = self.deviation * rng.standard_normal(reading.times.size)
        return np.asarray(CubicSpline(reading.times, reading.values)(reading.times + late))


class UnsteadyGain(Mechanism, largest=0.01):
    """A sensor's gain that wanders slowly and at random."""

    deviation: float = Draw.part(1.0, 1.0)  # As a share
    time: float = Draw.log_uniform(20.0, 60.0)  # s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values * (1 + self.deviation * _wandering(reading.times, self.time, rng))


def _wandering(times: np.ndarray, correlation: float, rng: np.random.Generator) -> np.ndarray:
    """Draw a stationary first-order process of unit variance. Shapes: `times` (n,); returns (n,)."""
    kept = np.exp(-np.diff(times, prepend=-np.inf) / correlation)
    return _fading(kept, np.sqrt(1 - kept**2) * rng.standard_normal(kept.size))


MECHANISMS: dict[str, type[Mechanism]] = {
    kind.name: kind
    for kind in list(vars().values())
    if isinstance(kind, type) and issubclass(kind, Mechanism) and getattr(kind, "strength", False)
}
