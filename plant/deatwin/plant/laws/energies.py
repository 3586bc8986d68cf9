r"""Hyperelastic energies of an incompressible film per reference volume, as functions of the in-plane stretches.

Each is zero at rest and takes CasADi symbols or floats. The elastic modulus at small strain is :math:`3\mu_0`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import casadi as ca

from deatwin.plant.errors import ModelError

Symbol = Any  # a CasADi SX, MX, DM or a float


def first_invariant(stretch_1: Symbol, stretch_2: Symbol) -> Symbol:
    r"""First invariant of a film's strain, :math:`I_1 = \lambda_1^2 + \lambda_2^2 + (\lambda_1\lambda_2)^{-2}`.

    The film is incompressible.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.

    Returns
    -------
    casadi.SX or float
        Invariant, dimensionless.
    """
    return stretch_1**2 + stretch_2**2 + 1 / (stretch_1 * stretch_2) ** 2


def second_invariant(stretch_1: Symbol, stretch_2: Symbol) -> Symbol:
    r"""Second invariant of a film's strain, :math:`I_2 = \lambda_1^{-2} + \lambda_2^{-2} + (\lambda_1\lambda_2)^2`.

    The film is incompressible.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.

    Returns
    -------
    casadi.SX or float
        Invariant, dimensionless.
    """
    return first_invariant(1 / stretch_1, 1 / stretch_2)


def neo_hookean(stretch_1: Symbol, stretch_2: Symbol, shear_modulus: Symbol) -> Symbol:
    r"""Neo-Hookean energy :math:`W = \tfrac{\mu}{2}(I_1 - 3)`; the initial shear modulus is :math:`\mu`.

    :math:`I_1` is the first invariant; see `first_invariant`.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    shear_modulus : casadi.SX or float
        :math:`\mu` in Pa.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume, J/m³.
    """
    return shear_modulus / 2 * (first_invariant(stretch_1, stretch_2) - 3)


def mooney_rivlin(stretch_1: Symbol, stretch_2: Symbol, first: Symbol, second: Symbol) -> Symbol:
    r"""Mooney-Rivlin energy :math:`W = C_1(I_1 - 3) + C_2(I_2 - 3)`; the initial shear modulus is :math:`2(C_1 + C_2)`.

    :math:`I_1` and :math:`I_2` are the invariants; see `first_invariant` and `second_invariant`.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    first, second : casadi.SX or float
        :math:`C_1, C_2` in Pa.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume, J/m³.

    References
    ----------
    Mooney, J. Appl. Phys. 11 (1940) 582, doi:10.1063/1.1712836.
    """
    return first * (first_invariant(stretch_1, stretch_2) - 3) + second * (second_invariant(stretch_1, stretch_2) - 3)


def yeoh(stretch_1: Symbol, stretch_2: Symbol, first: Symbol, second: Symbol, third: Symbol) -> Symbol:
    r"""Yeoh energy :math:`W = \sum_{k=1}^{3} C_k(I_1 - 3)^k`; the initial shear modulus is :math:`2C_1`.

    :math:`I_1` is the first invariant; see `first_invariant`.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    first, second, third : casadi.SX or float
        :math:`C_1, C_2, C_3` in Pa; in publications often :math:`C_{10}, C_{20}, C_{30}`.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume, J/m³.

    References
    ----------
    Yeoh, Rubber Chem. Technol. 66 (1993) 754, doi:10.5254/1.3538343.
    """
    extension = first_invariant(stretch_1, stretch_2) - 3
    return extension * (first + extension * (second + extension * third))


def ogden(stretch_1: Symbol, stretch_2: Symbol, *terms: Symbol) -> Symbol:
    r"""Ogden energy with any number of terms.

    .. math:: W = \sum_p \frac{\mu_p}{\alpha_p}\bigl(\lambda_1^{\alpha_p} + \lambda_2^{\alpha_p}
              + \lambda_3^{\alpha_p} - 3\bigr), \qquad \mu_0 = \tfrac12\sum_p\mu_p\alpha_p

    :math:`\lambda_3 = 1/(\lambda_1\lambda_2)` is the stretch across the film and :math:`\mu_0` the initial shear
    modulus. Some programs define the moduli with the factor :math:`2\mu_p/\alpha_p^2` instead of
    :math:`\mu_p/\alpha_p`. Multiply moduli from such a program by :math:`2/\alpha_p`.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    *terms : casadi.SX or float
        Moduli in Pa, each followed by its exponent: :math:`\mu_1, \alpha_1, \mu_2, \alpha_2, \dots`.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume, J/m³.

    Raises
    ------
    ModelError
        If there are no terms, or the last modulus has no exponent.

    References
    ----------
    Ogden, Proc. R. Soc. Lond. A 326 (1972) 565, doi:10.1098/rspa.1972.0026.
    """
    if not terms or len(terms) % 2:
        raise ModelError(f"{len(terms)} terms of an Ogden energy: give pairs of a modulus in Pa and an exponent")
    return sum(
        modulus / exponent * (stretch_1**exponent + stretch_2**exponent + (stretch_1 * stretch_2) ** -exponent - 3)
        for modulus, exponent in zip(terms[::2], terms[1::2], strict=True)
    )


def gent(stretch_1: Symbol, stretch_2: Symbol, shear_modulus: Symbol, stretch_limit: Symbol) -> Symbol:
    r"""Gent energy :math:`W = -\tfrac{\mu J_m}{2}\ln\bigl(1 - (I_1-3)/J_m\bigr)`.

    The initial shear modulus is :math:`\mu`. :math:`I_1` is the first invariant; see `first_invariant`.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    shear_modulus : casadi.SX or float
        :math:`\mu` in Pa.
    stretch_limit : casadi.SX or float
        :math:`J_m`, the value of :math:`I_1 - 3` at which the energy becomes infinite.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume, J/m³.

    References
    ----------
    Gent, Rubber Chem. Technol. 69 (1996) 59, doi:10.5254/1.3538357.
    """
    extension = first_invariant(stretch_1, stretch_2) - 3
    # Beyond the limit the root has no value, so the stress has none; without the root, the stress would have one.
    return -shear_modulus * stretch_limit * ca.log(ca.sqrt(1 - extension / stretch_limit))


def arruda_boyce(stretch_1: Symbol, stretch_2: Symbol, shear_modulus: Symbol, locking_stretch: Symbol) -> Symbol:
    r"""Eight-chain energy of Arruda and Boyce, with Cohen's rational form of the inverse Langevin function.

    .. math:: W = \mu\lambda_L^2\int_{1/\lambda_L}^{z}\beta\,dz', \qquad
              \beta = z\,\frac{3 - z^2}{1 - z^2} \approx \mathcal L^{-1}(z), \qquad
              z = \frac{1}{\lambda_L}\sqrt{\frac{I_1}{3}}

    :math:`I_1` is the first invariant; see `first_invariant`. :math:`\mathcal L^{-1}` is the inverse Langevin function.
    The error of Cohen's form is largest near z = 0.80, where the form exceeds the exact function by 4.94 %. The initial
    shear modulus is :math:`\mu\,\dfrac{1 - \lambda_L^{-2}/3}{1 - \lambda_L^{-2}}`.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    shear_modulus : casadi.SX or float
        :math:`\mu` in Pa.
    locking_stretch : casadi.SX or float
        :math:`\lambda_L`, the chain stretch :math:`\sqrt{I_1/3}` at which the energy becomes infinite. It is the square
        root of the number of links in a chain.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume, J/m³.

    References
    ----------
    Arruda & Boyce, J. Mech. Phys. Solids 41 (1993) 389, doi:10.1016/0022-5096(93)90013-6; Cohen, Rheol. Acta 30
    (1991) 270, doi:10.1007/BF00366640.
    """
    links = locking_stretch**2
    extended = first_invariant(stretch_1, stretch_2) / (3 * links)
    # As in `gent`, with the root the stress has no value beyond the limit.
    logarithm = ca.log(ca.sqrt((1 - extended) / (1 - 1 / links)))
    return shear_modulus * links * ((extended - 1 / links) / 2 - 2 * logarithm)


def maxwell_branch(elastic_1: Symbol, elastic_2: Symbol) -> Symbol:
    r"""Energy density of the spring in a Maxwell branch, divided by its shear modulus, :math:`\tfrac12(I_1^e - 3)`.

    :math:`I_1^e` is the first invariant of the elastic stretches.

    Parameters
    ----------
    elastic_1, elastic_2 : casadi.SX or float
        Elastic stretches of the spring, :math:`\lambda_i^e = \lambda_i/\xi_i`. :math:`\lambda_i` are the stretches of
        the film, and :math:`\xi_i` those of the dashpot.

    Returns
    -------
    casadi.SX or float
        Energy per reference volume divided by the shear modulus of the spring, dimensionless.

    References
    ----------
    Foo et al., J. Appl. Phys. 111 (2012) 034102, doi:10.1063/1.3680878.
    """
    return neo_hookean(elastic_1, elastic_2, 1)


ENERGIES: Mapping[str, Callable[..., Symbol]] = MappingProxyType(
    {law.__name__: law for law in (neo_hookean, mooney_rivlin, yeoh, ogden, gent, arruda_boyce)}
)
"""Energies by the name that a rig file uses."""
