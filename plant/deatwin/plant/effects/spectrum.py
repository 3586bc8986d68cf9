"""Effects whose relaxation times are spread over several decades."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from deatwin.plant.effects.base import Builder, Effect, ranged


@dataclass(frozen=True, kw_only=True)
class Spectrum(Effect):
    """Effect with three equal branches, whose relaxation times are spread evenly over their logarithm.

    The branches stand for a spectrum that is constant over the logarithm of time (a box distribution) and half as wide
    again as `decades`. Under such a spectrum a material relaxes in proportion to the logarithm of time (Ferry,
    Viscoelastic Properties of Polymers, 3rd ed., 1980, chapter 3). Three branches follow that law without steps while
    neighbours are at most a decade apart.
    """

    # Branches within half a decade differ from one branch by 2 % of the relaxation at most. Nearer to zero, on which the
    # response depends by its square alone, no recording could tell the width.
    decades: float = field(default=2.0, metadata=ranged("1", 0.5, 5.0))
    """Common logarithm of the ratio of the longest relaxation time to the shortest."""

    def branches(self, build: Builder) -> Iterator[tuple[str, Any]]:
        """Yield the name and the relaxation time, s, of each branch; the slowest one has the effect's own name."""
        # A slow state with the effect's name may start away from rest, if the history before an experiment is unknown.
        time, decades = self.own("time", build), self.own("decades", build)
        for name, power in ((f"{self.name}_fast", -0.5), (f"{self.name}_middle", 0.0), (self.name, 0.5)):
            yield name, time * 10 ** (power * decades)

    def broadened(self) -> Effect | None:
        """Return None, because no more general law is known."""
        return None

    @property
    def entry(self) -> dict[str, Any]:
        """Entry of a model file that identifies the equations, without parameter values."""
        return {"name": self.name, "law": "spectrum"}
