"""Concealed mechanisms of the film."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.plant.laws.energies import first_invariant
from deatwin.scenarios.concealed_physics.generator.mechanism import Draw, PlantMechanism


def _decades(time: Any, first: Any) -> Any:
    """Return the decades of time since clock 0, counted from the time `first`."""
    return ca.log10(1 + ca.fmax(time, 0.0) / first)


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
class LogarithmicRelaxation(PlantMechanism, place=Place.FILM, signal="film", order=2, largest=0.08):
    """The film's tension falls by the same share in each decade of time."""

    loss: float = Draw.part()  # Share for each decade
    first: float = Draw.uniform(10.0, 60.0)  # Where the first decade begins, s

    def law(self, signal: Any, build: Any, loss: Any, first: Any) -> Any:
        return replace(signal, elastic=(1 - loss * _decades(build.time, first)) * signal.elastic)


@dataclass(frozen=True, kw_only=True)
class ChainDamage(PlantMechanism, place=Place.FILM, signal="film", order=1, largest=0.15):
    r"""Damage at each point by the largest energy it has held: :math:`d = d_\infty(1 - e^{-(\hat w - w_0)/m})`."""

    damage: float = Draw.part()  # :math:`d_\\infty`, share of the network's stress
    energy: float = Draw.log_uniform(2e3, 2e4)  # m, J/m³

    def law(self, signal: Any, build: Any, damage: Any, scale: Any) -> Any:
        modulus, lost = build.parameter("shear_modulus"), ca.SX(0)
        for number, point in enumerate(signal.points):
            first, second = point.stretches
            density = modulus / 2 * (first**2 + second**2 + 1 / (first * second) ** 2 - 3)
            largest = build.state(f"largest_energy_{number}", scale=1e5, start=density)
            build.guess(largest, build.own("shear_modulus") / 2 * (first_invariant(*signal.prestretches) - 3))
            # Only upwards, within a few milliseconds.
            build.rate(largest, ca.fmax(density - largest, 0.0), mass=4e-3)
            beyond = ca.fmax(largest - build.at_rest(f"energy_at_rest_{number}", density), 0.0)
            lost += damage * (1 - ca.exp(-beyond / scale)) * point.volume * density
        return replace(signal, elastic=signal.elastic - lost)


@dataclass(frozen=True, kw_only=True)
class ExponentialStiffening(PlantMechanism, place=Place.FILM, signal="film", largest=10e3):
    r"""Fibres that stiffen exponentially: :math:`\frac{\mu}{2b}(e^{bx} - 1 - bx)` in :math:`x = I_1 - I_1^p`."""

    modulus: float = Draw.part()  # Pa
    exponent: float = Draw.uniform(0.05, 0.2)  # b

    def law(self, signal: Any, build: Any, modulus: Any, b: Any) -> Any:
        mounted = build.constant("mounted_invariant", first_invariant(*signal.prestretches))

        def density(first: Any, second: Any) -> Any:
            x = first**2 + second**2 + 1 / (first * second) ** 2 - mounted
            return modulus / (2 * b) * (ca.exp(b * x) - 1 - b * x)

        return replace(signal, elastic=signal.elastic + sum(p.volume * density(*p.stretches) for p in signal.points))


@dataclass(frozen=True, kw_only=True)
class AgeingPermittivity(PlantMechanism, place=Place.PARAMETER, signal="permittivity", largest=0.12):
    """The permittivity changes by the same share in each decade of time."""

    change: float = Draw.signed()  # Share for each decade
    first: float = Draw.uniform(10.0, 60.0)  # Where the first decade begins, s

    def law(self, signal: Any, build: Any, change: Any, first: Any) -> Any:
        return signal * (1 + change * _decades(build.time, first))


@dataclass(frozen=True, kw_only=True)
class DilutedPermittivity(PlantMechanism, place=Place.FILM, signal="film", largest=0.3):
    r"""Dipoles that the stretch dilutes: :math:`\varepsilon \propto (\lambda_1\lambda_2)^{-c}` from the prestretch on."""

    exponent: float = Draw.part()  # c

    def law(self, signal: Any, build: Any, exponent: Any) -> Any:
        mounted = build.constant("mounted_area", np.prod(signal.prestretches))
        pairs = zip(signal.points, signal.capacitances, strict=True)
        diluted = [c * (p.stretches[0] * p.stretches[1] / mounted) ** -exponent if p.active else c for p, c in pairs]
        return replace(signal, capacitances=diluted)
