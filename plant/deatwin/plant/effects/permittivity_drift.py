"""Slow change of the film's permittivity."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.laws.permittivity import relaxing
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class PermittivityDrift(Effect):
    r"""The permittivity relaxes from one value to another during the experiment.

    .. math:: \varepsilon(t) = \varepsilon\,\bigl[1 + a(1 - e^{-t/\tau})\bigr]

    The effect has no state: the drift depends only on the time, and begins at time 0. Typical: a of 2 to 15 %, in
    either direction, with a time constant of 100 to 10,000 s. Signature: the displacement under voltage changes,
    whereas the sag of the film under the ball at 0 V does not. `prestretch_relaxation` changes the sag too. For the
    film of `thesis_plant`, a change of the permittivity by 1 % changes the displacement by about 1.5 % at 1.9 kV and
    by 4 % at 3 kV. The effect is off at a = 0.

    Parameters
    ----------
    relative_change : float
        a, the final change divided by the initial value.
    time : float
        :math:`\tau`, the time constant of the drift, s.

    References
    ----------
    Relaxation as one Debye process; sizes from the drifts of six actuators in W. R. Jacobs' thesis, section 2.3.2. The
    capacitance of ageing acrylic actuators fell by 4 to 12 % in 1000 h: J. Appl. Phys. 115 (2014) 214105.
    """

    relative_change: float = field(default=-0.1, metadata=ranged("1", -0.6, 1.5))
    time: float = field(default=300.0, metadata=ranged("s", 20.0, 20e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "permittivity_drift"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.PARAMETER
    signal: ClassVar[str] = "permittivity"
    strength: ClassVar[str] = "relative_change"
    wording: ClassVar[str] = (
        "The permittivity drifts towards a final change of {relative_change} with a time constant of {time}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return relaxing(build.time, signal, self.own("relative_change", build), self.own("time", build))
