"""Generalised frequency response functions of polynomial NARX models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import real_numbers
from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.frequency.hierarchy import Tones, blocks_of, products_of, solve_parts
from deatwin.ident.frequency.linear import polynomial_model, whole_order
from deatwin.ident.frequency.many import gfrf_of_many
from deatwin.ident.frequency.response import FrequencyResponse, FrequencyStatus, Pointwise
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.variables import symbols_of
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.errors import ModelError, nearest

_BLOCK = 1 << 14  # frequencies in a block, whose arrays then fit into the processor's cache
_HELD = 1 << 23  # complex numbers that the products of a block may hold, 128 MB
HIGHEST_ORDER = 8  # Order n has 3^n products of parts; higher orders take too long


def gfrf(
    model: NarxModel,
    order: int,
    omega: ArrayLike,
    *,
    inputs: Sequence[str] | None = None,
    operating_input: ArrayLike | None = None,
) -> FrequencyResponse:
    """Compute the generalised frequency response H_n of a model about an operating point.

    If the input deviates from the operating input by A_1 e^(jw_1 t) + ... + A_n e^(jw_n t), the output contains the
    component n! H_n(w_1, ..., w_n) A_1 ... A_n e^(j(w_1 + ... + w_n) t). H_n is symmetric in its frequencies. With
    several inputs, each of the n exponentials acts on one input. If these inputs differ, H_n is a cross kernel: it does
    not change if two frequencies are exchanged together with their inputs.

    Parameters
    ----------
    model : NarxModel
        Model of one output.
    order : int
        Order n, from 1 to 8.
    omega : array_like, shape (n_values,) for order 1, else (n_values, order)
        Angular frequencies, rad/s, each between minus and plus half the sampling rate; see `frequency_grid`.
    inputs : sequence of str, length n, optional
        Input on which each exponential acts: its number, such as ``["u1", "u2"]``, or its name in the model. Required
        if the model has several inputs.
    operating_input : float, or array_like of shape (n_inputs,), optional
        Constant input about which the model is expanded, in its unit. By default the mean of the training inputs, or 0
        if the model has no training data.

    Returns
    -------
    FrequencyResponse
        Response H_n, in output units per product of the inputs' units, with the covariance that follows from that of
        the parameters.

    Raises
    ------
    ModelError
        If an argument is invalid; if the model has several outputs, noise terms or no equilibrium; or if frequencies
        add up to that of a pole on the unit circle.

    References
    ----------
    Peyton Jones, Billings, "Recursive algorithm for computing the frequency response of a class of non-linear
    difference equation models", Int. J. Control 50 (1989) 1925-1940, doi:10.1080/00207178908953472.
    Ridler, Salter, "An approach to the treatment of uncertainty in complex S-parameter measurements",
    Metrologia 39 (2002) 295-302, doi:10.1088/0026-1394/39/3/6.

    Examples
    --------
    The model has y = 2 u^2 at rest, so H_2 is 2 if both frequencies are 0:

    >>> model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)^2": 1.0}, sample_time=0.1)
    >>> gfrf(model, 2, [[0.0, 0.0]]).gain
    array([2.])
    """
    order = whole_order(order, HIGHEST_ORDER)
    rows = _rows_of(polynomial_model(model), inputs, order)
    frequencies = checked_frequencies(omega, model.sample_time, order)
    about = deviations(model, operating_input)
    angles = (frequencies if order > 1 else frequencies[:, None]) * model.sample_time
    return FrequencyResponse(
        symbol="H",
        order=order,
        values=values_at(about, angles, rows),
        omega=frequencies,
        point=about.point,
        status=FrequencyStatus.at(about.point),
        unit=unit_of(model, rows),
        inputs=names_of(model, rows),
        theta_cov=model.theta_cov,
        theta_dof=model.theta_dof,
        differentiate=Pointwise(partial(gradient_at, about, rows=rows), angles),
        evaluate=Pointwise(partial(gfrf_of_many, model, about.point, rows), angles),
    )


def frequency_grid(*axes: ArrayLike) -> Array:
    """Return all combinations of frequencies from several lists, as `gfrf` takes them.

    Parameters
    ----------
    *axes : array_like, shape (n_i,)
        Angular frequencies, rad/s: one list for each frequency w_i of the response.

    Returns
    -------
    ndarray, shape (n_1 n_2 ..., number of axes)
        One combination in each row; the last frequency varies fastest.

    Raises
    ------
    ModelError
        If there is no axis, or one is not a list of real numbers.

    Examples
    --------
    >>> frequency_grid([1.0], [2.0, 3.0]).tolist()
    [[1.0, 2.0], [1.0, 3.0]]
    """
    given = [real_numbers(axis, "each axis of the grid") for axis in axes]
    if not given or any(axis.ndim != 1 for axis in given):
        raise ModelError("a grid needs the frequencies of one tone or several, each of shape (n,), in rad/s")
    return np.stack([mesh.ravel() for mesh in np.meshgrid(*given, indexing="ij")], axis=-1)


def require_one_input(model: NarxModel, else_take: str) -> None:
    """Raise ModelError unless a model is polynomial with one input; `else_take` serves several inputs."""
    polynomial_model(model)
    if len(model.input_names) != 1:
        raise ModelError(
            f"the model has {len(model.input_names)} inputs; this is for one input: for several take {else_take}"
        )


def input_row(model: NarxModel, name: str) -> int:
    """Return the row of an input that is given by its name or by its position, such as u2."""
    placed = {f"u{row + 1}": row for row in range(len(model.input_names))}
    known = (placed if len(placed) > 1 else {"u": 0, **placed}) | {n: row for row, n in enumerate(model.input_names)}
    if name not in known:
        raise ModelError(
            f"the model has no input {name!r}{nearest(str(name), list(known))}; there are {', '.join(known)}"
        )
    return known[name]


def names_of(model: NarxModel, rows: Sequence[int]) -> tuple[str, ...]:
    """Return the names of inputs as equations write them; empty for a model with one input."""
    symbols = symbols_of(model.input_names, model.output_names)
    return tuple(symbols["u", row] for row in rows) if len(model.input_names) > 1 else ()


def _rows_of(model: NarxModel, inputs: Sequence[str] | None, order: int) -> tuple[int, ...]:
    """Return the row of the input that carries each tone."""
    count = len(model.input_names)
    if inputs is None:
        if count != 1:
            raise ModelError(
                f"the model has {count} inputs: name that of each frequency, as inputs={[model.input_names[0]] * order}"
            )
        return (0,) * order
    if not isinstance(inputs, list | tuple) or len(inputs) != order:
        raise ModelError(f"inputs = {inputs!r}; order {order} needs the names of {order} input(s), one a frequency")
    return tuple(input_row(model, name) for name in inputs)


def unit_of(model: NarxModel, rows: Sequence[int]) -> str:
    """Return the output unit per product of the inputs' units; empty if one is unknown."""
    units = [model.input_units[row] for row in rows]
    if not (model.output_units[0] and all(units)):
        return ""
    powers = {unit: units.count(unit) for unit in units}
    below = " ".join(f"{unit}^{power}" if power > 1 else unit for unit, power in powers.items())
    return f"{model.output_units[0]}/{below if len(powers) == 1 else f'({below})'}"


