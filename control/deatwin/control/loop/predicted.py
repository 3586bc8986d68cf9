"""The closed loop as an identified model predicts it, with a simultaneous band."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import ceil
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import function, generator, instance, not_negative, row, taking, whole
from deatwin.control.controllers.base import Controller, require_clock
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.progress import Progress
from deatwin.ident.arguments import keep_read_only
from deatwin.ident.frequency import equilibrium
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.narx import NarxModel, Variable
from deatwin.ident.narx.residual import Residual
from deatwin.ident.narx.response import divergence_limit
from deatwin.plant.amplitudes import axis_label, written_amplitude
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.simulate import RunStatus

LEVEL = 0.95
_SETTLE = 500  # Number of samples at the operating input before the loop is closed
_NEWS = 100  # Number of samples between two calls of the progress callback
_BEYOND = 100.0
"""Distance from rest from which a free run has diverged, in units of the larger of the ranges of training data and
reference."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedLoop(Described):
    """Prediction of a closed-loop run: one run for each draw of a model's parameters, as `predict_loop` returns it.

    Parameters
    ----------
    timepts : ndarray, shape (n,)
        Time since the loop was closed, s.
    reference : ndarray, shape (n,)
        Desired output, in its unit.
    outputs : ndarray, shape (draws, n)
        Output for each draw whose run did not diverge, in the output's unit.
    commands : ndarray, shape (draws, n)
        Command for each of these draws, in the input's unit.
    diverged : float
        Share of all draws whose run diverged.
    command_limits : (float, float)
        Least and largest command of the controller, in the input's unit.
    input_unit, output_unit : str
        Units of input and output.
    trained : (float, float) or None
        Least and largest output of the training data, in the output's unit; None if the model does not state this
        range.
    """

    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    reference: Array = field(metadata=variable("time", unit=attrgetter("output_unit")))
    outputs: Array = field(metadata=variable("draw", "time", name="output", unit=attrgetter("output_unit")))
    commands: Array = field(metadata=variable("draw", "time", name="command", unit=attrgetter("input_unit")))
    diverged: float = field(metadata=attribute())
    command_limits: tuple[float, float]
    input_unit: str
    output_unit: str
    trained: tuple[float, float] | None = None

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "middle": variable("time", unit=attrgetter("output_unit")),
        "half_width": variable("time", unit=attrgetter("output_unit")),
        "level": attribute(of=lambda _: LEVEL),
    }

    def __post_init__(self) -> None:
        keep_read_only(self, "timepts", "reference", "outputs", "commands")

    @property
    def middle(self) -> Array:
        """Mean output of the draws, shape (n,), in the output's unit; NaN if all draws diverged."""
        if not len(self.outputs):
            return np.full(self.timepts.size, np.nan)
        return np.asarray(self.outputs.mean(axis=0))

    @property
    def half_width(self) -> Array:
        """Half width of the simultaneous 95 % band about `middle`, shape (n,), in the output's unit.

        The half width is the standard deviation over the draws at each sample, times a factor that is the same for all
        samples. The factor is such that 95 % of the draws lie inside the band at all samples, if each draw is compared
        with the mean and standard deviation of the other draws. The half width is NaN if all draws diverged.
        """
        count = len(self.outputs)
        if not count:
            return np.full(self.timepts.size, np.nan)
        square = (self.outputs - self.middle) ** 2
        variance = square.mean(axis=0)
        farthest = np.divide(square, variance, out=np.zeros_like(square), where=variance > 0.0).max(axis=1)
        # Each draw is studentised by the others; a draw that makes up the whole spread would be infinitely far.
        others = np.sort(count * farthest / np.maximum(count - 1.0 - farthest, 1.0))
        needed = min(ceil(LEVEL * (count + 1)), count)
        return np.asarray(np.sqrt(others[needed - 1] * variance))

    def inside(self, run: ClosedLoop) -> float:
        """Return the share of a run's samples that lie inside the band.

        With a step reference, only samples from the first step on count, because the prediction does not contain the
        start procedure that precedes the run.

        Parameters
        ----------
        run : ClosedLoop
            Run with the same reference; samples that are missing at the end count as outside.
        """
        n = run.output.size
        within = np.abs(run.output - self.middle[:n]) <= self.half_width[:n]
        levels = self._run(self.reference, self.reference).levels
        first = levels[0].first if levels else 0
        return float(within[first:].sum() / (self.timepts.size - first))

    @property
    def runs(self) -> tuple[ClosedLoop, ...]:
        """One closed-loop run for each draw that did not diverge, from which measures can be computed."""
        return tuple(self._run(output, command) for output, command in zip(self.outputs, self.commands, strict=True))

    def _run(self, output: Array, command: Array) -> ClosedLoop:
        return ClosedLoop(
            status=RunStatus.DONE,
            timepts=self.timepts,
            reference=self.reference,
            output=output,
            measured=output,
            command=command,
            command_limits=self.command_limits,
            input_unit=self.input_unit,
            output_unit=self.output_unit,
        )

    def interval(self, measure: Callable[[ClosedLoop], float]) -> tuple[float, float, float]:
        """Return median and 95 % interval over the draws of a `measure`, such as ``lambda run: run.overshoot``.

        All three are NaN if all draws diverged.
        """
        values = np.array([measure(run) for run in self.runs] or [np.nan])
        middle, low, high = np.quantile(values, [0.5, 0.025, 0.975])
        return float(middle), float(low), float(high)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot reference, mean and band over time, on `ax` or new axes."""
        axes = axes_or_new(ax)
        unit, size = written_amplitude(self.output_unit)
        middle, half = self.middle / size, self.half_width / size
        axes.fill_between(
            self.timepts, middle - half, middle + half, alpha=0.3, linewidth=0, label="predicted, 95 % simultaneous"
        )
        axes.plot(self.timepts, middle, label="predicted")
        axes.plot(self.timepts, self.reference / size, "--", color="0.4", linewidth=0.9, label="reference")
        axes.set_xlabel("time (s)")
        axes.set_ylabel(axis_label("output", unit))
        axes.legend()
        return axes


@taking(
    model=instance(NarxModel),
    controller=instance(Controller),
    reference=row,
    reading=instance(ReadingTime),
    residual=instance(Residual),
    noise=not_negative,
    rng=generator,
    draws=whole(1),
    progress=function,
)
def predict_loop(
    model: NarxModel,
    controller: Controller,
    reference: ArrayLike,
    *,
    reading: ReadingTime,
    residual: Residual,
    noise: float,
    rng: np.random.Generator,
    draws: int = 300,
    progress: Progress | None = None,
) -> PredictedLoop:
    """Simulate a controller in closed loop with an identified model, for many draws of the model's parameters.

    The parameters are drawn from the model's posterior. To the output of each draw, a random process is added that has
    the rms and correlation time of the model's free-run residual. Sensor noise is added to the reading.

    Parameters
    ----------
    model : NarxModel
        Model of one input and one output, with an equilibrium at the controller's operating input.
    controller : Controller
        Controller to run.
    reference : array_like, shape (n,)
        Desired output, in its unit.
    reading : ReadingTime
        Instant within a sample at which the reading is taken.
    residual : Residual
        Rms and correlation time of the model's free-run residual.
    noise : float
        Standard deviation of the sensor noise, in the output's unit.
    rng : numpy.random.Generator
        Random generator for parameters, random process and noise.
    draws : int
        Number of draws.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1.

    Raises
    ------
    ControlError
        If an argument has the wrong type, controller and model have different sampling times, or the reference is not a
        one-dimensional array of finite numbers.
    ModelError
        If the model has no equilibrium at the controller's operating input. Also if readings are taken at the start of
        the hold although the model's output depends on the command of the same sample.
    """
    wanted = np.asarray(reference, dtype=np.float64)
    require_clock(controller, "the model", model.sample_time)
    rest = equilibrium(model, controller.operating_input).output
    terms = _Terms(
        model, draw_theta(model, rng, draws), reading, rest, controller.operating_input, _far(model, rest, wanted)
    )
    for _ in range(_SETTLE):
        terms.advance(np.full(draws, controller.operating_input))
    n = wanted.size
    left = residual.draw(n + 1, draws, model.sample_time, rng)
    errors = noise * rng.standard_normal((n, draws))
    outputs, commands = np.empty((n, draws)), np.empty((n, draws))
    state = np.multiply.outer(controller.start(), np.ones(draws))
    for k in range(n):
        outputs[k] = terms.output + left[k]
        commands[k], state = controller.command(np.full(draws, wanted[k]), outputs[k] + errors[k], state)
        terms.advance(commands[k])
        if progress is not None and ((k + 1) % _NEWS == 0 or k + 1 == n):
            progress((k + 1) / n)
    sound = np.all(np.isfinite(outputs), axis=0) & ~terms.diverged
    return PredictedLoop(
        timepts=model.sample_time * np.arange(n, dtype=np.float64),
        reference=wanted,
        outputs=outputs.T[sound],
        commands=commands.T[sound],
        diverged=float(1.0 - sound.mean()),
        command_limits=(controller.command_min, controller.command_max),
        input_unit=model.input_units[0],
        output_unit=model.output_units[0],
        trained=_trained(model),
    )


def _trained(model: NarxModel) -> tuple[float, float] | None:
    """Return the smallest and largest output of the training data, in the output's unit."""
    if model.operating is None:
        return None
    return float(model.operating.output_min[0]), float(model.operating.output_max[0])


