"""Electrostatics of the film."""

from __future__ import annotations

from typing import Any

__all__ = ["VACUUM_PERMITTIVITY", "electric_energy"]

VACUUM_PERMITTIVITY = 8.8541878188e-12
"""F/m, CODATA 2022."""


def electric_energy(stretch_1: Any, stretch_2: Any, permittivity: Any, nominal_field: Any) -> Any:
    r"""Co-energy of the field per reference volume under voltage control.

    .. math:: w_e = -\tfrac{\varepsilon_r\varepsilon_0}{2}\tilde E^2(\lambda_1\lambda_2)^2

    Its derivative by a stretch is the Maxwell stress :math:`\varepsilon E^2` of an ideal dielectric elastomer.

    Parameters
    ----------
    stretch_1, stretch_2 : symbol or float
        Principal in-plane stretches.
    permittivity : symbol or float
        Relative permittivity.
    nominal_field : symbol or float
        Voltage over the undeformed thickness, V/m.

    Returns
    -------
    symbol or float
        J/m³.

    References
    ----------
    Suo, Acta Mech. Solida Sin. 23 (2010) 549, doi:10.1016/S0894-9166(11)60004-9.
    """
    return -permittivity * VACUUM_PERMITTIVITY / 2 * nominal_field**2 * (stretch_1 * stretch_2) ** 2
