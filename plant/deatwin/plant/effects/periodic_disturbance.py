"""A tone in the reading, the command, a force or a pressure."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, Site, ranged
from deatwin.plant.effects.lines import tones
from deatwin.plant.parameters import Parameter

PHASES = 2 * np.pi / 4 * np.arange(-1, 3)
"""Phases tried for a tone that passes through the plant, which shifts it. One of the four is within an eighth of a turn
of the right phase, and promises at least half of its improvement."""


def _added(to: str, unit: str, amplitude: float, upper: float, place: Place) -> Site:
    return Site(
        place=place,
        signal=to,
        order=-1,
        strength=Parameter(name="amplitude", value=amplitude, unit=unit, lower=0.0, upper=upper),
        wording=f"A tone of {{frequency}} and {{amplitude}} is added to the {to}, at a phase of {{phase}}",
        title=f"tone added to the {to}",
    )


@dataclass(frozen=True, kw_only=True)
class PeriodicDisturbance(Effect):
    r"""A sinusoidal disturbance is added to the reading, for example from the mains, a fan or a shaking table.

    .. math:: y \to y + a\cos(2\pi ft + \varphi)

    ``PeriodicDisturbance().placed("force")`` describes a disturbance of the force on the moving body. In the same way,
    ``"command"`` and ``"pressure"`` place the disturbance on these signals, if the rig has them. The plant filters such
    a disturbance, so that the amplitude in the reading depends on the voltage.

    The effect has no state. A tone above half the sampling rate is recorded at its alias: the mains at about 50 Hz,
    sampled at 50 Hz, appears with a period of 10 to 100 s and looks like a drift. Typical: a = 1 to 20 µm. Signature:
    one line in the spectrum of the reading, as large at 0 V as at 3 kV. The command need not contain the frequency of
    this line, whereas a `resonance` appears only if the command excites it. The effect is off at a = 0.

    Parameters
    ----------
    amplitude : float
        a, the amplitude, in the unit of the signal; m for a displacement.
    frequency : float
        f, the frequency, Hz.
    phase : float
        :math:`\varphi`, the phase at time 0, rad.

    References
    ----------
    Oppenheim & Schafer, Discrete-Time Signal Processing, section on sampling (aliasing).
    """

    amplitude: float = field(default=5e-6, metadata=ranged("m", 0.0, 1e-3))
    frequency: float = field(default=0.05, metadata=ranged("Hz", 1e-4, 1000.0))
    phase: float = field(default=0.0, metadata=ranged("rad", -2 * np.pi, 2 * np.pi))

    name: ClassVar[str] = "periodic_disturbance"
    family: ClassVar[Family] = Family.ENVIRONMENT
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "amplitude"
    surroundings: ClassVar[frozenset[str]] = frozenset({"frequency"})
    order: ClassVar[int] = -1
    """The tone is added after `sensor_curvature`, which acts on the motion alone, and before `sensor_lag` and
    `sensor_saturation`."""
    wording: ClassVar[str] = "A tone of {frequency} and {amplitude} is added to the reading, at a phase of {phase}"
    places: ClassVar[Mapping[str, Site]] = MappingProxyType(
        {
            "command": _added("command", "V", 0.02, 1.0, Place.DRIVE),
            "force": _added("force", "N", 0.3e-3, 1.0, Place.BALL),
            "pressure": _added("pressure", "Pa", 10.0, 1e4, Place.PARAMETER),
        }
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        angle = 2 * np.pi * self.own("frequency", build) * build.time + self.own("phase", build)
        return signal + self.own("amplitude", build) * ca.cos(angle)

    def cycle(self, measured: Collection[str]) -> float:
        return 1 / self.frequency

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Return up to three copies of this effect at the strongest spectral lines of `residual` (SI) over `timepts` (s).

        A tone at another place passes through the plant, which shifts the tone's phase. Then only the strongest line is
        used, with this effect's amplitude and each of four phases.
        """
        ranges = {p.name: (p.lower, p.upper) for p in self.describe()}
        slowest, fastest = ranges["frequency"]
        if self.placed_at:
            found = [t.frequency for t in tones(timepts, residual, count=1) if slowest <= t.frequency <= fastest]
            return tuple(replace(self, frequency=f, phase=float(phase)) for f in found for phase in PHASES)
        return tuple(
            replace(self, amplitude=min(t.amplitude, ranges["amplitude"][1]), frequency=t.frequency, phase=t.phase)
            for t in tones(timepts, residual, count=3)
            if slowest <= t.frequency <= fastest
        )
