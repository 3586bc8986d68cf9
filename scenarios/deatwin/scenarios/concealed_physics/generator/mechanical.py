"""Concealed mechanisms at the ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.generator.mechanism import Draw, PlantMechanism


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
class TurbulentDrag(PlantMechanism, place=Place.BALL, signal="force", largest=10.0):
    r"""Air that is pressed through a gap: :math:`F = -c\,v\,|v|^{3/4}`, as in smooth turbulent flow."""

    coefficient: float = Draw.part()  # c, N (s/m)^1.75

    def law(self, signal: Any, build: Any, coefficient: Any) -> Any:
        velocity = build.signal("velocity")
        return signal - coefficient * velocity * (velocity**2 + 1e-10) ** 0.375


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
class HardeningSpring(PlantMechanism, place=Place.BALL, signal="force", largest=60.0):
    r"""A spring at the ball that hardens: :math:`F = -k\,[a\sinh(y/a) - y]`."""

    reach: float = Draw.by(lambda rng, setting, largest: float(np.max(setting.displacement)) * rng.uniform(0.6, 1.2))
    """The displacement a, m."""
    stiffness: float = Draw.part()  # k, N/m

    def law(self, signal: Any, build: Any, reach: Any, stiffness: Any) -> Any:
        y = build.signal("displacement")
        return signal - stiffness * (reach * ca.sinh(y / reach) - y)


@dataclass(frozen=True, kw_only=True)
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
