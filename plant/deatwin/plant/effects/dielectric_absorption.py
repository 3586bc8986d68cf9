"""Polarisation that lags behind the field."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from operator import sub
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.spectrum import Spectrum
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class DielectricAbsorption(Effect):
    r"""Part of the polarisation, and so of the electric displacement D, lags the field E; the stress is E D.

    .. math:: V^2 \to V^2 - a\,V\,(V - p), \qquad \tau\dot p = V - p

    V is the film voltage. The effect has one state p (V), the voltage to which the slow dipoles have adapted; one p
    represents the whole film. The permittivity of the rig is the value after relaxation; the share (1 - a) of this
    value acts instantly. The stress and the reading ``current`` follow D. The reading ``capacitance`` follows the
    instantaneous permittivity, and the charge in `electrode_rc` follows the permittivity after relaxation. Typical for
    VHB: a = 0.01 to 0.05, :math:`\tau` = 1 to 1000 s.

    Signature: part of the stress is proportional to the product of present and past voltage. This memory is of the
    voltage and not of the motion, so the effect appears in a blocked film too. After a step, the motion grows as with
    `creep`, but at 0 V nothing remains, because E D vanishes at once. After a reversal of polarity, the force starts at
    :math:`(1 - 2a)` of its final value and recovers. The effect is off at a = 0.

    Parameters
    ----------
    share : float
        a, the share of the permittivity that lags.
    time : float
        :math:`\tau`, the relaxation time of the slow dipoles, s.

    References
    ----------
    Debye, Polar Molecules (1929), chapter 5 (relaxation); Suo, Acta Mech. Solida Sin. 23 (2010) 549,
    doi:10.1016/S0894-9166(11)60004-9 (stress E D).
    """

    share: float = field(default=0.05, metadata=ranged("1", 0.0, 0.9))
    time: float = field(default=30.0, metadata=ranged("s", 0.1, 5e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "dielectric_absorption"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "squared_voltage"
    strength: ClassVar[str] = "share"
    remembers: ClassVar[str] = "V"
    wording: ClassVar[str] = "A share of {share} of the polarisation lags with a time constant of {time}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        voltage = build.signal("field_voltage")
        adapted = build.state("adapted_voltage", scale=1e3)
        build.rate(adapted, voltage - adapted, mass=self.own("time", build))
        build.displace(self.name, adapted, lambda excess: adapted - excess)
        return self._without(voltage - adapted, signal, build)

    def _without(self, lagging: Any, signal: Any, build: Builder) -> Any:
        """Return the squared voltage without the polarisation that lags behind by a voltage."""
        voltage, share = build.signal("field_voltage"), self.own("share", build)
        build.share("polarising_voltage", voltage - share * lagging)
        build.share("instant_share", 1 - share)
        return signal - share * voltage * lagging

    def broadened(self) -> Effect | None:
        """Return absorption with a spectrum of relaxation times."""
        return AbsorptionSpectrum() if type(self) is DielectricAbsorption else None  # a subclass has a law of its own


@dataclass(frozen=True, kw_only=True)
class AbsorptionSpectrum(Spectrum, DielectricAbsorption):
    """Absorption with a spectrum of relaxation times around `time`, as most polymers have it.

    A third of the slow dipoles has each of the times. Their current decays as a power of the time (Curie and von
    Schweidler).
    """

    wording: ClassVar[str] = (
        "A share of {share} of the polarisation lags with time constants over {decades} decades around {time}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        voltage = build.signal("field_voltage")
        lagging = 0.0
        for branch, time in self.branches(build):
            adapted = build.state(f"{branch}_voltage", scale=1e3)
            build.rate(adapted, voltage - adapted, mass=time)
            build.displace(branch, adapted, partial(sub, adapted))
            lagging += (voltage - adapted) / 3
        return self._without(lagging, signal, build)
