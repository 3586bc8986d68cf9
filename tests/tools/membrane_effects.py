"""What `membrane_rig` can conceal: effects of deatwin's catalogue by laws of their own, mechanisms that it lacks, and dirt."""

from __future__ import annotations

import zlib

import numpy as np
from membrane_rig import STEP
from scipy.signal import lfilter

EFFECTS: dict[str, type[Effect]] = {}


class Effect:
    """Something concealed; a subclass says where it acts; its keywords are its values, SI."""

    dirt = False

    def __init_subclass__(cls, **values):
        EFFECTS[cls.__name__], cls.values = cls, values

    def __init__(self, seed=0, **given):
        if wrong := set(given) - set(self.values):
            raise SystemExit(f"{self.name} has no {', '.join(sorted(wrong))}; it has {', '.join(self.values)}")
        self.given = self.values | given
        self.rng = np.random.default_rng([seed, zlib.crc32(self.name.encode())])
        for key, value in self.given.items():
            setattr(self, key, value)

    @property
    def name(self):
        return type(self).__name__

    def film(self):
        return {}

    def amplifier(self, t, volts):
        return volts

    def prepare(self, film):
        pass

    def lead(self, volts, film):
        return volts

    def material(self, t, film):
        pass

    def ball(self, x, v, t):
        return 0.0

    def accept(self, x, v):
        pass

    def reading(self, t, y):
        return y

    def clock(self, t):
        return t

    def loudness(self, command):
        return 1.0

    def wander(self, n, step, time):
        """A first-order process of deviation 1."""
        keep = np.exp(-step / time)
        first = self.rng.normal()
        return lfilter([np.sqrt(1 - keep**2)], [1, -keep], self.rng.normal(size=n), zi=[keep * first])[0]


class Dirt(Effect):
    """What an ordinary laboratory adds."""

    dirt = True


EFFECTS.clear()


def made(text, seed):
    """The effect of ``name:key=value,key=value``."""
    name, _, rest = text.partition(":")
    if name not in EFFECTS:
        raise SystemExit(f"no effect {name}; known: {', '.join(EFFECTS)}")
    return EFFECTS[name](seed, **{k: float(v) for k, v in (pair.split("=") for pair in rest.split(",") if pair)})


def settled(t, time):
    """Share of a change that has come after time 0."""
    return -np.expm1(-np.maximum(t, 0.0) / time)


# The film.


class creep(Effect, modulus=50e3, time=50.0):
    """A second Maxwell branch at every point."""

    def film(self):
        return {"mu2": self.modulus, "tau2": self.time}


class prestretch_relaxation(Effect, share=0.05, time=100.0):
    """The network at rest loses a share of its modulus, as fast as a power of time (1 + t/time)^-1."""

    def material(self, t, film):
        film.mu = film.mu * (1 - self.share * (1 - 1 / (1 + max(t, 0.0) / self.time)))


class mullins(Effect, share=0.2, width=8.0):
    """Softening of Ogden and Roxburgh: the further a point is below its largest stretch so far, the softer it is."""

    def prepare(self, film):
        self.largest = 0.0

    def material(self, t, film):
        now = film.q1 + film.q2
        self.largest = np.maximum(self.largest, now)
        film.mu = film.mu * (1 - self.share * np.tanh((self.largest - now) / self.width))


class strain_stiffening(Effect, share=0.3, limit=50.0):
    """A second network of shorter chains."""

    def prepare(self, film):
        film.second = (self.share, self.limit)


class permittivity_drift(Effect, relative_change=0.1, time=150.0):
    def material(self, t, film):
        film.eps = film.eps * (1 + self.relative_change * settled(t, self.time))


class permittivity_stretch(Effect, slope=-0.2):
    """Permittivity linear in the area, with the electrostriction that follows."""

    def prepare(self, film):
        film.bend = self.slope


class thermal_stiffness(Effect, share=0.05, period=120.0, phase=0.0):
    """All moduli of the network follow a temperature that swings."""

    def material(self, t, film):
        film.mu = film.mu * (
            1 + self.share * (np.sin(2 * np.pi * t / self.period + self.phase) if t > 0 else np.sin(self.phase))
        )


# Amplifier and electrode.


class delay(Effect, time=0.06):
    """The command acts later."""

    def amplifier(self, t, volts):
        whole, part = divmod(self.time / STEP, 1)
        late = np.concatenate([np.zeros(int(whole) + 1), volts])
        return (1 - part) * late[1 : 1 + len(volts)] + part * late[: len(volts)]


class amplifier_gain(Effect, relative_change=-0.03, time=150.0):
    def amplifier(self, t, volts):
        return volts * (1 + self.relative_change * settled(t, self.time))