def _far(model: NarxModel, rest: float, reference: Array) -> float:
    """Return the distance from rest beyond which a free run counts as diverged, in the output's unit."""
    trained = _trained(model)
    if trained is None:
        return divergence_limit(None, np.append(reference, rest))
    return _BEYOND * max(trained[1] - trained[0], float(np.ptp(reference)))


class _Terms:
    """A model's recursion, evaluated for many parameters at once. Shapes: `theta` (draws, n_terms)."""

    def __init__(
        self, model: NarxModel, theta: Array, reading: ReadingTime, output: float, command: float, far: float
    ) -> None:
        variables = list(model.table.variables)
        self._theta = theta.T
        quiet = [m for m, term in enumerate(model.terms) if all(v.kind != "e" for v in term.expanded)]
        self._terms = [(m, [variables.index(v) for v in model.terms[m].expanded]) for m in quiet]
        self._first = 1 if reading is ReadingTime.START_OF_HOLD else 0
        self._table = model.table
        if any(v.kind == "u" and v.lag < self._first for v in variables):
            raise ModelError(
                "the model has the input lag 0, but the rig takes each reading before it applies the command of the same row: "
                "identify with input lags from 1 on"
            )
        draws = len(theta)
        longest = model.table.max_lag + 1
        self._origin_u, self._origin_y = float(model.input_origin[0]), float(model.output_origin[0])
        self._rest, self._limit = output - self._origin_y, far
        # Outputs and commands relative to the model's origin.
        self._y, self._u = np.full((longest, draws), self._rest), np.full((longest, draws), command - self._origin_u)
        self.diverged = np.zeros(draws, dtype=np.bool_)

    @property
    def output(self) -> Array:
        """The newest output of each draw, shape (draws,)."""
        return self._y[0] + self._origin_y

    def advance(self, command: Array) -> None:
        """Advance by one row with given commands, shape (draws,)."""
        self._u = np.concatenate([command[None] - self._origin_u, self._u[:-1]])

        def lagged(v: Variable, lag: int) -> Array:
            return self._y[lag - 1] if v.kind == "y" else self._u[lag - self._first]

        values = self._table.of_signals(lagged)
        total = np.zeros(command.size)
        with np.errstate(over="ignore", invalid="ignore"):  # a large value may overflow within one row
            for m, places in self._terms:
                product = self._theta[m]
                for place in places:
                    product = product * values[place]
                total = total + product
        self.diverged |= ~(np.abs(total - self._rest) < self._limit)
        total = np.where(self.diverged, self._rest, total)
        self._y = np.concatenate([total[None], self._y[:-1]])
