"""Relaxation of the mounted film's tension."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.film import AnyFilm
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class PrestretchRelaxation(Effect):
    r"""The tension of the mounted film decays during the experiment.

    .. math:: W \to W\,\bigl[1 - a(1 - e^{-t/\tau})\bigr]

    W is the strain energy density of the film without its Maxwell branches. The effect has no state: the decay depends
    only on the time, and begins at time 0. Typical for VHB that rested too short a time after it was stretched: a loss
    of 2 to 15 %, with a time constant of 1000 to 100,000 s.

    Signature: the sag of the film under the ball at 0 V grows, and so does the displacement under voltage. For the film
    of `thesis_plant`, a loss of 1 % of the tension increases the sag by 1 %, and the displacement by about 2.4 % at
    1.9 kV and by about 5 % at 3 kV. A `permittivity_drift` does not change the sag. `creep` follows the command, and
    recovers when the voltage is removed. The effect is off at a = 0.

    Parameters
    ----------
    relative_loss : float
        a, the final loss of tension, divided by the tension at time 0.
    time : float
        :math:`\tau`, the time constant of the decay, s.

    References
    ----------
    The equation is that of a Maxwell branch that was loaded when the film was mounted and relaxes far more slowly than
    the drive changes. VHB keeps relaxing after minutes: Wang et al., J. Mech. Phys. Solids 95 (2016) 213.
    """

    relative_loss: float = field(default=0.05, metadata=ranged("1", 0.0, 0.8))
    time: float = field(default=1000.0, metadata=ranged("s", 20.0, 200e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "prestretch_relaxation"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "relative_loss"
    order: ClassVar[int] = 2
    wording: ClassVar[str] = "The film's prestretch relaxes: it loses {relative_loss} of its tension in {time}"

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        elapsed = ca.fmax(build.time, 0.0)
        lost = self.own("relative_loss", build) * (1 - ca.exp(-elapsed / self.own("time", build)))
        return signal.with_elastic(1 - lost)
