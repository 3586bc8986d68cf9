"""Laws of the film's permittivity: with stretch, with time, at random, and with a polarisation that lags."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arrays import require_generator
from deatwin.plant.errors import DataError
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY, electric_energy

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

    For VHB 4910 the literature quotes 4.68 and c = -0.053 from the unstretched state, fitted to values of Wissler &
    Mazza: 4.68, 3.71, 3.34 and 2.62 at equal stretches of 1, 3, 4 and 5, which the law reproduces within 5 %. Others
    found hardly any change of permittivity, so a fit may start from c = -0.053 or from c = 0.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    permittivity : casadi.SX or float
        :math:`\varepsilon_0^r`, relative permittivity at the stretches `from_1` and `from_2`.
    slope : casadi.SX or float
        c, relative change per unit of stretch; zero or negative.
    from_1, from_2 : casadi.SX or float
        :math:`\lambda_{01}, \lambda_{02}`, stretches at which `permittivity` holds: 1 for the unstretched tape, the
        prestretch for a value measured on a film in its frame.

    Returns
    -------
    casadi.SX or float
        Relative permittivity.

    References
    ----------
    Zhao & Suo, J. Appl. Phys. 104 (2008) 123530, doi:10.1063/1.3031483 (numbers unconfirmed).
    """
    return permittivity * (1 + slope * (stretch_1 + stretch_2 - from_1 - from_2))


def relaxing(time: Symbol, permittivity: Symbol, relative_change: Symbol, time_constant: Symbol) -> Symbol:
    r"""Permittivity that relaxes from one value to another, :math:`\varepsilon[1 + a(1 - e^{-t/\tau})]`.

    Parameters
    ----------
    time : casadi.SX or float
        t, time since the relaxation began, s; before the relaxation, the permittivity has its first value.
    permittivity : casadi.SX or float
        First relative permittivity.
    relative_change : casadi.SX or float
        a, the final change divided by the first value; above -1.
    time_constant : casadi.SX or float
        :math:`\tau` in s.

    Returns
    -------
    casadi.SX or float
        Relative permittivity.
    """
    return permittivity * (1 + relative_change * (1 - ca.exp(-ca.fmax(time, 0.0) / time_constant)))


