"""Relaxation of a spring."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.spectrum import Spectrum
from deatwin.plant.parameters import Scale

STARTS = 5
"""Number of time constants from which a fit may start. They are a factor of 4 to 10 apart, and a fit reaches the true
one from the nearest."""


@dataclass(frozen=True, kw_only=True)
class Relaxation(Effect):
    r"""A Maxwell branch, that is a spring in series with a damper, acts on the moving body, so that the force relaxes.

    .. math:: F \to F - k_r\,(y - \xi), \qquad \tau_r\,\dot\xi = y - \xi

    F is the force on the moving body and y the displacement of the body. The effect has one state :math:`\xi` (m), the
    displacement of the damper; at rest :math:`\xi = y`. Together with a spring of stiffness k, the branch forms the
    standard linear solid: its stiffness is k for slow motion and :math:`k + k_r` for fast motion. If :math:`\tau_r` is
    far below the period of the motion, the branch acts as a damper with the constant :math:`k_r\tau_r`. For films, use
    `creep`.

    In a plant without motion, y is the quantity that corresponds to a displacement, and the branch is a store that
    fills and empties through a resistance, such as the heat capacity of furniture in a room.

    Typical for rubbers and silicones: :math:`k_r` of 10 to 50 % of k, and a :math:`\tau_r` far longer than the period
    of the motion. Signature: after each step of the command, the body continues to move slowly, by a distance
    proportional to the step. After a step back, the body recovers as slowly. The gain from command to displacement is
    higher for slow than for fast commands. For a sinusoidal command, the loop of reading over command is widest at a
    period of about :math:`2\pi\tau_r`, whereas the loop of `hysteresis` has the same width at all periods. A
    `sensor_drift` does not depend on the command. The effect is off at :math:`k_r = 0`.

    Parameters
    ----------
    stiffness : float
        :math:`k_r`, the stiffness of the spring, N/m.
    time : float
        :math:`\tau_r`, the relaxation time of the branch: constant of its damper divided by :math:`k_r`, s.

    References
    ----------
    Maxwell branch of the standard linear solid: Christensen, Theory of Viscoelasticity (2nd ed., 1982), section 1.6.
    """

    stiffness: float = field(default=10.0, metadata=ranged("N/m", 0.0, 3e3))
    time: float = field(default=0.6, metadata=ranged("s", 6e-3, 60e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "relaxation"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "stiffness"
    wording: ClassVar[str] = "The force on the ball relaxes by {stiffness} with a time constant of {time}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        displacement = build.signal("displacement")
        damper = build.state("relaxed_displacement", scale=1e-3, start=displacement)
        build.rate(damper, displacement - damper, mass=self.own("time", build))
        return signal - self.own("stiffness", build) * (displacement - damper)

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Return up to five copies of this effect, with times from two samples to a third of the span of `timepts` (s).

        The copies do not depend on `residual`.
        """
        steps = np.diff(np.unique(timepts))
        if not steps.size:
            return ()
        known = self.described("time")
        # A force that relaxes within a sample acts as damping; one that hardly relaxes within a third of the record, as
        # stiffness.
        times = np.geomspace(2 * np.median(steps), max(np.ptp(timepts) / 3, 2 * np.median(steps)), STARTS)
        return tuple(replace(self, time=float(t)) for t in np.unique(np.clip(times, known.lower, known.upper)))

    def broadened(self) -> Effect | None:
        """Return relaxation with a spectrum of relaxation times."""
        return RelaxationSpectrum() if type(self) is Relaxation else None  # a subclass has a law of its own


@dataclass(frozen=True, kw_only=True)
class RelaxationSpectrum(Spectrum, Relaxation):
    """Relaxation with a spectrum of relaxation times around `time`; a third of the stiffness has each of the times."""

    wording: ClassVar[str] = (
        "The force on the ball relaxes by {stiffness} with time constants over {decades} decades around {time}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        displacement = build.signal("displacement")
        for branch, time in self.branches(build):
            damper = build.state(f"{branch}_displacement", scale=1e-3, start=displacement)
            build.rate(damper, displacement - damper, mass=time)
            signal = signal - self.own("stiffness", build) / 3 * (displacement - damper)
        return signal
