"""The material of a film: an energy, its Maxwell branches, a permittivity, a breakdown law and a density."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from inspect import signature
from types import FunctionType
from typing import Any, Self

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.laws.breakdown import BreakdownLaw
from deatwin.plant.laws.energies import ENERGIES
from deatwin.plant.laws.formula import Formula
from deatwin.plant.laws.stress import shear_modulus
from deatwin.plant.parameters import Parameter, Scale

Symbol = Any


@dataclass(frozen=True, kw_only=True)
class Branch:
    """Maxwell branch in parallel with the equilibrium network: a neo-Hookean spring in series with a dashpot.

    Parameters
    ----------
    name : str
        Name: ``branch`` for the first branch, ``branch_2``, ``branch_3``, ... for the others.
    modulus : Parameter
        Shear modulus of the spring, Pa.
    time : Parameter
        Relaxation time, s.
    """

    name: str
    modulus: Parameter
    time: Parameter


@dataclass(frozen=True, kw_only=True)
class Material:
    """Film material: an energy function and starting values with their ranges.

    Parameters
    ----------
    name : str
        Name in a rig file.
    energy : callable
        Function ``energy(stretch_1, stretch_2, *elastic_parameters)``, J/m³: one of `deatwin.plant.laws`, a
        `deatwin.plant.laws.Formula`, or a function of your own in CasADi. A saved file holds only the name of your own
        function, so a program must import the function's module before it reads the file.
    elastic : tuple of Parameter
        Parameters of `energy`: in any order if they have the names of its arguments, otherwise in the order of its
        arguments.
    branches : tuple of Branch
        Maxwell branches; empty for a purely elastic material.
    permittivity : Parameter
        Relative permittivity of the stretched film.
    breakdown : BreakdownLaw, or None
        Field that the film withstands; None if it is unknown, in which case no breakdown is detected.
    density : float
        Density, kg/m³, for rigs in which the film's own inertia matters.

    Raises
    ------
    RigError
        If the energy cannot be called; or if it is a formula, and the parameters do not have the names in the formula.
    """

    name: str
    energy: Callable[..., Symbol]
    elastic: tuple[Parameter, ...]
    branches: tuple[Branch, ...] = ()
    permittivity: Parameter
    breakdown: BreakdownLaw | None = None
    density: float = 1000.0

    def __post_init__(self) -> None:
        if not callable(self.energy):
            raise RigError(f"energy is {self.energy!r}; give a function such as deatwin.plant.laws.gent, or a Formula")
        names, given = _arguments(self.energy), [parameter.name for parameter in self.elastic]
        if sorted(given) == sorted(names):
            object.__setattr__(self, "elastic", tuple(self.elastic[given.index(name)] for name in names))
        elif isinstance(self.energy, Formula):
            raise RigError(
                f"the energy {self.energy.text!r} has the parameters {', '.join(names) or 'none'}; "
                f"elastic has {', '.join(given) or 'none'}"
            )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters of the material: elastic ones, those of the branches, permittivity."""
        of_branches = (parameter for branch in self.branches for parameter in (branch.modulus, branch.time))
        return (*self.elastic, *of_branches, self.permittivity)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at small strain when all branches are relaxed, Pa; a third of the elastic modulus."""
        return float(shear_modulus(self.energy, *(parameter.value for parameter in self.elastic)))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `from_dict` makes the same material."""
        return {
            "name": self.name,
            "energy": _name_of(self.energy),
            "elastic": [_plain(parameter) for parameter in self.elastic],
            "branches": [{"name": b.name, "modulus": _plain(b.modulus), "time": _plain(b.time)} for b in self.branches],
            "permittivity": _plain(self.permittivity),
            "breakdown": None if self.breakdown is None else asdict(self.breakdown),
            "density": self.density,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make the material from the `data` of `to_dict`; RigError if data are missing or the energy is unknown."""
        try:
            return cls(
                name=str(data["name"]),
                energy=energy_named(data["energy"]),
                elastic=tuple(map(_parameter, data["elastic"])),
                branches=tuple(
                    Branch(name=b["name"], modulus=_parameter(b["modulus"]), time=_parameter(b["time"]))
                    for b in data["branches"]
                ),
                permittivity=_parameter(data["permittivity"]),
                breakdown=None if data["breakdown"] is None else BreakdownLaw(**data["breakdown"]),
                density=float(data["density"]),
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            if isinstance(error, RigError):
                raise
            raise RigError(f"malformed material: {error!r}") from None


def energy_named(name: str) -> Callable[..., Symbol]:
    """Return the energy with a given name or formula, or ``module:function`` if that module is already imported."""
    known = name.lower().replace("-", "_").replace(" ", "_")
    if known in ENERGIES:
        return ENERGIES[known]
    if ":" not in name:
        if name.isidentifier():  # a bare name is no formula
            raise RigError(f"unknown energy {name!r}{nearest(known, ENERGIES)} (known: {', '.join(ENERGIES)})")
        return Formula(name)
    module, _, function = name.partition(":")
    # A file must not cause an import.
    found = getattr(sys.modules.get(module), function, None)
    if not isinstance(found, FunctionType) or found.__module__ != module:
        raise RigError(
            f"the energy {name} is a function of its author's own: import the module {module} first, or write the "
            'energy as a formula, as in "mu/2*(I1 - 3)"'
        )
    return found


def _arguments(energy: Callable[..., Symbol]) -> tuple[str, ...]:
    """Return the names of an energy's parameters, without the two stretches; of ``*terms``, only ``terms``."""
    return energy.names if isinstance(energy, Formula) else tuple(signature(energy).parameters)[2:]


def _name_of(energy: Callable[..., Symbol]) -> str:
    """Return the name with which `energy_named` finds an energy."""
    if isinstance(energy, Formula):
        return energy.text
    name = getattr(energy, "__qualname__", type(energy).__name__)
    return name if ENERGIES.get(name) is energy else f"{energy.__module__}:{name}"


def _plain(parameter: Parameter) -> dict[str, Any]:
    return {**asdict(parameter), "scale": parameter.scale.name}


def _parameter(data: Mapping[str, Any]) -> Parameter:
    return Parameter(**{**data, "scale": Scale[data["scale"]]})