def checked_frequencies(omega: ArrayLike, sample_time: float, order: int = 1) -> Array:
    """Return frequencies after a check. Shapes: `omega` (n,); returns (n,)."""
    given = np.atleast_1d(real_numbers(omega, "omega"))
    if order > 1 and given.shape == (order,):
        given = given[None, :]
    elif order == 1 and given.ndim == 2 and given.shape[1] == 1:
        given = given[:, 0]
    wanted = "(n,)" if order == 1 else f"(n, {order})"
    if given.ndim != min(order, 2) or (order > 1 and given.shape[1] != order):
        raise ModelError(f"omega has the shape {given.shape}; order {order} needs {wanted}, in rad/s")
    if given.size == 0:
        raise ModelError("omega is empty; give at least one frequency")
    nyquist = np.pi / sample_time
    highest = nyquist * (1 + 1e-9)
    if not (given.min() >= -highest and given.max() <= highest):
        wrong = given[~(np.abs(given) <= highest)][0]
        raise ModelError(
            f"omega holds {wrong:g} rad/s; frequencies go up to half the sampling rate, {nyquist:.6g} rad/s"
        )
    return given


def values_at(about: Deviations, angles: Array, rows: Sequence[int] = ()) -> Complex:
    """Return H_n about an equilibrium. Shapes: `angles` (n, order); `rows` (order,) of the inputs; returns (n,)."""
    shape, blocks = _blocks(about, angles, 1, rows)
    values = np.zeros(shape, dtype=np.complex128)
    for block, tones in blocks:
        jet = solve_parts(about.model.terms, about.model.theta, tones, by_theta=False).get(tones.whole)
        if jet is not None:
            values[block] = jet.value / tones.repeats
    return values.reshape(-1)


def gradient_at(about: Deviations, angles: Array, rows: Sequence[int] = ()) -> Complex:
    """Derivative of H_n by the parameters of the expanded model. Shapes: `angles` (n, order); (n, n_terms)."""
    shape, blocks = _blocks(about, angles, 1 + len(about.model.terms), rows)
    gradient = np.zeros((*shape, about.jacobian.shape[1]), dtype=np.complex128)
    for block, tones in blocks:
        jet = solve_parts(about.model.terms, about.model.theta, tones, by_theta=True).get(tones.whole)
        if jet is not None and jet.slope is not None:
            gradient[block] = np.moveaxis(jet.slope, 0, -1) @ about.jacobian / tones.repeats
    return gradient.reshape(len(angles), -1)


def _blocks(
    about: Deviations, angles: Array, numbers: int, rows: Sequence[int]
) -> tuple[tuple[int, ...], Iterator[tuple[tuple[slice, ...], Tones]]]:
    """Split the frequencies to limit memory; at each frequency, a product needs ``numbers`` numbers."""
    held = (2 ** angles.shape[1] - 1) * products_of(about.model.terms)
    size = max(1, min(_BLOCK, _HELD // held) // numbers)
    return blocks_of(angles, size, rows)
