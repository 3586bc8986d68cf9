"""Breakdown field of a VHB film, by thickness and stretch."""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Any

Symbol = Any  # a CasADi SX, MX, DM, a float or an array


@dataclass(frozen=True, kw_only=True)
class BreakdownLaw:
    r"""Power law of the breakdown field of a film, :math:`E_B = E_1\,(h/h_1)^p\,\lambda^q`.

    h is the present thickness of the film and :math:`\lambda` its equal-biaxial stretch. There are two laws with
    published numbers: `HUANG_2012`, for films between stiff polymers, where voltage cannot thin or crease the film, and
    `KOFOD_2001`, for films in actuators.

    Parameters
    ----------
    field : float
        :math:`E_1`, breakdown field of an unstretched film of thickness :math:`h_1`, V/m.
    thickness : float
        :math:`h_1`, the thickness to which `field` belongs, m.
    thickness_power : float
        p, the exponent of the thickness; negative if a thinner film withstands a higher field.
    stretch_power : float
        q, the exponent of the stretch.
    source : str
        Publication from which the numbers are taken.
    """

    field: float
    thickness: float
    thickness_power: float
    stretch_power: float
    source: str

    def at(self, thickness: Symbol, stretch_1: Symbol, stretch_2: Symbol) -> Symbol:
        r"""Return the true field at breakdown.

        Parameters
        ----------
        thickness : casadi.SX, float or array
            Present thickness :math:`H/(\lambda_1\lambda_2)`, m.
        stretch_1, stretch_2 : casadi.SX, float or array
            Principal in-plane stretches. The stretch in the law is assumed to be :math:`\sqrt{\lambda_1\lambda_2}`; the
            published films had equal stretches.

        Returns
        -------
        casadi.SX, float or array
            Field, V/m.

        Examples
        --------
        >>> round(HUANG_2012.at(0.5e-3 / 3.5**2, 3.5, 3.5) / 1e6)
        250
        """
        stretch = (stretch_1 * stretch_2) ** 0.5
        return self.field * (thickness / self.thickness) ** self.thickness_power * stretch**self.stretch_power


HUANG_2012 = BreakdownLaw(
    field=51e6,
    thickness=1e-3,
    thickness_power=-0.25,
    stretch_power=0.63,
    source="Huang, Shian, Diebold, Suo & Clarke, Appl. Phys. Lett. 101 (2012) 122905, doi:10.1063/1.4754549: "
    "51 h^-0.25 lambda^0.63, films embedded in a stiff polymer; that h is in mm and the field in MV/m is inferred",
)
"""Breakdown law of Huang et al. for films between stiff polymers, where voltage cannot thin or crease the film."""

KOFOD_2001 = BreakdownLaw(
    field=20e6,
    thickness=1e-3,
    thickness_power=0.0,
    stretch_power=log(218 / 20) / log(6),
    source="Kofod, Kornbluh, Pelrine & Sommer-Larsen, SPIE Smart Structures and Materials (2001), abstract: 20 MV/m "
    "unstrained, 218 MV/m at 500 % x 500 % strain; a power law through the two, whose thickness goes with the stretch",
)
"""Breakdown law of Kofod et al. for films in actuators.

The breakdown fields are lower than those of `HUANG_2012`, because voltage thins a soft film before breakdown.
"""
