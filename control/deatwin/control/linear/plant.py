"""Linearise and sample the physics plant about its state of rest, for the design of controllers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import each, generator, instance, number, numbers, taking, whole
from deatwin.control.errors import ControlError
from deatwin.control.linear.family import LinearFamily
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.linear.realisation import Realisation
from deatwin.control.progress import Progress
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.narx.covariance import covariance_root
from deatwin.plant.arguments import kind_of
from deatwin.plant.arrays import Array
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.small_signal import SmallSignal, small_signals

_PULL_IN = "the plant has no state of rest in reach there: it pulls in, or its film goes slack"
_GROWS = 1e-9
"""Excess of a mode's modulus over 1 beyond which the mode grows; memories at rest have a modulus of 1."""
_NO_GAIN = 1e-12
"""Static gain that counts as rounding, relative to the command's effect on the states times their effect on the
reading."""
_GAIN_ERROR = 1e-3
"""Largest relative difference between the static gain of the matrices and the slope of the static curve with which a
controller may be designed: far below any gain margin, and far above rounding."""


@taking(plant=instance(Plant), values=numbers, time=number)
def linearise_plant(
    plant: Plant, operating_input: float, *, values: Array | None = None, time: float = 0.0
) -> LinearModel:
    """Linearise a plant exactly about its state of rest under a constant command.

    The command changes from the rig's rest command to the operating input, at which the plant comes to rest. The linear
    model relates the command held over one sample to the noise-free reading of that sample. Quantities that drift with
    time are frozen at `time`.

    The model is valid for motions much smaller than the distances over which the forces of friction and hysteresis
    build up. In such small motions, friction and hysteresis act as springs with the stiffness force / distance. For
    much larger motions, linearise ``plant.without_effects(...)`` instead.

    Parameters
    ----------
    plant : Plant
        Plant of any rig.
    operating_input : float
        Constant command, in its unit.
    values : ndarray, shape (n_p,), optional
        Values of the plant's free parameters, SI; by default those of `plant`.
    time : float
        Clock time at which slowly drifting quantities are evaluated, s.

    Returns
    -------
    LinearModel
        Linear model without covariance. The coefficients b_i are in the SI unit of the reading per unit of the command;
        b_0 is 0 if the rig takes the reading at the start of the hold. The status says whether there is an equilibrium
        at which a controller can be designed.

    Raises
    ------
    ModelError
        If the operating input or the time is not finite.
    ControlError
        If an argument has the wrong type, or `values` are not one finite number for each free parameter.

    Notes
    -----
    Poles, gain and responses are computed from the state-space matrices of one sample. The polynomial coefficients are
    less accurate: above 1 mHz, a response computed from them has ten correct digits if the plant has one or two slow
    effects, about three with three slow effects, and none with more. `LinearModel.detail` says so if fewer than six
    digits are correct. The status is not OK if the static gain differs by more than 0.1 % from the slope of the static
    curve (reading at rest over command).
    """
    if values is not None and (np.shape(values) != plant.free_values.shape or not np.isfinite(values).all()):
        raise ControlError(
            f"values must be {plant.free_values.size} finite numbers, one for each free parameter of the plant; got "
            f"{kind_of(values)}"
        )
    return _models(plant, [operating_input], values, time)[0]


@taking(calibrated=instance(CalibratedPlant), rng=generator, count=whole(0))
def draw_plants(calibrated: CalibratedPlant, rng: np.random.Generator, count: int) -> tuple[Plant, ...]:
    """Draw plants from the distribution of a calibrated plant's parameters.

    Parameters
    ----------
    calibrated : CalibratedPlant
        Calibrated plant with the covariance of its transformed parameters (value, logarithm or reciprocal, by `Scale`).
    rng : numpy.random.Generator
        Random generator for the draws.
    count : int
        Number of plants.

    Returns
    -------
    tuple of Plant, length count
        Plants whose transformed parameters are drawn from the normal distribution and clipped to the physical ranges.
        If the calibration has no covariance, all plants are identical.
    """
    plant = calibrated.plant
    problem = Problem(plant=plant, parts=(), names=calibrated.names)
    if not calibrated.names:
        return (plant,) * count
    centre, (lower, upper) = problem.start(), problem.bounds()
    normal = rng.standard_normal((count, centre.size))
    drawn = np.clip(centre + normal @ covariance_root(calibrated.covariance).T, lower, upper)
    return tuple(plant.with_values(problem.values(coordinates)) for coordinates in drawn)


