"""Slow drift of a parameter of a foreign model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place
from deatwin.plant.laws.permittivity import relaxing
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.words import spaced


@dataclass(frozen=True, kw_only=True)
class ParameterDrift(Effect):
    r"""A parameter of the plant relaxes from one value to another during the experiment.

    .. math:: p(t) = p\,\bigl[1 + a(1 - e^{-t/\tau})\bigr]

    p is the value of the plant's parameter at time 0. The effect has no state: the drift depends only on the time, and
    begins at time 0. Signature: a slow change of the reading, of the kind that a change of this parameter causes.
    The effect is off at a = 0.

    Parameters
    ----------
    relative_change : float
        a, the final change divided by the initial value.
    time : float
        :math:`\tau`, the time constant of the drift, s.
    parameter : str
        Name of the plant's parameter that drifts.

    References
    ----------
    Relaxation as one Debye process.
    """

    relative_change: float = -0.1
    time: float = 300.0
    parameter: str

    family: ClassVar[Family] = Family.ENVIRONMENT
    place: ClassVar[Place] = Place.PARAMETER
    strength: ClassVar[str] = "relative_change"

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the effect, which contains the name of the parameter: ``drift_of_stiffness``."""
        return f"drift_of_{self.parameter}"

    @property
    def signal(self) -> str:  # type: ignore[override]
        """Name of the parameter that drifts."""
        return self.parameter

    @property
    def wording(self) -> str:  # type: ignore[override]
        """Sentence about the effect, with the names of its parameters in braces."""
        words = spaced(self.parameter).replace("{", "{{").replace("}", "}}")
        return f"The parameter {words} drifts towards a final change of {{relative_change}} with a time constant of {{time}}"

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the parameters other than the strength."""
        return ("time",)

    def describe(self) -> tuple[Parameter, ...]:
        return (
            # A parameter that changed sign would no longer mean the same.
            Parameter(name="relative_change", value=self.relative_change, unit="1", lower=-0.9, upper=4.0),
            Parameter(name="time", value=self.time, unit="s", lower=20.0, upper=20e3, scale=Scale.LOGARITHMIC),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return relaxing(build.time, signal, self.own("relative_change", build), self.own("time", build))
