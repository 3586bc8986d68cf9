"""The material of a film: an energy, its Maxwell branches, a permittivity, a breakdown law and a density."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from inspect import signature
from types import FunctionType
from typing import Any, Self

from deatwin.plant.arguments import each, instance, of_plain_data, require_fields
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.laws.breakdown import BreakdownLaw
from deatwin.plant.laws.energies import ENERGIES
from deatwin.plant.laws.formula import Formula
from deatwin.plant.laws.stress import shear_modulus
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.stated import require_number

Symbol = Any
_PARAMETER = instance(Parameter, error=RigError)


@dataclass(frozen=True, kw_only=True)
class Branch:
    """Maxwell branch in parallel with the elastic film: a neo-Hookean spring in series with a dashpot.

    Parameters
    ----------
    name : str
        Name: ``branch`` for the first branch, ``branch_2``, ``branch_3``, ... for the others.
    modulus : Parameter
        Shear modulus of the spring, Pa.
    time : Parameter
        Relaxation time, s: viscosity of the dashpot divided by `modulus`.

    Raises
    ------
    RigError
        If `name` is not text, or `modulus` or `time` is not a `Parameter`.
    """

    name: str
    modulus: Parameter
    time: Parameter

    def __post_init__(self) -> None:
        require_fields(self, name=instance(str, error=RigError), modulus=_PARAMETER, time=_PARAMETER)


@dataclass(frozen=True, kw_only=True)
class Material:
    """Film material: elastic energy, Maxwell branches, permittivity, breakdown field and density.

    Parameters
    ----------
    name : str
        Name of the material, as in a rig file.
    energy : callable
        Function ``energy(stretch_1, stretch_2, *elastic_parameters)`` that returns the elastic energy per reference
        volume, J/m³: one of `deatwin.plant.laws`, a `deatwin.plant.laws.Formula`, or a function of your own in CasADi.
        A saved file contains only the name of your own function. Import the module of the function before you read such
        a file.
    elastic : tuple of Parameter
        Elastic parameters of `energy`: in any order if they have the names of the function's arguments, otherwise in
        the order of the arguments.
    branches : tuple of Branch
        Maxwell branches; empty for a purely elastic material.
    permittivity : Parameter
        Relative permittivity of the film at its prestretch.
    breakdown : BreakdownLaw, or None
        Law of the breakdown field; None if it is unknown, in which case no breakdown is detected.
    density : float
        Density, kg/m³. It matters in rigs with a film that has inertia.

    Raises
    ------
    RigError
        If a field has the wrong type, if the density is not above 0, or if `energy` is a `Formula` whose parameters have
        other names than `elastic`.
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
        require_fields(
            self,
            name=instance(str, error=RigError),
            elastic=each(_PARAMETER, error=RigError),
            branches=each(instance(Branch, error=RigError), error=RigError),
            permittivity=_PARAMETER,
        )
        if self.breakdown is not None:
            instance(BreakdownLaw, hint=", or None", error=RigError)(self.breakdown, "breakdown")
        require_number("density", self.density)
        for name in ("elastic", "branches"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
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
        """All parameters of the material: those of the energy, those of the branches, and the permittivity."""
        of_branches = (parameter for branch in self.branches for parameter in (branch.modulus, branch.time))
        return (*self.elastic, *of_branches, self.permittivity)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at small strain after all branches have relaxed, Pa; a third of the elastic modulus."""
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
    @of_plain_data(RigError)
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make the material from the `data` of `to_dict`; RigError if data are missing or the energy is unknown."""
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