@taking(plants=each(instance(Plant)), time=number)
def linearise_plants(
    plants: tuple[Plant, ...], operating_inputs: ArrayLike, *, time: float = 0.0, progress: Progress | None = None
) -> LinearFamily:
    """Linearise several plants of one rig, each at several operating points.

    Parameters
    ----------
    plants : tuple of Plant, length n_samples
        Plants of one rig, for example from `draw_plants`.
    operating_inputs : array_like, shape (n_points,)
        Constant commands, in their unit.
    time : float
        Clock time at which slowly drifting quantities are evaluated, s.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1.

    Returns
    -------
    LinearFamily
        Family with one sample for each plant. The coefficients are padded with zeros to a common length.

    Raises
    ------
    ModelError
        If there are no plants or no operating inputs, or an operating input or the time is not finite.
    """
    columns = []
    for place, plant in enumerate(plants):
        columns.append(_models(plant, operating_inputs, None, time))
        if progress is not None:
            progress((place + 1) / len(plants))
    return LinearFamily.of(list(zip(*columns, strict=True)))


def _models(plant: Plant, operating_inputs: ArrayLike, values: Array | None, time: float) -> tuple[LinearModel, ...]:
    numbers(operating_inputs, "operating_inputs")
    points = np.atleast_1d(np.asarray(operating_inputs, dtype=np.float64))
    if points.ndim != 1 or points.size == 0 or not (np.isfinite(points).all() and np.isfinite(time)):
        raise ModelError(f"operating inputs and the time must be finite numbers; got {points} at {time:g} s")
    found = small_signals(plant, points, values=values, time=time)
    return tuple(_model(plant, float(point), small) for point, small in zip(points, found, strict=True))


def _model(plant: Plant, operating_input: float, small: SmallSignal | None) -> LinearModel:
    signals = _signals(plant, operating_input)
    if small is None:
        return LinearModel.without_equilibrium(_PULL_IN, **signals)
    whole = Realisation(a=small.a, b=small.b, c=small.c, d=small.d)
    least = whole.minimal()
    numerator, denominator = least.coefficients()
    seen = least
    if plant.rig.reading is ReadingTime.START_OF_HOLD:  # a row shows the response to the previous hold
        numerator, seen = np.concatenate([[0.0], numerator]), least.delayed()
    size = numerator.size + denominator.size - 1
    linear = LinearModel(
        numerator=numerator,
        denominator=denominator,
        covariance=np.zeros((size, size)),
        operating_output=small.reading,
        detail=seen.remark_on(numerator, denominator, plant.rig.sample_time, "the plant"),
        realisation=seen,
        **signals,
    )
    grows = np.abs(whole.modes).max(initial=0.0) > 1.0 + _GROWS
    # States are in units of their typical sizes, so that changes far below 1 per unit of the command are rounding, too.
    moved = max(float(np.linalg.norm(whole.b)), 1.0)
    floor = _NO_GAIN * float(np.linalg.norm(whole.c) * moved + np.linalg.norm(whole.d))
    judged = linear.judged(not grows and bool((np.abs(least.modes) < 1.0).all()), floor)
    error = abs(linear.static_gain - small.static_gain)
    if not judged.status.ok or not error > _GAIN_ERROR * abs(small.static_gain):  # also if the slope is NaN
        return judged
    detail = f"{linear.static_gain:.4g} against {small.static_gain:.4g}"
    return replace(judged, status=LinearStatus.INACCURATE, detail=detail)


def _signals(plant: Plant, operating_input: float) -> dict[str, Any]:
    rig = plant.rig
    return {
        "sample_time": rig.sample_time,
        "operating_input": operating_input,
        "input_name": rig.input_name,
        "output_name": rig.output_name,
        "input_unit": rig.input_unit,
        "output_unit": rig.output_unit,
    }
