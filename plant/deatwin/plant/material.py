r"""Hyperelastic energies of an incompressible film, and the published sets for VHB tapes.

Energies are per reference volume, functions of the two in-plane stretches; the third one follows from
:math:`\lambda_1\lambda_2\lambda_3 = 1`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import casadi as ca

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.parameters import Parameter, Scale

__all__ = ["MATERIALS", "Branch", "Material", "first_invariant", "gent", "material", "maxwell_branch", "neo_hookean"]

Symbol = Any  # a CasADi SX, MX, DM or a float


def first_invariant(stretch_1: Symbol, stretch_2: Symbol) -> Symbol:
    r""":math:`I_1 = \lambda_1^2 + \lambda_2^2 + (\lambda_1\lambda_2)^{-2}`.

    Parameters
    ----------
    stretch_1, stretch_2 : symbol or float
        Principal in-plane stretches.

    Returns
    -------
    symbol or float
        Dimensionless.
    """
    return stretch_1**2 + stretch_2**2 + 1 / (stretch_1 * stretch_2) ** 2


def neo_hookean(stretch_1: Symbol, stretch_2: Symbol, shear_modulus: Symbol) -> Symbol:
    r"""Neo-Hookean energy :math:`W = \tfrac{\mu}{2}(I_1 - 3)`.

    Parameters
    ----------
    stretch_1, stretch_2 : symbol or float
        Principal in-plane stretches.
    shear_modulus : symbol or float
        :math:`\mu` in Pa.

    Returns
    -------
    symbol or float
        Energy per reference volume, J/m³.
    """
    return shear_modulus / 2 * (first_invariant(stretch_1, stretch_2) - 3)


def gent(stretch_1: Symbol, stretch_2: Symbol, shear_modulus: Symbol, stretch_limit: Symbol) -> Symbol:
    r"""Gent energy :math:`W = -\tfrac{\mu J_m}{2}\ln\bigl(1 - (I_1-3)/J_m\bigr)`.

    Parameters
    ----------
    stretch_1, stretch_2 : symbol or float
        Principal in-plane stretches.
    shear_modulus : symbol or float
        :math:`\mu` in Pa.
    stretch_limit : symbol or float
        :math:`J_m`, the largest possible :math:`I_1 - 3`.

    Returns
    -------
    symbol or float
        Energy per reference volume, J/m³.

    References
    ----------
    Gent, Rubber Chem. Technol. 69 (1996) 59, doi:10.5254/1.3538357.
    """
    extension = first_invariant(stretch_1, stretch_2) - 3
    # The root has no value beyond the limit, so neither has a stress there; that of the logarithm alone has.
    return -shear_modulus * stretch_limit * ca.log(ca.sqrt(1 - extension / stretch_limit))


def maxwell_branch(elastic_1: Symbol, elastic_2: Symbol) -> Symbol:
    r"""Energy of a Maxwell branch's spring per unit of its shear modulus, :math:`\tfrac12(I_1^e - 3)`.

    Parameters
    ----------
    elastic_1, elastic_2 : symbol or float
        Elastic stretches :math:`\lambda_i^e = \lambda_i/\xi_i` of the spring in the branch.

    Returns
    -------
    symbol or float
        Dimensionless.

    References
    ----------
    Foo et al., J. Appl. Phys. 111 (2012) 034102, doi:10.1063/1.3680878.
    """
    return (first_invariant(elastic_1, elastic_2) - 3) / 2


@dataclass(frozen=True, kw_only=True)
class Branch:
    """A Maxwell branch in parallel with the equilibrium network: a neo-Hookean spring behind a dashpot.

    Parameters
    ----------
    name : str
        ``branch`` for the first one, ``branch_2``, ``branch_3``, ... for the others.
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
    """A film material: its energy function and a published set of starting values.

    Parameters
    ----------
    name : str
        As written in a rig file.
    energy : callable
        ``energy(stretch_1, stretch_2, *elastic parameters)``, J/m³.
    elastic : tuple of Parameter
        Parameters of `energy`, in its order.
    branches : tuple of Branch
        Maxwell branches, none for a purely elastic material.
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
        """All parameters of the material: elastic, those of the branches, permittivity."""
        of_branches = (parameter for branch in self.branches for parameter in (branch.modulus, branch.time))
        return (*self.elastic, *of_branches, self.permittivity)


def _vhb(name: str) -> Material:
    wang = "Wang, Decker, Henann & Chester, J. Mech. Phys. Solids 95 (2016) 213"
    return Material(
        name=name,
        energy=gent,
        elastic=(
            Parameter(
                name="shear_modulus", value=25e3, unit="Pa", lower=5e3, upper=200e3, scale=Scale.LOGARITHMIC,
                source="middle of the published range for VHB at rest, 14 to 45 kPa",
            ),
            Parameter(
                name="stretch_limit", value=107.0, unit="1", lower=40.0, upper=1e4, scale=Scale.RECIPROCAL,
                source=f"3(lambda_L^2 - 1) with lambda_L = 5.99, {wang}",
            ),
        ),
        branches=(
            Branch(
                name="branch",
                modulus=Parameter(
                    name="branch_modulus", value=26.06e3, unit="Pa", lower=1.0, upper=1e6, scale=Scale.LOGARITHMIC,
                    source=f"first branch, {wang}",
                ),
                time=Parameter(
                    name="branch_time", value=0.6074, unit="s", lower=0.02, upper=20.0, scale=Scale.LOGARITHMIC,
                    source=f"first branch, {wang}",
                ),
            ),
        ),
        permittivity=Parameter(
            name="permittivity", value=4.5, unit="1", lower=1.5, upper=10.0, scale=Scale.LOGARITHMIC,
            source="published values for stretched VHB lie between 3.5 and 4.7",
        ),
    )  # fmt: skip


MATERIALS: Mapping[str, Material] = MappingProxyType({n: _vhb(n) for n in ("VHB 4905", "VHB 4910")})
"""Materials by the name that a rig file uses."""


def material(name: str) -> Material:
    """The material of that name.

    Parameters
    ----------
    name : str
        A key of `MATERIALS`.

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
        raise RigError(
            f"unknown material {name!r}{nearest(name, MATERIALS)} (known: {', '.join(MATERIALS)})"
        ) from None
