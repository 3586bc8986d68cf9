"""Compute actuation curves: the equilibrium of a plant under each command, up to pull-in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

import numpy as np

from deatwin.plant.arrays import real_numbers
from deatwin.plant.branch import branch_step, followed
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, status_of
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import DataError, SimulationError
from deatwin.plant.model import Plant, require_plant
from deatwin.plant.rest import RestState, rest_state
from deatwin.plant.rest_path import held_rest

HALVINGS = 40
MARKERS = {"pulls in": "o", "breaks down": "x", "goes slack": "v"}
SHOWN = {"m": (1e3, "mm"), "N": (1e3, "mN")}


class CurveEnd(Enum):
    """Reason why a curve ends; each value is an advice to the user."""

    COMMAND = "the last command was reached"
    PULL_IN = "the film pulls in: there is no equilibrium nearby beyond this command"

    @property
    def ok(self) -> bool:
        """True if all commands were reached."""
        return self is CurveEnd.COMMAND


def _along_the_command(curve: ActuationCurve) -> Variables:
    """Return watched signals and unknowns, SI, and the readings."""
    reading, unit = curve.axes[1]
    others = {**curve.unknowns, **curve.signals}
    return {
        **{name: ("command", values) for name, values in others.items() if name not in (reading, "command")},
        reading: ("command", curve.readings, unit),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuationCurve(Described):
    """Equilibria of a plant as a function of the command.

    Parameters
    ----------
    commands : ndarray, shape (n,)
        Commands, in the rig's unit. If the film pulls in, the last value is the command at pull-in.
    readings : ndarray, shape (n,)
        Reading at rest under each command, SI.
    signals : mapping of str to ndarray, each of shape (n,)
        Signals that the rig reports, such as the tension, at each command, SI.
    unknowns : mapping of str to ndarray, each of shape (n,)
        States and coordinates of the plant at each command, SI.
    end : CurveEnd
        Reason why the curve ends.
    axes : tuple of pairs of str
        Name and unit of the command, then of the reading.
    """

    commands: np.ndarray
    readings: np.ndarray
    signals: Mapping[str, np.ndarray]
    unknowns: Mapping[str, np.ndarray]
    end: CurveEnd = field(metadata=status_of())
    axes: tuple[tuple[str, str], tuple[str, str]]

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "curve": several(_along_the_command),
        "commands": coordinate("command", name="command", unit=lambda curve: curve.axes[0][1]),
        "command_name": attribute(of=lambda curve: curve.axes[0][0]),
        "breakdown_command": attribute(),
        "slack_command": attribute(),
    }

    @property
    def breakdown_command(self) -> float | None:
        """Command at which the film breaks down; None without breakdown, or if the rig has no breakdown law."""
        return self._crossing(self.signals.get("breakdown_share", np.zeros(0)) - 1.0)

    @property
    def slack_command(self) -> float | None:
        """Command at which the film loses its tension; None without such a loss, or if the rig reports no tension."""
        return self._crossing(-self.signals.get("tension", np.zeros(0)))

    @property
    def limits(self) -> dict[str, float]:
        """Commands at which the film ``pulls in``, ``breaks down`` or ``goes slack``; only limits that occur."""
        pull_in = None if self.end.ok else float(self.commands[-1])
        found = {"pulls in": pull_in, "breaks down": self.breakdown_command, "goes slack": self.slack_command}
        return {verb: command for verb, command in found.items() if command is not None}

    def _crossing(self, excess: np.ndarray) -> float | None:
        """Return the first command with an excess above 0, which may be the first of all. Shapes: `excess` (n,)."""
        if not (excess > 0).any():
            return None
        if (last := int(np.argmax(excess > 0))) == 0:
            return float(self.commands[0])
        share = excess[last - 1] / (excess[last - 1] - excess[last])
        return float(self.commands[last - 1] + share * (self.commands[last] - self.commands[last - 1]))

    def plot(self, ax: Axes | None = None, **style: object) -> Axes:
        """Plot the reading over the command, with the limits of the command marked, on `ax` or new axes.

        `style` holds matplotlib's properties of the line, such as its colour.
        """
        ax = axes_or_new(ax)
        (command, command_unit), (reading, reading_unit) = self.axes
        factor, shown = SHOWN.get(reading_unit, (1.0, reading_unit))
        (line,) = ax.plot(self.commands, factor * self.readings, **style)  # type: ignore[arg-type]
        for verb, at in self.limits.items():
            height = factor * np.interp(at, self.commands, self.readings)
            ax.plot([at], [height], MARKERS[verb], color=line.get_color(), clip_on=False)
            ax.annotate(verb, (at, height), xytext=(-6, 3), textcoords="offset points", ha="right")
        ax.set_xlabel(f"{command} ({command_unit})")
        ax.set_ylabel(f"{reading} ({shown})")
        return ax


def actuation_curve(plant: Plant, commands: np.ndarray) -> ActuationCurve:
    """Follow the equilibrium of a plant as the command rises from rest.

    Parameters
    ----------
    plant : Plant
        The plant. Effects act as after an infinite hold at each command, except that the clock stays at 0.
    commands : ndarray, shape (n,)
        Commands in the rig's unit, rising from the command at rest.

    Returns
    -------
    ActuationCurve
        The curve, which ends at pull-in if the film pulls in. Pull-in is the command at which the curve of equilibria
        turns back, the displacement grows without bound, or the film would snap to another equilibrium. It is located
        to 1e-12 of the step between commands.

    Raises
    ------
    DataError
        If the commands are not one row of rising finite numbers, or begin below the command at rest.
    ModelError
        If `plant` is not a `Plant`.
    SimulationError
        If the plant has no state of rest.
    """
    require_plant(plant, "an actuation curve")
    equations, values, start = plant.equations, plant.free_values, plant.rig.start.rest_command
    wanted = real_numbers(commands, "commands")
    if wanted.ndim != 1 or wanted.size == 0 or not np.all(np.isfinite(wanted)):
        raise DataError(f"commands of shape {wanted.shape}: need one row of at least one finite number")
    if wanted[0] < start or np.any(np.diff(wanted) <= 0):
        raise DataError(f"an actuation curve needs commands that rise from {start:g}, the one at rest")
    rest = rest_state(equations, start, values)
    if not rest.found:
        raise SimulationError(rest.fault)
    step = branch_step(equations, rest, start, values)
    here, at, end = np.concatenate([rest.x, rest.z]), start, CurveEnd.COMMAND
    points: list[tuple[float, np.ndarray]] = []
    for command in wanted:
        at, here, reached = followed(step, at, here, command, HALVINGS)
        points.append((at, here))
        if not reached:
            end = CurveEnd.PULL_IN
            break
    return _curve(plant, rest, points, end)


def _curve(plant: Plant, rest: RestState, points: list[tuple[float, np.ndarray]], end: CurveEnd) -> ActuationCurve:
    equations, values, rig = plant.equations, plant.free_values, plant.rig
    n_x = len(equations.states)
    points = [(command, held_rest(equations, w, rest.d, command, values)) for command, w in points]
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
