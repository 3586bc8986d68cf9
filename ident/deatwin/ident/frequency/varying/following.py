"""The equilibrium of a model whose parameters change with time, followed from one time to the next or held."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from deatwin.ident.arguments import real_number
from deatwin.ident.frequency.dc import Equilibrium, equilibrium
from deatwin.ident.frequency.gfrf import require_one_input
from deatwin.ident.frequency.linear import levels, motion, operating_input_of
from deatwin.ident.narx.covariance import transformed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import OperatingRange
from deatwin.ident.narx.terms import Term
from deatwin.ident.narx.trajectory import ThetaTrajectory, require_trajectory
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_CLEAR = 0.25  # An equilibrium continues the branch if all others are at least four times as far away from the last one


def followed(trajectory: ThetaTrajectory, timepts: Array, inputs: Array) -> Iterator[NarxModel | None]:
    """Yield the model at each time about the equilibrium near the data. Shapes: `timepts`, `inputs` (n_times,)."""
    # The nearest equilibrium continues the branch; if others are about as near, intermediate times are followed as
    # well.
    last: _Frozen | None = None
    for time, level in zip(timepts.tolist(), inputs.tolist(), strict=True):
        found = _step(trajectory, last, time, level)
        last = found or last
        yield None if found is None else found.model


def beside(trajectory: ThetaTrajectory, model: NarxModel, time: float, level: float) -> NarxModel | None:
    """Return the model at a neighbouring time, about the equilibrium next to that of a followed ``model``."""
    if model.operating is None:
        return None
    about, output = float(model.operating.input_centre[0]), float(model.operating.output_centre[0])
    found = _step(trajectory, _Frozen(time, about, output, model), time, level)
    return None if found is None else found.model


def hold_equilibrium(
    trajectory: ThetaTrajectory, output: float, operating_input: float | None = None
) -> ThetaTrajectory:
    """Return a trajectory whose constant term is adjusted so that the equilibrium does not change with time.

    All other parameters are unchanged. The response of the original trajectory minus that of the adjusted one is
    therefore the effect of the change of the equilibrium.

    Parameters
    ----------
    trajectory : ThetaTrajectory
        Parameters theta(t) of a model of one input and one output.
    output : float
        Output at the equilibrium, in its unit; the same at all times.
    operating_input : float, optional
        Constant input at the equilibrium, in its unit; the mean of the training inputs by default.

    Returns
    -------
    ThetaTrajectory
        Trajectory whose operating range is centred at the equilibrium. A missing constant term is appended.

    Raises
    ------
    ModelError
        If the model has several inputs or outputs, or if `output` or `operating_input` is not finite.
    """
    require_trajectory(trajectory)
    require_one_input(trajectory.model, "gfrf of ThetaTrajectory.at(time), with inputs by name")
    inputs = operating_input_of(trajectory.model, operating_input)
    if not np.isfinite(real_number(output, "output")):
        raise ModelError(f"output = {output}; the equilibrium must be a finite number")
    regressors = trajectory.model.table.at(levels(trajectory.model, inputs, output))
    constant, terms = Term(()), trajectory.terms
    place = terms.index(constant) if constant in terms else len(terms)
    others = np.where(np.arange(len(terms)) == place, 0.0, regressors)
    # theta_new = change theta + level: at any parameters, the constant supplies what the other terms lack of the
    # equilibrium.
    change = np.eye(max(len(terms), place + 1), len(terms))
    change[place] = -others
    theta = change @ trajectory.theta
    theta[place] += output - trajectory.model.output_origin[0]
    model = replace(
        trajectory.model,
        terms=terms if place < len(terms) else (*terms, constant),
        equations=(),
        theta=theta[:, -1],
        theta_cov=transformed(change, trajectory.model.theta_cov),
    )
    return replace(
        trajectory,
        model=_centred(model, float(inputs[0]), output),
        theta=theta,
        theta_cov=transformed(change, trajectory.theta_cov),
        drift_variance=np.zeros(len(change)),
        log_likelihood=None,
    )


class _Frozen(NamedTuple):
    """The model with the parameters of one time, and its equilibrium."""

    time: float
    level: float
    output: float
    model: NarxModel


def _step(trajectory: ThetaTrajectory, last: _Frozen | None, time: float, level: float) -> _Frozen | None:
    """Follow the equilibrium to the next time."""
    model = trajectory.at(time)
    if last is not None:
        model = _centred(model, level, last.output)
    point = _equilibrium(model, level)
    if point is None:
        return None
    if last is not None and not _is_clear(point, last.output) and _has_between(trajectory, last.time, time):
        halfway = _step(trajectory, last, 0.5 * (last.time + time), 0.5 * (last.level + level))
        if halfway is not None:
            return _step(trajectory, halfway, time, level)
    return _Frozen(time, level, point.output, _centred(model, level, point.output))


def _equilibrium(model: NarxModel, level: float) -> Equilibrium | None:
    """Return the equilibrium reached from the model's origin; None if there is none, or if two of them meet."""
    try:
        point = equilibrium(model, level)
        motion(model, levels(model, point.operating_input, point.output))
    except ModelError:
        return None
    return point


def _is_clear(point: Equilibrium, near: float) -> bool:
    """Return whether the chosen equilibrium is much nearer to the previous one than all others are."""
    distances = np.abs(point.outputs - near)
    return bool(np.all(distances[point.chosen] <= _CLEAR * np.delete(distances, point.chosen)))


def _has_between(trajectory: ThetaTrajectory, first: float, last: float) -> bool:
    """Return whether the trajectory has a time between two given times."""
    return bool(np.searchsorted(trajectory.timepts, last) > np.searchsorted(trajectory.timepts, first, side="right"))


def _centred(model: NarxModel, level: float, output: float) -> NarxModel:
    """Return the model with its origin moved to an equilibrium near its data."""
    u, y = np.array([level]), np.array([output])
    if model.operating is None:
        around = OperatingRange(input_min=u, input_max=u, input_centre=u, output_min=y, output_max=y, output_centre=y)
    else:
        around = replace(model.operating, input_centre=u, output_centre=y)
    return replace(model, operating=around)
