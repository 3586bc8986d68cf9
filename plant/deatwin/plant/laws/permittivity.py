"""Laws of the film's permittivity: with stretch and with time."""

from __future__ import annotations

from typing import Any

import casadi as ca

Symbol = Any  # a CasADi SX, MX, DM or a float


def stretched(
    stretch_1: Symbol,
    stretch_2: Symbol,
    permittivity: Symbol,
    slope: Symbol,
    from_1: Symbol = 1.0,
    from_2: Symbol = 1.0,
) -> Symbol:
    r"""Permittivity that depends linearly on the stretches.

    .. math:: \varepsilon = \varepsilon_0^r\,\bigl[1 + c\,(\lambda_1 + \lambda_2 - \lambda_{01} - \lambda_{02})\bigr]

    For VHB 4910, the literature quotes a permittivity of 4.68 without stretch and c = -0.053. The law then reproduces
    within 5 % the values of Wissler & Mazza: 4.68, 3.71, 3.34 and 2.62 at equal stretches of 1, 3, 4 and 5. Other
    authors found hardly any change of the permittivity.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, the principal in-plane stretches.
    permittivity : casadi.SX or float
        :math:`\varepsilon_0^r`, the relative permittivity at the stretches `from_1` and `from_2`.
    slope : casadi.SX or float
        c, the relative change per unit of stretch; zero or negative for VHB.
    from_1, from_2 : casadi.SX or float
        :math:`\lambda_{01}, \lambda_{02}`, the stretches at which `permittivity` was measured: 1 for unstretched film,
        or the prestretch for a film in a frame.

    Returns
    -------
    casadi.SX or float
        Relative permittivity.

    References
    ----------
    Zhao & Suo, J. Appl. Phys. 104 (2008) 123530, doi:10.1063/1.3031483 (not checked against the
    publication).
    """
    return permittivity * (1 + slope * (stretch_1 + stretch_2 - from_1 - from_2))


def relaxing(time: Symbol, permittivity: Symbol, relative_change: Symbol, time_constant: Symbol) -> Symbol:
    r"""Permittivity that relaxes from one value to another, :math:`\varepsilon[1 + a(1 - e^{-t/\tau})]`.

    Parameters
    ----------
    time : casadi.SX or float
        t, the time since the relaxation began, s; a negative time gives the initial value.
    permittivity : casadi.SX or float
        :math:`\varepsilon`, the initial relative permittivity.
    relative_change : casadi.SX or float
        a, the final change divided by the initial value; above -1.
    time_constant : casadi.SX or float
        :math:`\tau`, the time constant of the relaxation, s.

    Returns
    -------
    casadi.SX or float
        Relative permittivity.
    """
    return permittivity * (1 + relative_change * (1 - ca.exp(-ca.fmax(time, 0.0) / time_constant)))
