"""The equilibrium of a model whose parameters change with time, followed or held, and the corrected response there.

The correction of a frozen response is to first order in the rate of the parameters.

A part of the output is Y(t) e^(jwt), with an amplitude that changes (Zadeh, Proc. IRE 38 (1950) 291-299), so a delay is
q^-l Y(t) e^(jwt) = (Y(t) - l dY/dt) e^(jw(t - l)) to first order, with the rates for parameters that stand still. The
response of a linear system with A = 1 - sum_l a_l e^(-jwl) then differs by -(dH/dt) sum_l l a_l e^(-jwl) / A, its rate
times the group delay of 1/A. The equilibrium lags in the same way, and each delayed factor of a product sees its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from deatwin.ident.arguments import real_number
from deatwin.ident.frequency.dc import Equilibrium, deviations, equilibrium
from deatwin.ident.frequency.gfrf import require_one_input
from deatwin.ident.frequency.hierarchy import Feedback, Jet, Parts, solve_parts
from deatwin.ident.frequency.linear import levels, motion, operating_input_of
from deatwin.ident.narx.covariance import transformed
from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Term, without
from deatwin.ident.narx.trajectory import ThetaTrajectory, require_trajectory
from deatwin.plant.arrays import Array, Complex
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


Models = Sequence[NarxModel | None]  # Models of successive times; None where there is none

Reading = Callable[[Mapping[int, Jet]], Array | None]
"""Function that takes the result from the parts, shape (n_times, n); None if it is zero."""

_BLOCK = 65536  # values in a block of times, to limit memory


class MovingParts:
    """Parts whose amplitudes change along their first axis, which is time. Shapes: `rates` (n_times, n)."""

    def __init__(self, parts: Parts, rates: Mapping[int, Array]) -> None:
        self.parts, self.rates = parts, rates
        self.order, self.splits, self.input = parts.order, parts.splits, parts.input

    def delayed(self, values: Array, part: int, lag: int) -> Array:
        """Delay a part, taking its earlier amplitude into account. Shapes: `values` (n_times, n)."""
        return self.parts.delayed(values - lag * self.rates[part], part, lag)

    def filtered(self, values: Array, part: int, feedback: Feedback) -> Array:
        """Solve (1 - sum_l a_l q^-l) v = values with that delay. Shapes: `values` (n_times, n)."""
        memory = sum(lag * a * self.parts.delayed(self.rates[part], part, lag) for lag, a in feedback)
        return self.parts.filtered(values - memory, part, feedback)


def correction(
    models: Models, before: Models, after: Models, span: Array, parts: Parts, read: Reading, size: int
) -> Complex:
    """Return the first-order correction, (n_times, n), by the rates of the models ``before`` and ``after``."""
    added = np.full((span.size, size), np.nan, dtype=np.complex128)
    step = max(_BLOCK // (3 * size), 1)
    for first in range(0, span.size, step):
        some = slice(first, first + step)
        block = _added(models[some], before[some], after[some], span[some], parts, read)
        if block is not None:
            added[some] = block
    return added


def _added(models: Models, before: Models, after: Models, span: Array, parts: Parts, read: Reading) -> Array | None:
    found = [None if model is None else deviations(model) for model in (*models, *before, *after)]
    known = [about for about in found if about is not None]
    if not known:
        return None
    terms, blank = known[0].model.terms, np.full(known[0].model.theta.size, np.nan)
    theta = np.stack([blank if about is None else about.model.theta for about in found], axis=-1)
    points = [
        (np.nan, np.nan) if about is None else (about.point.output, float(about.point.operating_input[0]))
        for about in found
    ]
    n = len(models)

    def rate(values: Array) -> Array:
        """Return difference quotients of values (3 n, m), in the order of ``found``."""
        return np.asarray((values[2 * n :] - values[n : 2 * n]) / span[:, None])

    with np.errstate(invalid="ignore", divide="ignore"):  # missing times are NaN, and so is the rate of a single time
        rates = {part: rate(jet.value) for part, jet in solve_parts(terms, theta, parts, by_theta=False).items()}
        here = theta[:, :n]
        moved = _moved(terms, here, *rate(np.array(points)).T)
        still = read(solve_parts(terms, here, parts, by_theta=False))
        true = read(solve_parts(terms, moved, MovingParts(parts, rates), by_theta=False))
    return 0.0 * here[:1].T if true is None or still is None else true - still


def _moved(terms: Sequence[Term], theta: Array, output_rate: Array, input_rate: Array) -> Array:
    """Expand about the levels that the delayed factors had while the equilibrium moved, shape (n_terms, n_times)."""
    place = {term: m for m, term in enumerate(terms)}
    linear = {term.factors[0][0]: theta[m] for term, m in place.items() if term.degree == 1}
    rates: dict[str, Array] = {"y": output_rate, "u": input_rate}
    drive = sum(variable.lag * a * rates[variable.kind] for variable, a in linear.items())
    behind = drive / (1.0 - sum(a for variable, a in linear.items() if variable.kind == "y"))
    moved = theta.copy()
    for m, term in enumerate(terms):
        for variable, power in term.factors:
            rest = without(term, variable)
            if rest in place:
                lag = variable.lag * rates[variable.kind] + (behind if variable.kind == "y" else 0.0)
                moved[place[rest]] -= power * theta[m] * lag
    return moved
