"""A second mode of vibration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.lines import spectral_peaks
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class Resonance(Effect):
    r"""A second mass is attached to the ball by a spring and a damper.

    .. math:: m_2\ddot x_2 = -F, \qquad F = m_2\omega^2(x_2 - y) + 2\zeta m_2\omega(\dot x_2 - \dot y), \qquad
              \omega = 2\pi f

    F is the force that the spring and the damper exert on the ball, and y is the displacement of the ball. The effect
    has two states: the displacement :math:`x_2` (m) and the velocity (m/s) of the second mass. The second mass adds
    inertia but no weight, because it represents a vibrating structure that carries its own weight.

    Typical: a mode of the film, the frame or the holder, with 1 to 20 % of the ball's mass and a damping ratio of 0.01
    to 0.1. Signature: the frequency response has a narrow peak next to a dip. A voltage lowers the ball's natural
    frequency, which is 16 Hz at 0 V, but shifts peak and dip only little. The peak appears only if the command excites
    it, whereas a `periodic_disturbance` appears without excitation. At frequencies far below f, the effect equals that
    of an added mass. Modes above half the sampling rate appear at an alias frequency. The usual range of f ends at 24
    Hz, just below half of 50 samples a second; with faster sampling, modes up to half the sampling rate are looked for.
    The effect is off at :math:`m_2 = 0`.

    Parameters
    ----------
    mass : float
        :math:`m_2`, the second mass, kg.
    frequency : float
        f, the frequency of the second mass on its spring, Hz.
    damping_ratio : float
        :math:`\zeta`, the damping ratio of the second mass on its spring.

    References
    ----------
    Den Hartog, Mechanical Vibrations (4th ed., 1956), section 3.2: the dynamic absorber.
    """

    mass: float = field(default=0.2e-3, metadata=ranged("kg", 0.0, 0.02))
    frequency: float = field(default=8.0, metadata=ranged("Hz", 1.0, 24.0, widest=1e3, scale=Scale.LOGARITHMIC))
    damping_ratio: float = field(default=0.03, metadata=ranged("1", 1e-3, 0.7, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "resonance"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "mass"
    wording: ClassVar[str] = "A second mass of {mass} vibrates at {frequency} with a damping ratio of {damping_ratio}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        position = build.state("second_position", scale=1e-3)
        velocity = build.state("second_velocity", scale=0.05)
        omega = 2 * np.pi * self.own("frequency", build)
        spring = omega**2 * (position - build.signal("displacement"))
        damper = 2 * self.own("damping_ratio", build) * omega * (velocity - build.signal("velocity"))
        build.rate(position, velocity)
        build.rate(velocity, -(spring + damper))
        return signal + self.own("mass", build) * (spring + damper)

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Return up to four copies of this effect at peaks of the spectrum of `residual` (SI) over `timepts` (s)."""
        known = self.described("frequency")
        peaks = spectral_peaks(timepts, residual, (known.lower, known.widest or known.upper), count=4)
        return tuple(replace(self, frequency=f) for f in peaks)
