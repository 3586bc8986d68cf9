"""Arrange recordings and simulations along one time axis for figures and tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deatwin.plant.amplitudes import reported_size, written_unit
from deatwin.plant.recording import Experiment

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SPACE = 0.02
"""Space between experiments that are drawn one after another, as a share of all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Recorded readings with the simulated ones; SI.

    Parameters
    ----------
    experiments : tuple of Experiment
        The recordings.
    base : tuple of tuple of ndarray, each of shape (n,)
        Readings of the calibrated base plant, for each experiment and record.
    amended : same shape, or None
        Readings of the amended plant; None if there are no causes.
    unseen : tuple of tuple of ndarray of bool
        Held-out samples, to which nothing was fitted before the verdict.
    reading : str
        Name of a further reading; empty for the first one.
    """

    experiments: tuple[Experiment, ...]
    base: tuple[tuple[np.ndarray, ...], ...]
    amended: tuple[tuple[np.ndarray, ...], ...] | None
    unseen: tuple[tuple[np.ndarray, ...], ...]
    reading: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """One record with measured and simulated readings, in the reported unit.

    Parameters
    ----------
    experiment : int
        Counted from 1.
    clock : ndarray, shape (n,)
        Times on the experiment's own clock, s.
    axis : ndarray, shape (n,)
        Times on the axis of the figure, s.
    command, measured, base : ndarray, shape (n,)
        Command in its own unit; readings.
    amended : ndarray, shape (n,), or None
        Readings of the amended plant; None if there is none.
    unseen : ndarray of bool, shape (n,)
        Held-out samples.
    sample_time : float
        s.
    """

    experiment: int
    clock: np.ndarray
    axis: np.ndarray
    command: np.ndarray
    measured: np.ndarray
    base: np.ndarray
    amended: np.ndarray | None
    unseen: np.ndarray
    sample_time: float


def laid_out(readings: Readings, size: float) -> tuple[Stretch, ...]:
    """Arrange recordings and simulations along one time axis.

    Parameters
    ----------
    readings : Readings
        Of a diagnosis.
    size : float
        Of the unit in which readings are reported, SI.

    Returns
    -------
    tuple of Stretch
        One for each record. One experiment keeps its clock; several are drawn one after another.
    """
    many = len(readings.experiments) > 1
    space = SPACE * sum(e.end - e.start for e in readings.experiments)
    found: list[Stretch] = []
    shift = 0.0
    for number, experiment in enumerate(readings.experiments):
        offset = shift - experiment.start if many else 0.0
        for place, record in enumerate(experiment.recordings):
            amended = None if readings.amended is None else readings.amended[number][place] / size
            found.append(
                Stretch(
                    experiment=number + 1,
                    clock=record.timepts,
                    axis=record.timepts + offset,
                    command=record.inputs[0],
                    measured=record.reading(readings.reading) / size,
                    base=readings.base[number][place] / size,
                    amended=amended,
                    unseen=readings.unseen[number][place],
                    sample_time=record.sample_time,
                )
            )
        shift += experiment.end - experiment.start + space
    return tuple(found)


def stretches_of_true(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs of true samples.

    Parameters
    ----------
    flags : ndarray of bool, shape (n,)
        Any.

    Returns
    -------
    list of tuple of int
        First and last-plus-one sample of each run.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def draw_residuals(readings: Readings, unit: str, axes: Axes) -> None:
    """Draw the residuals of the calibrated and of the amended plant, with the held-out part shaded.

    Parameters
    ----------
    readings : Readings
        Of a diagnosis.
    unit : str
        In which readings are reported.
    axes : matplotlib Axes
        Where to draw.
    """
    first = True
    for each in laid_out(readings, reported_size(unit, readings.experiments[0].recordings[0].output_units[0])):
        hide = "" if first else "_"
        axes.plot(each.axis, each.measured - each.base, color="C1", linewidth=0.8, label=f"{hide}calibrated plant")
        if each.amended is not None:
            axes.plot(each.axis, each.measured - each.amended, color="C0", linewidth=0.8, label=f"{hide}amended plant")
        for begin, end in stretches_of_true(each.unseen):
            span = each.axis[begin], each.axis[end - 1] + each.sample_time
            axes.axvspan(*span, color="0.5", alpha=0.18, linewidth=0, label=f"{hide}held out")
            hide = "_"
        first = False
    axes.axhline(0.0, color="0.4", linewidth=0.6)
    shown = written_unit(unit)
    axes.set_ylabel(f"measured − simulated ({shown})" if shown else "measured − simulated")
    several = len(readings.experiments) > 1
    axes.set_xlabel("time, experiments one after another (s)" if several else "time (s)")
    axes.legend(loc="upper left", ncols=3)
