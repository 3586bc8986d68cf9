"""The evidence of a diagnosis laid out along one axis of time, ready to be drawn and written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deatwin.plant.files.units import UNITS

if TYPE_CHECKING:
    from deatwin.ident.mismatch import Diagnosis

__all__ = ["Track", "envelope", "tracks"]

Array = np.ndarray
SPACE = 0.02
"""Space between experiments that are drawn one after another, as a share of all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """One record with what was measured and simulated, in the diagnosis' unit.

    Parameters
    ----------
    experiment : int
        Counted from 1.
    clock : ndarray, shape (n,)
        Times on the experiment's own clock, s.
    axis : ndarray, shape (n,)
        Times at which it is drawn, s.
    command, measured, base : ndarray, shape (n,)
        Command in its own unit; readings.
    amended : ndarray, shape (n,), or None
        Readings of the amended plant, where there is one.
    unseen : ndarray of bool, shape (n,)
        Samples that no fit saw.
    sample_time : float
        s.
    """

    experiment: int
    clock: Array
    axis: Array
    command: Array
    measured: Array
    base: Array
    amended: Array | None
    unseen: Array
    sample_time: float


def tracks(diagnosis: Diagnosis) -> tuple[Track, ...]:
    """Lay out the evidence.

    Parameters
    ----------
    diagnosis : Diagnosis
        With evidence.

    Returns
    -------
    tuple of Track
        One for each record. One experiment keeps its clock; several are drawn one after another.
    """
    evidence = diagnosis.evidence
    if evidence is None:
        return ()
    unit = UNITS.get(diagnosis.output["unit"], UNITS[""])
    many = len(evidence.experiments) > 1
    space = SPACE * sum(e.end - e.start for e in evidence.experiments)
    found: list[Track] = []
    shift = 0.0
    for number, experiment in enumerate(evidence.experiments):
        offset = shift - experiment.start if many else 0.0
        for place, record in enumerate(experiment.recordings):
            amended = None if evidence.amended is None else unit.from_si(evidence.amended[number][place])
            found.append(
                Track(
                    experiment=number + 1,
                    clock=record.timepts,
                    axis=record.timepts + offset,
                    command=record.inputs[0],
                    measured=unit.from_si(record.outputs[0]),
                    base=unit.from_si(evidence.base[number][place]),
                    amended=amended,
                    unseen=evidence.unseen[number][place],
                    sample_time=record.sample_time,
                )
            )
        shift += experiment.end - experiment.start + space
    return tuple(found)


def envelope(timepts: Array, values: Array, columns: int = 500) -> tuple[Array, Array]:
    """The samples that a picture of so many columns can show: lowest and highest of each column.

    Parameters
    ----------
    timepts, values : ndarray, shape (n,)
        Of one record.
    columns : int
        Columns of the picture.

    Returns
    -------
    tuple of ndarray
        Times and values, at most two for each column, in order; all of them where there are few.
    """
    n = values.size
    if n <= 2 * columns:
        return timepts, values
    size = -(-n // columns)
    padded = np.concatenate([values, np.full(-n % size, values[-1])]).reshape(-1, size)
    first = size * np.arange(padded.shape[0])
    kept = np.unique(np.minimum(np.concatenate([first + padded.argmin(axis=1), first + padded.argmax(axis=1)]), n - 1))
    return timepts[kept], values[kept]
