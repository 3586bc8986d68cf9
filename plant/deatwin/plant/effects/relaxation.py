"""Relaxation of a spring."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


STARTS = 5
"""Number of time constants from which a fit may start. They are a factor of 4 to 10 apart, and a fit reaches the true
one from the nearest."""


@dataclass(frozen=True, kw_only=True)
class Relaxation(Effect):
    r"""A spring in series with a damper acts in parallel to the plant, so that the total force relaxes.

    .. math:: F \to F - k_r\,(y - \xi), \qquad \tau_r\,\dot\xi = y - \xi

    F is the force on the moving body and y its displacement. The effect has one state :math:`\xi` (m), the displacement
    of the damper; at rest :math:`\xi = y`. A plant with a spring k then is the standard linear solid, whose stiffness
    is k for slow and :math:`k + k_r` for fast motion. In other plants y is the quantity that corresponds to a
    displacement. The branch is then a store that fills and empties through a resistance, such as the heat capacity of
    furniture in a room, or slow diffusion in a battery. Typical: :math:`k_r` of 10 to 50 % of k for rubbers and
    silicones, over times far longer than the motion. Signature: after each step the motion continues slowly, in
    proportion to the step, and later recovers; the gain is higher for slow than for fast commands; the loop is widest
    at a period of :math:`2\pi\tau_r`, whereas the loop of `hysteresis` keeps its width. A `sensor_drift` does not
    follow the command. If :math:`\tau_r` is far below the period of the motion, the branch acts as a damper of
    :math:`k_r\tau_r`. For films, see `creep`. The effect is off at :math:`k_r = 0`.

    Parameters
    ----------
    stiffness : float
        :math:`k_r`, the stiffness of the spring, N/m.
    time : float
        :math:`\tau_r`, the relaxation time: damping divided by stiffness, s.

    References
    ----------
    Maxwell branch of the standard linear solid: Christensen, Theory of Viscoelasticity (2nd ed., 1982), section 1.6.
    """

    stiffness: float = 10.0
    time: float = 0.6

    name: ClassVar[str] = "relaxation"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "stiffness"
    wording: ClassVar[str] = "The force on the ball relaxes by {stiffness} with a time constant of {time}"

    def describe(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="stiffness", value=self.stiffness, unit="N/m", lower=0.0, upper=3e3),
            Parameter(name="time", value=self.time, unit="s", lower=6e-3, upper=60e3, scale=log),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        displacement = build.signal("displacement")
        damper = build.state("relaxed_displacement", scale=1e-3, start=displacement)
        build.rate(damper, displacement - damper, mass=self.own("time", build))
        return signal - self.own("stiffness", build) * (displacement - damper)

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Return such effects with times between a few samples and the length of `timepts`, s, for any `residual`."""
        steps = np.diff(np.unique(timepts))
        if not steps.size:
            return ()
        known = self.described("time")
        # A force that relaxes within a sample acts as damping; one that hardly relaxes within a third of the record, as
        # stiffness.
        times = np.geomspace(2 * np.median(steps), max(np.ptp(timepts) / 3, 2 * np.median(steps)), STARTS)
        return tuple(replace(self, time=float(t)) for t in np.unique(np.clip(times, known.lower, known.upper)))
