"""Actuation curves: where a plant comes to rest under each command, up to the one that it does not survive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from deatwin.plant.branch import branch_step, followed
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, status_of
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import DataError, SimulationError
from deatwin.plant.rest import RestState, rest_state
from deatwin.plant.rest_path import held_rest

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.plant.model import Plant


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


def _along_the_command(curve: ActuationCurve) -> Variables:
    """Watched signals and unknowns, SI, and the readings, which may be one of them."""
    reading, unit = curve.axes[1]
    others = {**curve.unknowns, **curve.signals}
    return {
        **{name: ("command", values) for name, values in others.items() if name not in (reading, "command")},
        reading: ("command", curve.readings, unit),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuationCurve(Described):
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
        marks = {
            "pull-in": ("o", None if self.end.ok else float(self.commands[-1])),
            "breakdown": ("x", self.breakdown_command),
            "slack": ("v", self.slack_command),
        }
        for name, (marker, at) in marks.items():
            if at is not None:
                height = factor * np.interp(at, self.commands, self.readings)
                ax.plot([at], [height], marker, color=line.get_color(), clip_on=False)
                ax.annotate(name, (at, height), xytext=(-6, 3), textcoords="offset points", ha="right")
        ax.set_xlabel(f"{command} ({command_unit})")
        ax.set_ylabel(f"{reading} ({shown})")
        return ax


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
