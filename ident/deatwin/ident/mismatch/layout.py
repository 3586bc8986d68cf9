"""Arrange recordings and simulations along one time axis for figures and tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.plant.amplitudes import reported_size, written_unit
from deatwin.plant.drawing import Axes
from deatwin.plant.recording import Experiment

SPACE = 0.02
"""Gap between experiments that are drawn one after another, as a share of their total length."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Recorded and simulated values of one reading, in SI units.

    Parameters
    ----------
    experiments : tuple of Experiment
        The recordings.
    base : tuple of tuple of ndarray, each of shape (n,)
        Simulation without the effects found, for each experiment and each of its recordings.
    amended : tuple of tuple of ndarray, each of shape (n,), or None
        Simulation with the effects found, in the same form; None if no effect was found.
    unseen : tuple of tuple of ndarray of bool, each of shape (n,)
        True at held-out samples, to which nothing was fitted before the verdict.
    reading : str
        Name of the reading; empty for the first reading of the rig.
    """

    experiments: tuple[Experiment, ...]
    base: tuple[tuple[np.ndarray, ...], ...]
    amended: tuple[tuple[np.ndarray, ...], ...] | None
    unseen: tuple[tuple[np.ndarray, ...], ...]
    reading: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """One record with its recorded and simulated readings, in the reported unit."""

    experiment: int  # counted from 1
    clock: np.ndarray  # (n,), times on the experiment's own clock, s
    axis: np.ndarray  # (n,), times on the axis of the drawing, s
    command: np.ndarray  # (n,), in its own unit
    measured: np.ndarray  # (n,)
    base: np.ndarray  # (n,)
    amended: np.ndarray | None  # (n,), None if there is no amended plant
    unseen: np.ndarray  # (n,), bool, samples that no fit saw
    sample_time: float


def laid_out(readings: Readings, size: float) -> tuple[Stretch, ...]:
    """Lay out records and their simulations; several experiments are drawn one after another.

    `size` is the SI size of the unit in which readings are reported.
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
    """Return the first and the last-plus-one sample of each run of true flags, (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def draw_residuals(readings: Readings, unit: str, axes: Axes) -> None:
    """Draw the residuals of the calibrated and of the amended plant, in `unit`; the held-out part is shaded."""
    first = True
    for each in laid_out(readings, reported_size(unit, readings.experiments[0].recordings[0].output_units[0])):
        hide = "" if first else "_"
        axes.plot(each.axis, each.measured - each.base, color="C1", linewidth=0.8, label=f"{hide}calibrated model")
        if each.amended is not None:
            axes.plot(each.axis, each.measured - each.amended, color="C0", linewidth=0.8, label=f"{hide}amended model")
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
