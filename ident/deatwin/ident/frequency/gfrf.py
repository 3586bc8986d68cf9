"""Generalised frequency response functions of polynomial NARX models."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.frequency.hierarchy import solve_parts
from deatwin.ident.frequency.parts import FORMS
from deatwin.ident.frequency.response import FrequencyResponse, FrequencyStatus
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import read_only
from deatwin.plant.errors import ModelError, nearest

__all__ = ["frequency_grid", "gfrf"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_BLOCK = 8192  # values of a block fit into the processor's cache, and bound the memory
_HIGHEST = 8  # 3^n products of parts; beyond this nobody waits


def gfrf(
    model: NarxModel,
    order: int,
    omega: ArrayLike,
    *,
    operating_input: ArrayLike | None = None,
    form: str = "symmetric",
) -> FrequencyResponse:
    """Compute the generalised frequency response H_n of a model about an operating point.

    The input A_1 e^(jw_1 t) + ... + A_n e^(jw_n t) about the operating input makes n! H_n(w_1..w_n) A_1 ... A_n
    e^(j(w_1+...+w_n)t) in the output, H_n being symmetric.

    Parameters
    ----------
    model : NarxModel
        Model of one input and one output.
    order : int
        n, from 1 to 8.
    omega : array_like, shape (n,) for order 1, else (n, order)
        Angular frequencies in rad/s, each up to half the sampling rate on either side; see `frequency_grid`.
    operating_input : float, optional
        Constant input about which the model is expanded, in the input's unit; the centre of the training
        data by default (0 when there is none, as after `remove_dc`).
    form : str
        "symmetric" for the one that does not change with the order of the frequencies; "recursive" for the one of
        the same mean over all permutations that the recursion of Peyton Jones and Billings gives.

    Returns
    -------
    FrequencyResponse
        In output unit by power n of the input unit, with its covariance from that of the parameters.

    Raises
    ------
    ModelError
        If the order or the form is not available, the model has several inputs or no equilibrium, or a frequency is
        too high.

    References
    ----------
    Peyton Jones, Billings, "Recursive algorithm for computing the frequency response of a class of non-linear
    difference equation models", Int. J. Control 50 (1989) 1925-1940, doi:10.1080/00207178908953472.
    Ridler, Salter, "An approach to the treatment of uncertainty in complex S-parameter measurements",
    Metrologia 39 (2002) 295-302, doi:10.1088/0026-1394/39/3/6.
    """
    if not isinstance(order, int | np.integer) or not 1 <= order <= _HIGHEST:
        raise ModelError(f"order = {order!r}; it must be an integer from 1 to {_HIGHEST}")
    if form not in FORMS:
        raise ModelError(f"form = {form!r}{nearest(str(form), FORMS)}; known are {' and '.join(FORMS)}")
    require_one_input(model)
    frequencies = _checked(model, order, omega)
    about = deviations(model, operating_input)
    angles = (frequencies if order > 1 else frequencies[:, None]) * model.sample_time
    return FrequencyResponse(
        symbol="H",
        order=int(order),
        values=_values(about, angles, form),
        omega=frequencies,
        point=about.point,
        status=FrequencyStatus.at(about.point),
        unit=unit_of(model, order),
        theta_cov=model.theta_cov,
        differentiate=partial(_gradient, about, angles, form),
    )


def frequency_grid(*axes: ArrayLike) -> Array:
    """Return all combinations of frequencies, the last running fastest.

    Parameters
    ----------
    *axes : array_like, shape (n_i,)
        Frequencies of each tone, rad/s.

    Returns
    -------
    ndarray, shape (n_1 n_2 ..., number of axes)
        As `gfrf` takes them.
    """
    return np.stack([m.ravel() for m in np.meshgrid(*(np.asarray(a, float) for a in axes), indexing="ij")], axis=-1)


def require_one_input(model: NarxModel) -> None:
    """Raise ModelError unless a model has one input.

    Parameters
    ----------
    model : NarxModel
        The model.

    Raises
    ------
    ModelError
        With the number of inputs.
    """
    if len(model.input_names) != 1:
        raise ModelError(
            f"the model has {len(model.input_names)} inputs; frequency responses are computed for one input"
        )


def unit_of(model: NarxModel, order: int) -> str:
    """Return output unit by power of the input unit; empty where one is unknown.

    Parameters
    ----------
    model : NarxModel
        Of one input and one output.
    order : int
        The power.
    """
    output_unit, input_unit = model.output_units[0], model.input_units[0]
    if not (output_unit and input_unit):
        return ""
    return f"{output_unit}/{input_unit}" + (f"^{order}" if order > 1 else "")


def _checked(model: NarxModel, order: int, omega: ArrayLike) -> Array:
    given = read_only(np.atleast_1d(np.asarray(omega, dtype=np.float64)))
    if order > 1 and given.shape == (order,):
        given = given[None, :]
    elif order == 1 and given.ndim == 2 and given.shape[1] == 1:
        given = given[:, 0]
    wanted = "(n,)" if order == 1 else f"(n, {order})"
    if given.ndim != min(order, 2) or (order > 1 and given.shape[1] != order):
        raise ModelError(f"omega has the shape {given.shape}; order {order} needs {wanted}, in rad/s")
    nyquist = np.pi / model.sample_time
    wrong = ~(np.abs(given) <= nyquist * (1 + 1e-9))
    if wrong.any():
        raise ModelError(
            f"omega holds {given[wrong][0]:g} rad/s; frequencies go up to half the sampling rate, {nyquist:.6g} rad/s"
        )
    return given


def _values(about: Deviations, angles: Array, form: str) -> Complex:
    values = np.zeros(len(angles), dtype=np.complex128)
    for block in _blocks(len(angles)):
        tones = FORMS[form](angles[block])
        jet = solve_parts(about.model.terms, about.model.theta, tones, by_theta=False).get(tones.whole)
        if jet is not None:
            values[block] = jet.value / tones.repeats
    return values


def _gradient(about: Deviations, angles: Array, form: str) -> Complex:
    gradient = np.zeros((len(angles), about.jacobian.shape[1]), dtype=np.complex128)
    for block in _blocks(len(angles), 1 + len(about.model.terms)):
        tones = FORMS[form](angles[block])
        jet = solve_parts(about.model.terms, about.model.theta, tones, by_theta=True).get(tones.whole)
        if jet is not None and jet.slope is not None:
            gradient[block] = jet.slope.T @ about.jacobian / tones.repeats
    return gradient


def _blocks(count: int, values: int = 1) -> list[slice]:
    size = max(1, _BLOCK // values)
    return [slice(first, first + size) for first in range(0, count, size)]
