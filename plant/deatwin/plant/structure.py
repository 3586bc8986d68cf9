"""Share equations and compiled simulator among plants of the same structure."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from threading import RLock
from typing import Any

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Effect
from deatwin.plant.equations import Equations
from deatwin.plant.integrator.compiled import compiler
from deatwin.plant.parameters import ParameterSet
from deatwin.plant.rigs.base import Rig, written
from deatwin.plant.simulate import Simulator

NOT_IN_EQUATIONS = frozenset(
    {
        "reading",
        "noise",
        "model_error",
        "command_range",
        "ball_is_known",
        "prestretch_is_known",
        "zero_is_known",
        "chain",
    }
)
"""Fields of a rig that do not enter its equations."""
_LOCK = RLock()


@dataclass(frozen=True)
class Structure:
    """A plant that equals others with the same equations; values that a fit can change are ignored."""

    rig: Rig = field(compare=False)
    effects: tuple[Effect, ...] = field(compare=False)
    parameters: ParameterSet = field(compare=False)
    stages: int
    key: tuple[Any, str]

    @classmethod
    def of(cls, rig: Rig, effects: tuple[Effect, ...], parameters: ParameterSet, stages: int) -> Structure:
        """Return the structure of a rig with effects."""
        known = {p.name: p.value for p in parameters.values() if p.known}
        stated = {k: v for k, v in rig.to_dict().items() if k not in NOT_IN_EQUATIONS}
        stated |= {
            "averages": rig.averages,
            "further": [(reading.name, reading.series_resistance) for reading in rig.further],
        }
        # The classes themselves, because two that share a name may write different equations; and the energy's
        # function, because the plain data only names a user's own energy.
        energy = getattr(getattr(rig, "material", None), "energy", None)
        classes = (type(rig), energy, *(type(e) for e in effects))
        reach = {p.name: p.upper for p in parameters.values() if p.widest is not None}
        named = sorted(stated.items()), [e.entry for e in effects], sorted(known.items()), sorted(reach.items())
        return cls(rig, effects, parameters, stages, (classes, repr(named)))

    @property
    def equations(self) -> Equations:
        """The equations, written when first needed."""
        return _equations(self)

    @property
    def simulator(self) -> Simulator:
        """The simulator, compiled when first needed."""
        with _LOCK:  # otherwise threads that start together would each compile the same equations
            return _simulator(self, compiler())


@lru_cache(maxsize=256)
def _equations(structure: Structure) -> Equations:
    rig, build = structure.rig, Builder(structure.parameters, structure.effects, structure.stages)
    with written(rig, build) as reading:
        return build.finish(reading, [further.name for further in rig.further])


@lru_cache(maxsize=64)
def _simulator(structure: Structure, program: str | None) -> Simulator:
    """Return the simulator, cached by structure and by the compiler in use."""
    return Simulator(structure.equations)
