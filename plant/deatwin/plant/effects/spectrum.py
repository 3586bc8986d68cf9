"""Effects whose relaxation times, or distances, are spread over several decades."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, ranged


@dataclass(frozen=True, kw_only=True)
class Spectrum(Effect):
    """Effect with three equal branches, one parameter of which is spread evenly over its logarithm.

    If this parameter is a relaxation time, the branches stand for a spectrum that is constant over the logarithm of
    time (a box distribution) and half as wide again as `decades`. Under such a spectrum a material relaxes in
    proportion to the logarithm of time (Ferry, Viscoelastic Properties of Polymers, 3rd ed., 1980, chapter 3). Three
    branches follow that law without steps while neighbours are at most a decade apart.
    """

    # Branches within half a decade differ from one branch by 2 % of the effect at most. Nearer to zero, on which the
    # response depends by its square alone, no recording could tell the width.
    decades: float = field(default=2.0, metadata=ranged("1", 0.5, 5.0))
    """Common logarithm of the ratio of the largest value to the smallest."""

    spread: ClassVar[str] = "time"
    """Name of the parameter that is spread."""

    def branches(self, build: Builder) -> Iterator[tuple[str, Any]]:
        """Yield the name of each branch and its value of the parameter, SI; the largest one has the effect's own name."""
        # A slow state with the effect's name may start away from rest, if the history before an experiment is unknown.
        middle, decades = self.own(self.spread, build), self.own("decades", build)
        for name, power in ((f"{self.name}_fast", -0.5), (f"{self.name}_middle", 0.0), (self.name, 0.5)):
            yield name, middle * 10 ** (power * decades)

    @property
    def entry(self) -> dict[str, Any]:
        """Entry of a model file that identifies the equations, without parameter values."""
        return {"name": self.name, "law": "spectrum"}
