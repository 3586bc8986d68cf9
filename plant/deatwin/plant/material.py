"""Film materials: an energy, its Maxwell branches, a permittivity, and the published sets for VHB tapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.laws.energies import arruda_boyce, gent
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
    """Film material: an energy function and a published set of starting values.

    Parameters
    ----------
    name : str
        Name in a rig file.
    energy : callable
        Function ``energy(stretch_1, stretch_2, *elastic_parameters)``, J/m³.
    elastic : tuple of Parameter
        Parameters of `energy`, in the order of its arguments.
    branches : tuple of Branch
        Maxwell branches; empty for a purely elastic material.
    permittivity : Parameter
        Relative permittivity of the stretched film.
    """

    name: str
    energy: Callable[..., Symbol]
    elastic: tuple[Parameter, ...]
    branches: tuple[Branch, ...]
    permittivity: Parameter

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters of the material: elastic ones, those of the branches, permittivity."""
        of_branches = (parameter for branch in self.branches for parameter in (branch.modulus, branch.time))
        return (*self.elastic, *of_branches, self.permittivity)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at small strain when all branches are relaxed, Pa; a third of the elastic modulus."""
        return float(shear_modulus(self.energy, *(parameter.value for parameter in self.elastic)))


def _modulus(value: float, source: str) -> Parameter:
    return Parameter(
        name="shear_modulus", value=value, unit="Pa", lower=5e3, upper=200e3, scale=Scale.LOGARITHMIC, source=source
    )


def _stretch_limit(value: float, source: str) -> Parameter:
    return Parameter(
        name="stretch_limit", value=value, unit="1", lower=40.0, upper=1e4, scale=Scale.RECIPROCAL, source=source
    )


def _locking_stretch(value: float, source: str) -> Parameter:
    return Parameter(
        name="locking_stretch", value=value, unit="1", lower=3.8, upper=1e4, scale=Scale.RECIPROCAL, source=source
    )


def _permittivity(value: float, source: str) -> Parameter:
    return Parameter(
        name="permittivity", value=value, unit="1", lower=1.5, upper=10.0, scale=Scale.LOGARITHMIC, source=source
    )


def _branches(source: str, *values: tuple[float, float]) -> tuple[Branch, ...]:
    """Branches of given (modulus in Pa, time in s); a fit may change a time by a factor of about 30 both ways."""
    names = ["branch", *(f"branch_{i}" for i in range(2, len(values) + 1))]
    return tuple(
        Branch(
            name=name,
            modulus=Parameter(
                name=f"{name}_modulus",
                value=modulus,
                unit="Pa",
                lower=1.0,
                upper=1e6,
                scale=Scale.LOGARITHMIC,
                source=source,
            ),
            time=Parameter(
                name=f"{name}_time",
                value=time,
                unit="s",
                lower=float(f"{time / 30:.0e}"),
                upper=float(f"{time * 33:.0e}"),
                scale=Scale.LOGARITHMIC,
                source=source,
            ),
        )
        for name, (modulus, time) in zip(names, values, strict=True)
    )


_WANG = "Wang, Decker, Henann & Chester, J. Mech. Phys. Solids 95 (2016) 213"
_HOSSAIN = (
    "Hossain, Vu & Steinmann, Comput. Mater. Sci. 59 (2012) 65, identified at 50 % deformation; "
    "read in a public code's benchmark that cites it"
)
_FOO = (
    "Foo, Cai, Koh, Bauer & Suo, J. Appl. Phys. 111 (2012) 034102, doi:10.1063/1.3680878; "
    "unconfirmed: as later literature quotes it"
)
_RANGE = _permittivity(4.5, "published values for stretched VHB lie between 3.5 and 4.7")


def _common(name: str) -> Material:
    """One relaxation and a modulus in the middle of the published values: start values for a rig of unknown history."""
    return Material(
        name=name,
        energy=gent,
        elastic=(
            _modulus(25e3, "middle of the published range for VHB at rest, 14 to 45 kPa"),
            _stretch_limit(107.0, f"3(lambda_L^2 - 1) with lambda_L = 5.99, {_WANG}"),
        ),
        branches=_branches(f"first branch, {_WANG}", (26.06e3, 0.6074)),
        permittivity=_RANGE,
    )


def _published() -> tuple[Material, ...]:
    """Complete published sets. Their flow rules differ from ours at large strain only: the times are the same."""
    return (
        Material(
            name="VHB 4910 Wang 2016",
            energy=arruda_boyce,
            elastic=(_modulus(15.36e3, _WANG), _locking_stretch(5.99, _WANG)),
            branches=_branches(_WANG, (26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25)),
            permittivity=_permittivity(4.8, _WANG),
        ),
        Material(
            name="VHB 4910 Hossain 2012",
            energy=arruda_boyce,
            elastic=(
                _modulus(13.7e3, _HOSSAIN),
                _locking_stretch(886.6, f"root of 7.86e5 links: far from any limit at that strain; {_HOSSAIN}"),
            ),
            branches=_branches(_HOSSAIN, (56.4e3, 0.82), (31.5e3, 10.7), (19.8e3, 500.0)),
            permittivity=_RANGE,
        ),
        Material(
            name="VHB 4910 Foo 2012",
            energy=gent,
            elastic=(_modulus(18e3, _FOO), _stretch_limit(110.0, _FOO)),
            branches=_branches(f"its spring's own limit, 55, is left out here; {_FOO}", (42e3, 400.0)),
            permittivity=_permittivity(4.5, f"3.98e-11 F/m; {_FOO}"),
        ),
    )


MATERIALS: Mapping[str, Material] = MappingProxyType(
    {entry.name: entry for entry in (_common("VHB 4905"), _common("VHB 4910"), *_published())}
)
"""Materials by the name that a rig file uses."""


def material(name: str) -> Material:
    """Return the material of a name.

    Parameters
    ----------
    name : str
        Key of `MATERIALS`.

    Returns
    -------
    Material

    Raises
    ------
    RigError
        If the name is unknown.

    Examples
    --------
    >>> material("VHB 4905").permittivity.value
    4.5
    """
    try:
        return MATERIALS[name]
    except KeyError:
        raise RigError(f"unknown material {name!r}{nearest(name, MATERIALS)} (known: {', '.join(MATERIALS)})") from None
