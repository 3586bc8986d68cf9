r"""Electrostatics of the film: energies, Maxwell stress and strain, electrostriction, capacitance, conduction.

The co-energy gives the in-plane stress :math:`-\varepsilon E^2`. For an incompressible film, this is the same load as a
pressure :math:`\varepsilon E^2` on its faces. The thesis' factor one half (W. R. Jacobs, eq. 2.2) counts only the
attraction of the electrodes: a free elastomer contracts by twice as much, and a film clamped sideways not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from deatwin.plant.laws.stress import true_stress

Symbol = Any  # a CasADi SX, MX, DM or a float

VACUUM_PERMITTIVITY = 8.8541878188e-12
"""Vacuum permittivity, F/m (CODATA 2022)."""


def electric_energy(stretch_1: Any, stretch_2: Any, permittivity: Any, nominal_field: Any) -> Any:
    r"""Electric co-energy per reference volume under voltage control.

    .. math:: w_e = -\tfrac{\varepsilon_r\varepsilon_0}{2}\tilde E^2(\lambda_1\lambda_2)^2

    :math:`\varepsilon_0` is the permittivity of vacuum. For a constant permittivity,
    :math:`\lambda_i\,\partial w_e/\partial\lambda_i = -\varepsilon_r\varepsilon_0E^2` with the true field E: the
    magnitude is the Maxwell stress.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, the principal in-plane stretches.
    permittivity : casadi.SX or float
        :math:`\varepsilon_r`, the relative permittivity.
    nominal_field : casadi.SX or float
        :math:`\tilde E`, the voltage divided by the undeformed thickness, V/m.

    Returns
    -------
    casadi.SX or float
        Co-energy density, J/m³.

    References
    ----------
    Suo, Acta Mech. Solida Sin. 23 (2010) 549, doi:10.1016/S0894-9166(11)60004-9.
    """
    return -permittivity * VACUUM_PERMITTIVITY / 2 * nominal_field**2 * (stretch_1 * stretch_2) ** 2


def maxwell_stress(permittivity: Symbol, field: Symbol) -> Symbol:
    r"""Maxwell stress :math:`\varepsilon_r\varepsilon_0E^2` of the field across a film.

    The stress acts as a pressure on the faces of the film or, equivalently, as a loss of in-plane tension.

    Parameters
    ----------
    permittivity : casadi.SX or float
        :math:`\varepsilon_r`, the relative permittivity.
    field : casadi.SX or float
        E, the true field: voltage divided by the present thickness, V/m.

    Returns
    -------
    casadi.SX or float
        Stress, Pa.

    References
    ----------
    Pelrine, Kornbluh & Joseph, Sens. Actuators A 64 (1998) 77, doi:10.1016/S0924-4247(97)01657-9.
    """
    return permittivity * VACUUM_PERMITTIVITY * field**2


def maxwell_strain(
    permittivity: Symbol, field: Symbol, elastic_modulus: Symbol, poissons_ratio: Symbol = 0.5
) -> Symbol:
    r"""Thickness strain of a free film under small Maxwell stress, :math:`-\tfrac12(1+2\nu)\,\varepsilon E^2/Y`.

    The in-plane strain of an incompressible film is half the magnitude of this strain. With :math:`\nu` = 0, the
    equation is eq. 2.2 of the thesis of W. R. Jacobs, which includes only the attraction of the electrodes. For a
    neo-Hookean film, the relative error of the equation is 0.4 % at 10 % strain, and 7 % at pull-in (37 % strain).

    Parameters
    ----------
    permittivity : casadi.SX or float
        Relative permittivity :math:`\varepsilon/\varepsilon_0`, independent of strain.
    field : casadi.SX or float
        E, the true field: voltage divided by the present thickness, V/m.
    elastic_modulus : casadi.SX or float
        Y, the elastic modulus, Pa; three times the shear modulus of an incompressible film.
    poissons_ratio : casadi.SX or float
        :math:`\nu`, Poisson's ratio; one half for an incompressible film.

    Returns
    -------
    casadi.SX or float
        Strain, dimensionless, negative.
    """
    return -(1 + 2 * poissons_ratio) / 2 * maxwell_stress(permittivity, field) / elastic_modulus


def electrostrictive_strain(permittivity: Symbol, field: Symbol, coefficient: Symbol) -> Symbol:
    r"""Thickness strain of a film due to weak electrostriction, :math:`Q\varepsilon_0^2(\varepsilon_r - 1)^2E^2`.

    The strain is proportional to the square of the polarisation :math:`\varepsilon_0(\varepsilon_r - 1)E`. The equation
    is eq. 2.1 of the thesis of W. R. Jacobs.

    Parameters
    ----------
    permittivity : casadi.SX or float
        :math:`\varepsilon_r`, the relative permittivity.
    field : casadi.SX or float
        E, the true field: voltage divided by the present thickness, V/m.
    coefficient : casadi.SX or float
        Q, the electrostrictive coefficient, m⁴/C²; negative if the film becomes thinner.

    Returns
    -------
    casadi.SX or float
        Strain, dimensionless.
    """
    return coefficient * (VACUUM_PERMITTIVITY * (permittivity - 1) * field) ** 2


def effective_permittivity(permittivity: Symbol, coefficient: Symbol, elastic_modulus: Symbol) -> Symbol:
    r"""Relative permittivity that contains the effect of electrostriction at small strain.

    .. math:: \varepsilon_\mathrm{eff} = \varepsilon_r - Y Q\,\varepsilon_0(\varepsilon_r - 1)^2

    With this permittivity, Maxwell stress alone causes the same strain as Maxwell stress and electrostriction together,
    because both strains are proportional to the square of the field. A measurement of displacement over voltage
    therefore cannot distinguish the two, whereas a measurement of capacitance can.

    Parameters
    ----------
    permittivity : casadi.SX or float
        :math:`\varepsilon_r`, the relative permittivity.
    coefficient : casadi.SX or float
        Q, the electrostrictive coefficient as in `electrostrictive_strain`, m⁴/C².
    elastic_modulus : casadi.SX or float
        Y, the elastic modulus of the incompressible film, Pa.

    Returns
    -------
    casadi.SX or float
        Effective relative permittivity, dimensionless.
    """
    return permittivity - elastic_modulus * coefficient * VACUUM_PERMITTIVITY * (permittivity - 1) ** 2


def electrostriction_factors(
    permittivity: Callable[..., Symbol], stretch_1: Symbol, stretch_2: Symbol, *parameters: Symbol
) -> tuple[Symbol, Symbol]:
    r"""Factors by which a permittivity that depends on the stretches multiplies the Maxwell stress.

    .. math:: f_i = 1 + \tfrac12\,\frac{\partial\ln\varepsilon}{\partial\ln\lambda_i}, \qquad
              \sigma_i = -f_i\,\varepsilon E^2

    :math:`\sigma_i` is the electric stress in direction i and E the true field. The dependence of
    :math:`\varepsilon(\lambda_1, \lambda_2)` on the stretches describes electrostriction at large strain. The factors
    follow from the co-energy: if such a permittivity is passed to `electric_energy`, the derivatives of the energy
    already contain the factors.

    Parameters
    ----------
    permittivity : callable
        Function ``permittivity(stretch_1, stretch_2, *parameters)`` that returns :math:`\varepsilon`, such as
        `deatwin.plant.laws.stretched`.
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, the principal in-plane stretches.
    *parameters : casadi.SX or float
        Further arguments of `permittivity`.

    Returns
    -------
    tuple of casadi.SX
        :math:`f_1` and :math:`f_2`, dimensionless.

    References
    ----------
    Zhao & Suo, J. Appl. Phys. 104 (2008) 123530, doi:10.1063/1.3031483.
    """
    here = permittivity(stretch_1, stretch_2, *parameters)
    # The operator that turns an energy into a true stress, applied to the permittivity.
    first, second = true_stress(permittivity, stretch_1, stretch_2, *parameters)
    return 1 + first / here / 2, 1 + second / here / 2


def capacitance(
    permittivities: Sequence[Symbol],
    stretches: Sequence[tuple[Symbol, Symbol]],
    areas: Sequence[Symbol],
    thickness: Symbol,
) -> Symbol:
    r"""Capacitance of a film between electrodes, :math:`C = \sum_k \varepsilon_k(\lambda_1\lambda_2)_k^2A_k/H`.

    The sum is over points k that represent parts of the film.

    Parameters
    ----------
    permittivities : sequence of casadi.SX or float
        :math:`\varepsilon_k/\varepsilon_0`, the relative permittivity at each point.
    stretches : sequence of pairs of casadi.SX or float
        :math:`\lambda_1, \lambda_2`, the principal in-plane stretches at each point.
    areas : sequence of casadi.SX or float
        :math:`A_k`, the undeformed area of the part of the film that each point represents, m².
    thickness : casadi.SX or float
        H, the undeformed thickness of the film, m.

    Returns
    -------
    casadi.SX or float
        Capacitance, F.
    """
    points = zip(permittivities, stretches, areas, strict=True)
    return VACUUM_PERMITTIVITY / thickness * sum(e * (first * second) ** 2 * a for e, (first, second), a in points)


def conduction_density(field: Symbol, conductivity: Symbol = 3.23e-14, field_scale: Symbol = 40e6) -> Symbol:
    r"""Density of the conduction current through the film, :math:`j = \sigma_0\,e^{|E|/E_B}\,E`.

    The default values of :math:`\sigma_0` and :math:`E_B` are quoted from literature that cites the reference below;
    they have not been checked in the reference itself.

    Parameters
    ----------
    field : casadi.SX or float
        E, the true field: voltage divided by the present thickness, V/m.
    conductivity : casadi.SX or float
        :math:`\sigma_0`, the conductivity at low field, S/m.
    field_scale : casadi.SX or float
        :math:`E_B`, the field that increases the conductivity by a factor of e, V/m.

    Returns
    -------
    casadi.SX or float
        Current density per present area, A/m².

    References
    ----------
    Foo, Koh, Keplinger, Kaltseis, Bauer & Suo, J. Appl. Phys. 111 (2012) 094107, doi:10.1063/1.4714557.
    """
    return conductivity * ca.exp(ca.fabs(field) / field_scale) * field