class amplifier_offset(Effect, volts=40.0):
    """Volts that the film sees beside the command's, from the start on."""

    def amplifier(self, t, volts):
        return volts + self.volts


class amplifier_saturation(Effect, limit=2700.0, sharpness=24.0):
    def amplifier(self, t, volts):
        return volts / (1 + (volts / self.limit) ** self.sharpness) ** (1 / self.sharpness)


class amplifier_slew(Effect, up=4000.0, down=4000.0):
    def amplifier(self, t, volts):
        out, now = np.empty_like(volts), 0.0
        for k, wanted in enumerate(volts):
            now += min(max(wanted - now, -self.down * STEP), self.up * STEP)
            out[k] = now
        return out


class electrode_rc(Effect, time=0.1):
    """Series resistance before the film's capacitance; `time` is that of the flat film."""

    now = 0.0

    def lead(self, volts, film):
        if self.time == 0:
            return volts
        self.now += (volts - self.now) * -np.expm1(-STEP / (self.time * film.capacitance()))
        return self.now


class leakage(Effect, resistance=3e9, conductivity=3.23e-14, field=40e6):
    """Conduction that grows with the field, through a series resistance."""

    def lead(self, volts, film):
        stretch = np.sqrt(film.q1 * film.q2)[film.under] / film.thickness
        areas = film.volume[film.under] * stretch
        now = volts
        for _ in range(8):
            flow, slope = (
                self.resistance * self.conductivity * areas @ (stretch * np.exp(now * stretch / self.field) * part)
                for part in (now, 1 + now * stretch / self.field)
            )
            now -= (now + flow - volts) / (1 + slope)
        return now


class electrode_loss(Effect, at=120.0, share_left=0.3):
    """The outer ring, a quarter of the radius, keeps a share of its permittivity."""

    def material(self, t, film):
        if t >= self.at:
            film.eps = np.where(film.radius > 0.75 * film.electrode, self.share_left, 1.0) * film.eps


class dielectric_absorption(Effect, share=0.1, time=20.0):
    slow = 0.0

    def lead(self, volts, film):
        self.slow += (self.share * volts - self.slow) * -np.expm1(-STEP / self.time)
        return np.sqrt(volts * (volts + self.slow))


class charge_injection(Effect, share=0.05, time=60.0):
    charge = 0.0

    def lead(self, volts, film):
        self.charge += (self.share * volts - self.charge) * -np.expm1(-STEP / self.time)
        return volts - self.charge


# The ball.


class hysteresis(Effect, force=3e-3, distance=50e-6):
    """Dahl's friction, exact over a step."""

    kept = at = 0.0

    def ball(self, x, v, t):
        way = x - self.at
        end = np.copysign(self.force, way)
        return end + (self.kept - end) * np.exp(-abs(way) / self.distance)

    def accept(self, x, v):
        self.kept, self.at = self.ball(x, v, 0.0), x


class coulomb_friction(Effect, force=1e-3, distance=5e-6):
    """An elastic contact that slips at a force (Jenkins)."""

    kept = at = 0.0

    def ball(self, x, v, t):
        return min(max(self.kept + self.force / self.distance * (x - self.at), -self.force), self.force)

    def accept(self, x, v):
        self.kept, self.at = self.ball(x, v, 0.0), x


class stick_slip(coulomb_friction, force=2e-3, distance=5e-6, share=0.6, speed=1e-4):
    """The same, with a limit that falls to a share while it slips faster than a speed."""

    slips = False

    def ball(self, x, v, t):
        limit = self.force * (self.share if self.slips else 1.0)
        return min(max(self.kept + self.force / self.distance * (x - self.at), -limit), limit)

    def accept(self, x, v):
        super().accept(x, v)
        self.slips = abs(v) > self.speed and abs(self.kept) >= self.force * self.share


class quadratic_damping(Effect, coefficient=2.0):
    def ball(self, x, v, t):
        return self.coefficient * v * abs(v)


class end_stop(Effect, at=300e-6, stiffness=60.0):
    """Contact of Hertz: force grows with the power 1.5 of the depth; `stiffness` is that at 50 µm."""

    def ball(self, x, v, t):
        return self.stiffness * 50e-6 * (max(x - self.at, 0.0) / 50e-6) ** 1.5


class cubic_stiffness(Effect, coefficient=5e7):
    def ball(self, x, v, t):
        return self.coefficient * x**3


