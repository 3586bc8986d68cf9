"""Actuation curves: where a plant comes to rest under each command, up to the one that it does not survive."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from deatwin.plant.datasets import dataset
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.equations import Equations
from deatwin.plant.errors import DataError, SimulationError
from deatwin.plant.rest import RestState, rest_state, resting

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.plant.model import Plant

__all__ = ["ActuationCurve", "CurveEnd", "actuation_curve"]

FURTHEST = 0.25
"""From one point of a curve to the next no unknown moves further, in units of its scale: a film that snaps does."""
RUNAWAY = 20.0
"""Nor does any come further from rest: beyond all films, where a model without a limit of stretch would go on."""
HALVINGS = 40
SHOWN = {"m": (1e3, "mm"), "N": (1e3, "mN")}


class CurveEnd(Enum):
    """Why a curve ends; the text is the advice."""

    COMMAND = "the last command was reached"
    PULL_IN = "the film pulls in: there is no equilibrium nearby beyond this command"

    @property
    def ok(self) -> bool:
        """Whether all commands were reached."""
        return self is CurveEnd.COMMAND


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuationCurve:
    """Equilibria of a plant over its command.

    Parameters
    ----------
    commands : ndarray, shape (n,)
        In their unit; the last is the one at which the film pulls in, where it does.
    readings : ndarray, shape (n,)
        At rest under each, SI.
    signals : mapping of str to ndarray, each of shape (n,)
        The plant's watched signals, SI.
    unknowns : mapping of str to ndarray, each of shape (n,)
        Its states and coordinates, SI.
    end : CurveEnd
        Why it ends.
    axes : tuple of pairs of str
        Name and unit of command and reading.
    """

    commands: np.ndarray
    readings: np.ndarray
    signals: Mapping[str, np.ndarray]
    unknowns: Mapping[str, np.ndarray]
    end: CurveEnd
    axes: tuple[tuple[str, str], tuple[str, str]]

    @property
    def breakdown_command(self) -> float | None:
        """The command at which the film breaks down, None where it does not or the rig does not say."""
        return self._crossing("breakdown_share", 1.0)

    @property
    def slack_command(self) -> float | None:
        """The command at which the film loses its tension, None where it does not or the rig does not say."""
        return self._crossing("tension", 0.0)

    def _crossing(self, name: str, limit: float) -> float | None:
        """The command at which a signal leaves the side of a limit on which it started."""
        excess = self.signals.get(name, np.empty(0)) - limit
        beyond = excess * np.sign(excess[:1]) < 0
        if not beyond.any():
            return None
        last = int(np.argmax(beyond))
        share = excess[last - 1] / (excess[last - 1] - excess[last])
        return float(self.commands[last - 1] + share * (self.commands[last] - self.commands[last - 1]))

    def plot(self, ax: Axes | None = None, **style: object) -> Axes:
        """Draw the reading over the command, with the points where the film pulls in, breaks down or goes slack.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to; new ones by default.
        **style
            For the line.

        Returns
        -------
        matplotlib Axes
        """
        ax = axes_or_new(ax)
        (command, command_unit), (reading, reading_unit) = self.axes
        factor, shown = SHOWN.get(reading_unit, (1.0, reading_unit))
        (line,) = ax.plot(self.commands, factor * self.readings, **style)  # type: ignore[arg-type]
        marks = {"pull-in": ("o", None if self.end.ok else float(self.commands[-1])),
                 "breakdown": ("x", self.breakdown_command), "slack": ("v", self.slack_command)}  # fmt: skip
        for name, (marker, at) in marks.items():
            if at is not None:
                height = factor * np.interp(at, self.commands, self.readings)
                ax.plot([at], [height], marker, color=line.get_color(), clip_on=False)
                ax.annotate(name, (at, height), xytext=(-6, 3), textcoords="offset points", ha="right")
        ax.set_xlabel(f"{command} ({command_unit})")
        ax.set_ylabel(f"{reading} ({shown})")
        return ax

    def to_xarray(self) -> Any:
        """Return readings, watched signals and unknowns as an `xarray.Dataset` over the command; SI."""
        (command, command_unit), (reading, reading_unit) = self.axes
        others = {**self.unknowns, **self.signals}
        return dataset(
            {**{name: ("command", values) for name, values in others.items() if name not in (reading, "command")},
             reading: ("command", self.readings, reading_unit)},
            {"command": ("command", self.commands, command_unit)},
            {"end": self.end.name, "advice": self.end.value, "command_name": command,
             "breakdown_command": self.breakdown_command, "slack_command": self.slack_command},
        )  # fmt: skip


def actuation_curve(plant: Plant, commands: np.ndarray) -> ActuationCurve:
    """Follow the equilibrium of a plant from rest through rising commands.

    Parameters
    ----------
    plant : Plant
        Its effects act as after an endless hold, their clock stands at 0.
    commands : ndarray, shape (n,)
        Rising from the command at rest, in their unit.

    Returns
    -------
    ActuationCurve
        It ends at pull-in, found to a part in 10¹² of the step between commands: where the equilibrium turns
        back, runs away, or the film would have to snap.

    Raises
    ------
    DataError
        If the commands do not rise.
    SimulationError
        If there is no state of rest.
    """
    equations, values, start = plant.equations, plant.free_values, plant.rig.start.rest_command
    wanted = np.asarray(commands, dtype=float)
    if wanted.size == 0 or wanted[0] < start or np.any(np.diff(wanted) <= 0):
        raise DataError(f"an actuation curve needs commands that rise from {start:g}, the one at rest")
    rest = rest_state(equations, start, values)
    if not rest.found:
        raise SimulationError(rest.fault)
    step = _step(equations, rest, start, values)
    here, at, end = np.concatenate([rest.x, rest.z]), start, CurveEnd.COMMAND
    points: list[tuple[float, np.ndarray]] = []
    for command in wanted:
        at, here, reached = _follow(step, at, here, command, HALVINGS)
        points.append((at, here))
        if not reached:
            end = CurveEnd.PULL_IN
            break
    return _curve(plant, rest, points, end)


Step = Callable[[float, np.ndarray], np.ndarray | None]


def _follow(
    step: Step, at: float, here: np.ndarray, target: float, halvings: int
) -> tuple[float, np.ndarray, bool]:
    """As near to the target command as the equilibrium can be followed: command, unknowns, whether it was reached."""
    there = step(target, here)
    if there is not None:
        return target, there, True
    if halvings == 0:
        return at, here, False
    middle = (at + target) / 2
    at, here, reached = _follow(step, at, here, middle, halvings - 1)
    return _follow(step, at, here, target, halvings - 1) if reached else (at, here, False)


def _step(equations: Equations, rest: RestState, start: float, values: np.ndarray) -> Step:
    """From an equilibrium to one nearby under another command, None where there is none that is as stable."""
    n_x = len(equations.states)
    w, u = ca.SX.sym("w", equations.scale.size), ca.SX.sym("u", equations.held_inputs(start).size)
    residual = equations.rest(w[:n_x, :], w[n_x:, :], u, values, equations.constants)
    kept = resting(equations).tolist()
    slope = ca.Function("slope", [w, u], [ca.densify(ca.jacobian(residual, w)[kept, kept])])

    def sign(command: float, unknowns: np.ndarray) -> float:
        return float(np.linalg.slogdet(np.asarray(slope(unknowns, equations.held_inputs(command)))).sign)

    def distance(first: np.ndarray, second: np.ndarray) -> float:
        return float(np.max(np.abs(first - second) / equations.scale, initial=0.0))

    first = np.concatenate([rest.x, rest.z])
    at_rest = sign(start, first)

    def step(command: float, here: np.ndarray) -> np.ndarray | None:
        try:
            tried = rest_state(equations, command, values, guess=here)
        except RuntimeError:  # CasADi's: where Newton left the film's range of stretches, the slope has no value
            return None
        there = np.concatenate([tried.x, tried.z])
        near = tried.found and distance(there, here) < FURTHEST and distance(there, first) < RUNAWAY
        return there if near and sign(command, there) == at_rest else None

    return step


def _curve(
    plant: Plant, rest: RestState, points: list[tuple[float, np.ndarray]], end: CurveEnd
) -> ActuationCurve:
    equations, values, rig = plant.equations, plant.free_values, plant.rig
    n_x = len(equations.states)
    readings, watched = [], []
    for command, w in points:
        point = (w[:n_x], w[n_x:], rest.d, equations.held_inputs(command), 0.0, values, equations.constants)
        readings.append(float(equations.output(*point)))
        watched.append(np.asarray(equations.watched(*point)).ravel())
    unknowns = np.array([w for _, w in points])
    return ActuationCurve(
        commands=np.array([command for command, _ in points]),
        readings=np.array(readings),
        signals=dict(zip(equations.signals, np.array(watched).T, strict=True)),
        unknowns=dict(zip(equations.states + equations.coordinates, unknowns.T, strict=True)),
        end=end,
        axes=((rig.input_name, rig.input_unit), (rig.output_name, rig.output_unit)),
    )
