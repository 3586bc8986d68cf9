"""Simulated recordings of an experiment, and the events of the film."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from deatwin.plant.datasets import Brief, dataset, simulated_clock
from deatwin.plant.errors import SimulationError
from deatwin.plant.limits import Event, film_events
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording, as_experiment
from deatwin.plant.rigs.base import Rig
from deatwin.plant.simulate import Run, RunStatus
from deatwin.plant.timeline import Timeline


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation(Brief):
    """Simulated recordings of an experiment.

    Parameters
    ----------
    status : RunStatus
        How the simulation ended. If it reached its end and events occurred, the status is that of the first event.
    outputs : tuple of ndarray, each of shape (n_readings, n)
        Noise-free readings of each recording, SI, with one row for each of `Rig.readings`; NaN after a failure.
    watched : tuple of mapping of str to ndarray, each of shape (n,)
        Internal signals of the plant in each recording, by name, SI: at the start of each
        sample if the reading is taken there, otherwise at its end.
    failed_at : float or None
        Time at which the simulation failed, on the experiment's clock, s; None without a failure.
    failed_command : float or None
        Command at which the simulation failed, in `command_unit`; None without a failure.
    command_unit : str
        Unit of the command.
    readings : tuple of Reading
        Description of each row of the outputs, with its name and unit.
    events : tuple of Event
        Events of the film, such as loss of tension, breakdown or pull-in, in order of time. They include events during
        the start procedure.
    advice : str
        Message for the user about `status`. For a plant without a state of rest, it names the equation at fault.
    """

    status: RunStatus
    outputs: tuple[np.ndarray, ...]
    watched: tuple[Mapping[str, np.ndarray], ...]
    failed_at: float | None = None
    failed_command: float | None = None
    command_unit: str = "V"
    readings: tuple[Reading, ...] = ()
    events: tuple[Event, ...] = ()
    advice: str = ""

    @classmethod
    def of(cls, run: Run, timeline: Timeline, names: Sequence[str], rig: Rig) -> Self:
        """Make the simulation from a run over a timeline.

        Parameters
        ----------
        run : Run
            Result of the run, with or without internal signals.
        timeline : Timeline
            Timeline that was simulated.
        names : sequence of str
            Names of the internal signals.
        rig : Rig
            Rig that was simulated.
        """
        full = np.full((1 + run.further.shape[1], timeline.commands.size + 1), np.nan)
        full[:, : run.outputs.size] = np.column_stack([run.outputs, run.further]).T
        signals = np.full((len(names), timeline.commands.size + 1), np.nan)
        seen = np.empty((len(names), 0)) if run.watched is None else run.watched
        signals[:, 1 : 1 + seen.shape[1]] = seen
        signals[:, 0] = signals[:, 1] if run.watched_at_rest is None else run.watched_at_rest
        events = film_events(dict(zip(names, seen, strict=True)), run.status, timeline, run.snaps)
        failed = run.failed_at
        status = events[0].status if run.status.ok and events else run.status
        return cls(
            status=status,
            advice=run.advice if status is run.status else status.value,
            outputs=tuple(full[:, r + 1] for r in timeline.readings),
            watched=tuple({n: signals[k, r + 1] for k, n in enumerate(names)} for r in timeline.readings),
            failed_at=None if failed is None else timeline.start + failed * timeline.sample_time,
            failed_command=None if failed is None else float(timeline.commands[failed]),
            command_unit=rig.input_unit,
            readings=rig.readings,
            events=events,
        )

    @property
    def sound_until(self) -> float:
        """Clock time after which the simulated readings are unreliable, s; infinite if all are reliable.

        A snap to another equilibrium does not make the readings unreliable.
        """
        unsound = (event.time for event in self.events if event.status is not RunStatus.SNAP_THROUGH)
        return min(unsound, default=np.inf)

    def to_xarray(self, experiment: Experiment | Recording) -> Any:
        """Return commands, readings and internal signals as an `xarray.Dataset` over all samples.

        Parameters
        ----------
        experiment : Experiment or Recording
            Experiment that was simulated, with clock and commands.

        Returns
        -------
        xarray.Dataset
            Dataset with the dimension ``sample`` and the coordinates ``time`` in s and ``record``. The first reading is
            the variable ``reading``, and a further reading such as the current is ``current_reading``.

        Raises
        ------
        DataError
            If `experiment` has other numbers of samples than the simulation.
        """
        along = simulated_clock(experiment, [y[0] for y in self.outputs])
        names = ["reading", *(f"{one.name}_reading" for one in self.readings[1:])]
        return dataset(
            {
                **{name: ("sample", _joined([w[name] for w in self.watched])) for name in self.watched[0]},
                "command": (
                    "sample",
                    _joined([r.inputs[0] for r in as_experiment(experiment).recordings]),
                    self.command_unit,
                ),
                **{
                    name: ("sample", _joined([y[k] for y in self.outputs]), one.unit)
                    for k, (name, one) in enumerate(zip(names, self.readings, strict=True))
                },
            },
            along,
            {
                "status": self.status.name,
                "advice": self.advice,
                "failed_at_s": self.failed_at,
                "failed_command": self.failed_command,
                "reading_name": self.readings[0].name,
                "events": [f"{event.status.name} at {event.time:g} s" for event in self.events],
            },
        )

    def require(self) -> Self:
        """Return this simulation; SimulationError with time, command and place if the end was not reached."""
        if self.status.ok:
            return self
        where = ""
        if self.failed_at is not None:
            where = f" at {self.failed_at:.2f} s and a command of {self.failed_command:.3f} {self.command_unit}"
        places = [event.place for event in self.events if event.status is self.status and event.place]
        where += "".join(f", {place}" for place in places)
        raise SimulationError(f"the simulation stopped{where}: {self.advice}")


def _joined(rows: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate(rows)