class resonance(Effect, mass=2e-4, frequency=6.0, damping_ratio=0.05):
    """A mass that hangs on the ball by a spring."""

    q = p = b = 0.0

    def follow(self, x):
        """Its place by Newmark, as the ball's."""
        w, push = 2 * np.pi * self.frequency, 4 / STEP**2
        drag = 2 * w * self.damping_ratio
        start = self.q + STEP * self.p + STEP**2 / 4 * self.b
        slip = self.p + STEP / 2 * self.b - 2 / STEP * start
        q = (push * start - drag * slip + w * w * x) / (push + 2 * drag / STEP + w * w)
        return q, (q - start) * push

    def ball(self, x, v, t):
        return self.mass * self.follow(x)[1]

    def accept(self, x, v):
        q, b = self.follow(x)
        self.q, self.p, self.b = q, self.p + STEP / 2 * (self.b + b), b


class periodic_disturbance(Effect, force=0.0, reading_size=0.0, frequency=6.3, phase=0.0):
    def ball(self, x, v, t):
        return -self.force * np.sin(2 * np.pi * self.frequency * t + self.phase)

    def reading(self, t, y):
        return y + self.reading_size * np.sin(2 * np.pi * self.frequency * t + self.phase)


# The sensor.


class sensor_lag(Effect, time=0.03):
    def reading(self, t, y):
        keep = np.exp(-STEP / self.time) if self.time else 0.0
        return lfilter([1 - keep], [1, -keep], y)


class camera_delay(Effect, time=0.05):
    """The reading, not the command, is late."""

    def reading(self, t, y):
        return np.interp(t - self.time, t, y)


class sensor_drift(Effect, change=50e-6, time=150.0):
    def reading(self, t, y):
        return y + self.change * settled(t, self.time)


class sensor_jump(Effect, change=10e-6, at=100.0):
    def reading(self, t, y):
        return y + self.change * (t >= self.at)


class sensor_curvature(Effect, coefficient=300.0):
    def reading(self, t, y):
        return y + self.coefficient * y**2


class sensor_saturation(Effect, limit=300e-6):
    def reading(self, t, y):
        return np.minimum(y, self.limit)


# Mechanisms that the catalogue lacks.


class stiffening_with_cycles(Effect, share=0.03, way=0.02):
    """The film hardens with the way that its ball has gone."""

    gone = last = 0.0

    def material(self, t, film):
        film.mu = film.mu * (1 - self.share * np.expm1(-self.gone / self.way))

    def accept(self, x, v):
        self.gone, self.last = self.gone + abs(x - self.last), x


class slipping_clamp(Effect, slip=50e-6, at=60.0, every=90.0, times=3.0):
    """The film's edge slips inwards at times."""

    def prepare(self, film):
        self.edge = film.r[-1]

    def material(self, t, film):
        film.r[-1] = self.edge - self.slip * min(max(np.floor((t - self.at) / self.every) + 1, 0), self.times)


class voltage_viscosity(Effect, share=2.0):
    """The first branch flows faster under voltage."""

    def material(self, t, film):
        film.tau = film.tau / (1 + self.share * (film.volts / 2000.0) ** 2 * np.array([[1.0], [0.0]]))


class pump(Effect, force=1e-4, frequency=0.7, wander=0.1):
    """A sawtooth of force whose pace wanders."""

    turn = 0.0

    def accept(self, x, v):
        if not hasattr(self, "pace"):
            self.pace, self.k = self.wander_of(), 0
        self.turn = (self.turn + STEP * self.frequency * (1 + self.wander * self.pace[self.k % len(self.pace)])) % 1.0
        self.k += 1

    def wander_of(self):
        return Effect.wander(self, 200_000, STEP, 5.0)

    def ball(self, x, v, t):
        return -self.force * (self.turn - 0.5)


class healing_electrode(Effect, at=100.0, back=115.0, share_left=0.5):
    """The outer ring of the electrode fails and heals."""

    def material(self, t, film):
        if self.at <= t < self.back:
            film.eps = np.where(film.radius > 0.75 * film.electrode, self.share_left, 1.0) * film.eps


class random_permittivity(Effect, share=0.01, time=10.0):
    def prepare(self, film):
        self.path, self.k = self.wander(200_000, STEP, self.time), 0

    def material(self, t, film):
        film.eps, self.k = film.eps * (1 + self.share * self.path[self.k % len(self.path)]), self.k + 1


# Dirt of an ordinary laboratory.


class thermal_wander(Dirt, size=0.3e-6, time=60.0):
    def reading(self, t, y):
        return y + self.size * self.wander(len(y), STEP, self.time)


class gain_wander(Dirt, share=0.01, time=20.0):
    def reading(self, t, y):
        return y * (1 + self.share * self.wander(len(y), STEP, self.time))


class clock_jitter(Dirt, size=0.002):
    def clock(self, t):
        return t + self.size * self.rng.normal(size=len(t))


class late_readings(Dirt, time=0.002):
    def clock(self, t):
        return t - self.time


class growing_noise(Dirt, share=1.0):
    """Noise that grows with the command, by a share at 3.75 V."""

    def loudness(self, command):
        return 1 + self.share * command / 3.75