def random_walk(
    rng: np.random.Generator,
    duration: float,
    interval: float,
    permittivity: float,
    spread: float = 0.05,
    spread_time: float = 1000.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""Draw a permittivity whose logarithm is a Wiener process, so that it never becomes negative.

    .. math:: \ln\frac{\varepsilon(t_{k+1})}{\varepsilon(t_k)} \sim
              \mathcal N\Bigl(0,\; s^2\,\frac{t_{k+1} - t_k}{T}\Bigr)

    Parameters
    ----------
    rng : numpy.random.Generator
        Random generator for the steps.
    duration : float
        Duration of the track, s; rounded up to whole intervals.
    interval : float
        Time between two values, s; between two values the permittivity changes linearly.
    permittivity : float
        Relative permittivity at the start.
    spread : float
        s, the standard deviation of the relative change over `spread_time`.
    spread_time : float
        T in s, the time over which `spread` holds.

    Returns
    -------
    times : (n,) array
        Times from 0 to at least the duration, s.
    values : (n,) array
        Relative permittivity at those times.

    Raises
    ------
    DataError
        If a time or the permittivity is not above 0, or the spread is negative.
    """
    require_generator(rng)
    if not (duration > 0 and interval > 0 and spread_time > 0 and spread >= 0 and permittivity > 0):
        raise DataError(
            f"random walk over {duration:g} s in steps of {interval:g} s, spread {spread:g} in {spread_time:g} s from "
            f"permittivity {permittivity:g}: times and permittivity must be above 0 and the spread not below"
        )
    # Slightly less than the quotient, so that rounding does not add an interval to a whole number of them.
    n_steps = int(np.ceil(duration / interval * (1 - 1e-12)))
    steps = spread * np.sqrt(interval / spread_time) * rng.standard_normal(n_steps)
    logarithms = np.zeros(n_steps + 1)
    np.cumsum(steps, out=logarithms[1:])
    return interval * np.arange(n_steps + 1.0), permittivity * np.exp(logarithms)


def displacement(field: Symbol, permittivity: Symbol, polarisation: Symbol) -> Symbol:
    r"""Electric displacement :math:`D = \varepsilon_\infty\varepsilon_0E + P` with a lagging polarisation P.

    Parameters
    ----------
    field : casadi.SX or float
        E, true field, V/m.
    permittivity : casadi.SX or float
        :math:`\varepsilon_\infty`, instantaneous relative permittivity.
    polarisation : casadi.SX or float
        P, the polarisation that follows `polarisation_rate`, C/m².

    Returns
    -------
    casadi.SX or float
        Electric displacement, C/m².
    """
    return permittivity * VACUUM_PERMITTIVITY * field + polarisation


def polarisation_rate(field: Symbol, polarisation: Symbol, step: Symbol, time_constant: Symbol) -> Symbol:
    r"""Rate of a Debye relaxation, :math:`\dot P = (\Delta\varepsilon\,\varepsilon_0E - P)/\tau`.

    Under a harmonic field of the angular frequency :math:`\omega`, the displacement D satisfies
    :math:`D/(\varepsilon_0E) = \varepsilon_\infty + \Delta\varepsilon/(1 + i\omega\tau)` with the instantaneous
    relative permittivity :math:`\varepsilon_\infty`.

    Parameters
    ----------
    field : casadi.SX or float
        E, true field, V/m.
    polarisation : casadi.SX or float
        P in C/m².
    step : casadi.SX or float
        :math:`\Delta\varepsilon`, the final increase of the relative permittivity.
    time_constant : casadi.SX or float
        :math:`\tau` in s.

    Returns
    -------
    casadi.SX or float
        Rate, C/(m² s).

    References
    ----------
    Debye, Polar Molecules (1929), chapter 5.
    """
    return (step * VACUUM_PERMITTIVITY * field - polarisation) / time_constant


def polarised_energy(
    stretch_1: Symbol,
    stretch_2: Symbol,
    permittivity: Symbol,
    nominal_field: Symbol,
    polarisation: Symbol,
    step: Symbol,
) -> Symbol:
    r"""Electric co-energy per volume with a lagging polarisation.

    .. math:: w = -\tfrac12\varepsilon_\infty\varepsilon_0E^2 - PE + \frac{P^2}{2\Delta\varepsilon\,\varepsilon_0},
              \qquad E = \tilde E\lambda_1\lambda_2

    Its derivative with respect to a stretch gives the Maxwell stress -E D instead of :math:`-\varepsilon E^2`, with the
    true field E and the displacement D; its derivative with respect to P drives `polarisation_rate`, which dissipates
    :math:`\tau\dot P^2/(\Delta\varepsilon\,\varepsilon_0) \ge 0`. The model assumes that a sudden stretch does not
    change P, the polarisation per volume; another choice would be that a sudden stretch does not change the lengths of
    the dipoles.

    Parameters
    ----------
    stretch_1, stretch_2 : casadi.SX or float
        :math:`\lambda_1, \lambda_2`, principal in-plane stretches.
    permittivity : casadi.SX or float
        :math:`\varepsilon_\infty`, instantaneous relative permittivity.
    nominal_field : casadi.SX or float
        :math:`\tilde E`, voltage divided by the undeformed thickness, V/m.
    polarisation : casadi.SX or float
        P in C/m².
    step : casadi.SX or float
        :math:`\Delta\varepsilon`, the final increase of the relative permittivity; above 0.

    Returns
    -------
    casadi.SX or float
        Co-energy density, J/m³.
    """
    field = nominal_field * stretch_1 * stretch_2
    at_once = electric_energy(stretch_1, stretch_2, permittivity, nominal_field)
    return at_once - polarisation * field + polarisation**2 / (2 * step * VACUUM_PERMITTIVITY)
