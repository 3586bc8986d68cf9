"""Compute frequency responses along time: at each time, the model is expanded about its equilibrium."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import read_only, real_numbers
from deatwin.ident.frequency.gfrf import HIGHEST_ORDER, checked_frequencies, gfrf, require_one_input
from deatwin.ident.frequency.hierarchy import Jet, Orders, Parts, Tones
from deatwin.ident.frequency.linear import operating_input_of, whole_order
from deatwin.ident.frequency.output_responses.estimate import nofrf_exact
from deatwin.ident.frequency.output_responses.powers import input_spectrum
from deatwin.ident.frequency.output_responses.result import NofrfStatus, NofrfWarning
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.frequency.spectrum import one_period, spectrum_of
from deatwin.ident.frequency.varying.following import Reading, beside, correction, followed
from deatwin.ident.frequency.varying.response import VaryingResponse
from deatwin.ident.narx.identifier import Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.trajectory import ThetaTrajectory, require_trajectory
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_MOST_TIMES = 200  # most times of a map, unless the times are given


def tv_gfrf(
    trajectory: ThetaTrajectory,
    order: int,
    omega: ArrayLike,
    *,
    timepts: ArrayLike | None = None,
    operating_input: ArrayLike | None = None,
    progress: Progress | None = None,
) -> VaryingResponse:
    """Compute the generalised frequency response H_n of a model whose parameters change with time.

    At each time, the parameters are taken as constant, and the model is expanded about its equilibrium. A change of the
    equilibrium over time changes the responses of all orders.

    Parameters
    ----------
    trajectory : ThetaTrajectory
        Parameters theta(t) of a model of one input and one output.
    order : int
        Order n, from 1 to 8.
    omega : array_like, shape (n_values,) for order 1, else (n_values, order)
        Angular frequencies, rad/s, in the form that `gfrf` takes.
    timepts : array_like, shape (n_times,), optional
        Increasing times, s. The parameters at each time are those of the nearest time of the trajectory. By default the
        times of the trajectory, thinned evenly to at most 200.
    operating_input : array_like, shape () or (n_times,), optional
        Input at the operating point, in its unit: one value, or one for each time. By default the mean of the training
        inputs.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1, and the name of the current step.

    Returns
    -------
    VaryingResponse
        Response H_n over time, in output units per n-th power of the input unit, with its covariance.

    Raises
    ------
    ModelError
        For the reasons given in `gfrf`. Also if times lie outside the trajectory or do not increase, or if no time has
        an equilibrium.

    References
    ----------
    Zadeh, "Frequency analysis of variable networks", Proc. IRE 38 (1950) 291-299.
    """
    require_trajectory(trajectory)
    order = whole_order(order, HIGHEST_ORDER)
    frequencies = checked_frequencies(omega, trajectory.model.sample_time, order)
    tones = Tones(list(frequencies.reshape(-1, order).T * trajectory.model.sample_time))
    quantity = partial(gfrf, order=order, omega=frequencies)
    return _along(trajectory, quantity, tones, partial(_of_all_tones, tones), timepts, operating_input, progress)


def tv_nofrf(
    trajectory: ThetaTrajectory,
    excitation: ArrayLike,
    order: int,
    *,
    timepts: ArrayLike | None = None,
    operating_input: ArrayLike | None = None,
    progress: Progress | None = None,
) -> VaryingResponse:
    """Compute the nonlinear output frequency response G_n of a model whose parameters change with time.

    At each time, the parameters are taken as constant, and G_n = Y_n / U_n. Here Y_n is the spectrum of the n-th order
    of the output in the periodic steady state, computed exactly, and U_n is the spectrum of the input's n-th power.

    Parameters
    ----------
    trajectory : ThetaTrajectory
        Parameters theta(t) of a model of one input and one output.
    excitation : array_like, shape (n_samples,)
        One period of the input minus `operating_input`, at the model's sample time, in the input's unit.
    order : int
        Order n, at least 1.
    timepts : array_like, shape (n_times,), optional
        Increasing times, s; see `tv_gfrf`.
    operating_input : array_like, shape () or (n_times,), optional
        Input at the operating point, in its unit: one value, or one for each time. By default the mean of the training
        inputs.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1, and the name of the current step.

    Returns
    -------
    VaryingResponse
        Response G_n over time, in output units per n-th power of the input unit, at the lines where U_n is not zero.

    Warns
    -----
    NofrfWarning
        If the contributions to U_n cancel at some frequencies, so that G_n is erratic there.

    Raises
    ------
    ModelError
        For the reasons given in `output_orders` and `tv_gfrf`, or if `excitation` is zero throughout.

    References
    ----------
    Lang, Billings, "Energy transfer properties of non-linear systems in the frequency domain", Int. J. Control 78
    (2005) 345-362, doi:10.1080/00207170500095759.
    """
    require_trajectory(trajectory)
    period = one_period(excitation, trajectory.model.sample_time)
    spectrum = input_spectrum(period, order, trajectory.model.sample_time)
    lines, powers = spectrum.defined, spectrum.values[spectrum.defined]
    if not spectrum.suitable:
        warnings.warn(NofrfStatus.ERRATIC_EXCITATION.value, NofrfWarning, stacklevel=2)
    quantity, read = partial(_nofrf, excitation, order), partial(_of_order, order, lines, powers)
    return _along(trajectory, quantity, Orders(period, order), read, timepts, operating_input, progress)


def _of_all_tones(tones: Tones, found: Mapping[int, Jet]) -> NDArray[Any] | None:
    return found[tones.whole].value / tones.repeats if tones.whole in found else None


def _of_order(
    order: int, lines: NDArray[np.bool_], powers: NDArray[Any], found: Mapping[int, Jet]
) -> NDArray[Any] | None:
    return spectrum_of(found[order].value)[:, lines] / powers if order in found else None


def _nofrf(excitation: ArrayLike, order: int, model: NarxModel) -> FrequencyResponse:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NofrfWarning)  # reported once, for all times
        return nofrf_exact(model, excitation, order)


def _along(
    trajectory: ThetaTrajectory,
    quantity: Callable[[NarxModel], FrequencyResponse],
    parts: Parts,
    read: Reading,
    timepts: ArrayLike | None,
    operating_input: ArrayLike | None,
    progress: Progress | None,
) -> VaryingResponse:
    """Compute a quantity of the model at each time, about its equilibrium."""
    require_one_input(trajectory.model, "gfrf of ThetaTrajectory.at(time), with inputs by name")
    times = checked_times(trajectory, timepts)
    inputs = checked_inputs(trajectory, operating_input, times.size)
    models: list[NarxModel | None] = []
    responses: list[FrequencyResponse | None] = []
    for model in followed(trajectory, times, inputs):
        models.append(model)
        responses.append(None if model is None else quantity(model))
        if progress is not None:
            progress(len(models) / times.size, f"response of {len(models)} of {times.size} times")
    some = next((response for response in responses if response is not None), None)
    if some is None:
        raise ModelError(
            f"no model from {times[0]:g} s to {times[-1]:g} s has an equilibrium at its operating input; choose another"
        )
    stable = tuple(m if r is not None and r.status.ok else None for m, r in zip(models, responses, strict=True))
    return VaryingResponse(
        timepts=times,
        operating_inputs=inputs,
        models=tuple(models),
        responses=tuple(responses),
        correct=partial(_correction, trajectory, times, inputs, stable, parts, read, some.values.size),
    )


def _correction(
    trajectory: ThetaTrajectory,
    times: Array,
    inputs: Array,
    models: Sequence[NarxModel | None],
    parts: Parts,
    read: Reading,
    size: int,
) -> NDArray[np.complex128]:
    """Return the correction of a response for the rate at which the trajectory, not only its map, changes."""
    from scipy.interpolate import make_interp_spline

    known = trajectory.timepts
    place = np.searchsorted((known[1:] + known[:-1]) / 2, times)
    level = make_interp_spline(times, inputs, k=1) if times.size > 1 else lambda _: np.broadcast_to(inputs, times.shape)
    ends = known[np.maximum(place - 1, 0)], known[np.minimum(place + 1, known.size - 1)]
    before, after = (
        [
            None if model is None else beside(trajectory, model, time, about)
            for model, time, about in zip(models, end.tolist(), level(end).tolist(), strict=True)
        ]
        for end in ends
    )
    span = (ends[1] - ends[0]) / trajectory.model.sample_time
    return correction(models, before, after, span, parts, read, size)


def checked_times(trajectory: ThetaTrajectory, timepts: ArrayLike | None) -> Array:
    """Return the times of a map after a check. Shapes: `timepts` (n_times,); returns (n_times,)."""
    known = trajectory.timepts
    if timepts is None:
        chosen = np.linspace(0, known.size - 1, min(known.size, _MOST_TIMES)).round().astype(int)
        return read_only(known[chosen])
    times = np.atleast_1d(real_numbers(timepts, "timepts"))
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
        raise ModelError("timepts must be finite times that increase, of shape (n_times,), in s")
    trajectory.at(float(times[0]))
    trajectory.at(float(times[-1]))
    return times


def checked_inputs(trajectory: ThetaTrajectory, operating_input: ArrayLike | None, count: int) -> Array:
    """Return the operating input of each time after a check. Shapes: `operating_input` (); returns (n_times,)."""
    centre = operating_input_of(trajectory.model, None)
    given = real_numbers(centre if operating_input is None else operating_input, "operating_input")
    if given.shape not in ((), (1,), (count,)) or not np.all(np.isfinite(given)):
        raise ModelError(
            f"operating_input has the shape {given.shape}; it must be one finite number, or one for each of the "
            f"{count} times"
        )
    return read_only(np.broadcast_to(given, count))
