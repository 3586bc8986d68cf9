"""Model errors of several readings, and their combined information: products over readings are added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deatwin.ident.greybox.covariance import beside
from deatwin.ident.greybox.parts import Part, level_of, simulated
from deatwin.ident.mismatch.likelihood import structured
from deatwin.ident.mismatch.likelihood.beforehand import FAST, NOISE, SPREAD, TIMING, OwnError
from deatwin.ident.mismatch.likelihood.model import LogNormal, Reading
from deatwin.ident.mismatch.likelihood.whitening import grams
from deatwin.ident.mismatch.thresholds import ACCURACY
from deatwin.plant.effects.delay import Delay
from deatwin.plant.model import Plant
from deatwin.plant.rigs.base import Rig


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnErrors:
    """One model error per reading, in the units of `Part.measured`; `at` selects its samples, (n_j,) each."""

    of: tuple[OwnError, ...]
    at: tuple[np.ndarray, ...]

    @property
    def readings(self) -> np.ndarray:
        """Return the simulated readings over all samples, shape (n,)."""
        return self._joined([one.readings for one in self.of])

    @property
    def times(self) -> np.ndarray:
        """Clock times of all samples, shape (n,), s."""
        return self._joined([one.times for one in self.of])

    @property
    def moments(self) -> int:
        """Number of sample times: recordings that begin at the same clock time, and readings, share theirs."""
        return int(np.unique(np.round(self.times / self.of[0].sample_time)).size)

    @property
    def records(self) -> np.ndarray:
        """Return the number of the recording and reading of each sample, shape (n,)."""
        return self._joined([one.records for one in self.of])

    @cached_property
    def columns(self) -> np.ndarray:
        """Return the repeatable error of each reading, shape (n, k): each column is nonzero in one reading only."""
        size, first = sum(at.size for at in self.at), 0
        found = np.zeros((size, sum(one.columns.shape[1] for one in self.of)))
        for one, at in zip(self.of, self.at, strict=True):
            last = first + one.columns.shape[1]
            found[at, first:last] = one.columns
            first = last
        return found

    def columns_after(self, residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """Return the columns after a fit, (n, k), with timing at the size that its residuals, (n,), show."""
        # Any fast motion reveals the time of the readings. Residuals do not reveal how far a fit has absorbed bends and
        # slow errors, so these keep their size.
        free = beside(jacobian, self.columns)
        variance = float(np.mean(residuals**2))
        spread = np.linalg.inv(np.eye(free.shape[1]) + free.T @ free / variance)
        mean = spread @ (free.T @ residuals) / variance
        shown = np.minimum(np.sqrt(mean**2 + np.diag(spread)), 1.0)
        return self.columns * np.where(np.concatenate([one.of_timing for one in self.of]), shown, 1.0)

    def likelihood(self, residuals: np.ndarray, columns: np.ndarray) -> list[Reading]:
        """Return each reading in the form that the likelihood needs; `residuals` (n,), `columns` (n, m)."""
        return [
            Reading(
                times=one.times,
                records=one.records,
                residual=residuals[at],
                columns=columns[at],
                process=one.process,
                kappa=LogNormal(median=FAST * one.rms, spread=SPREAD),
                sigma=LogNormal(median=one.noise, spread=NOISE),
            )
            for one, at in zip(self.of, self.at, strict=True)
        ]

    def each(self, rows: np.ndarray) -> list[np.ndarray]:
        """Return the information of each reading on changes `rows` (m, n), as products of pairs, shape (m, m)."""
        return [products_of(one, rows[:, at]) for one, at in zip(self.of, self.at, strict=True)]

    def products(self, rows: np.ndarray) -> np.ndarray:
        """Return the information of all readings on changes `rows` (m, n), as products of pairs, shape (m, m)."""
        return np.sum(self.each(rows), axis=0)

    def _joined(self, pieces: Sequence[np.ndarray]) -> np.ndarray:
        found = np.empty(sum(at.size for at in self.at))
        for at, piece in zip(self.at, pieces, strict=True):
            found[at] = piece
        return found


def own_errors(
    rig: Rig,
    parts: Sequence[Part],
    readings: np.ndarray,
    noise: float,
    stated: float,
    late: np.ndarray | None = None,
) -> OwnErrors:
    """Return the errors of a plant with `readings`, (n,); the first reading has this `noise` and `stated` error.

    `late`, (n,), is what `later` returns; without it, samples of the first reading count as taken later, too.
    """
    # A further reading has the noise that the rig states. Its error is at least the rig's share of the reading's
    # variation. It may be sampled earlier or later than the rig says, while the motion itself comes early or late.
    whole = np.repeat(np.arange(len(parts)), [part.size for part in parts])
    times, level = np.concatenate([part.timepts for part in parts]), level_of(parts)
    shift = TIMING * rig.sample_time
    own, places = [], []
    for name in dict.fromkeys(part.reading for part in parts):
        at = np.flatnonzero(np.isin(whole, [k for k, part in enumerate(parts) if part.reading == name]))
        sensor, error = noise, stated
        change = -structured.slope(readings[at], times[at], whole[at]) if name or late is None else late[at]
        if name:
            weight = next(part.weight for part in parts if part.reading == name)
            further = next(reading for reading in rig.further if reading.name == name)
            sensor = weight * further.noise
            error = max(weight * further.model_error, rig.share_of_motion * float(np.std(readings[at])))
        own.append(
            OwnError(
                readings=readings[at],
                times=times[at],
                records=whole[at],
                level=level[at],
                sample_time=rig.sample_time,
                noise=max(sensor, ACCURACY * float(np.std(readings[at]))),
                stated=error,
                late=shift * change,
            )
        )
        places.append(at)
    return OwnErrors(of=tuple(own), at=tuple(places))


def later(plant: Plant, parts: Sequence[Part], readings: np.ndarray, shift: float) -> np.ndarray | None:
    """Return the derivative of a plant's `readings` by the time at which the command acts, (n,), with steps of `shift`,
    s; None if it cannot be simulated.
    """
    # The command jumps at the sample times, so the motion has corners there, and its slope before a sample is not that
    # which neighbouring readings show.
    name, sizes = f"{Delay.name}.time", plant.rig.sizes
    delay = Delay() if sizes is None else sizes.of(Delay())
    # half of the range, so that a delay that the plant already has can move either way
    step = min(shift, 0.5 * delay.described(delay.strength).upper)
    known = plant.parameters[name].value if name in plant.parameters else 0.0
    change = step if known < step else -step
    late = plant if name in plant.parameters else plant.with_effects(delay) if plant.accepts(delay) else None
    moved = None if late is None else simulated(late.with_values({name: known + change}), parts)
    return None if moved is None else (moved - readings) / change


def products_of(error: OwnError, rows: np.ndarray) -> np.ndarray:
    """Return the information of one reading on changes `rows` (m, n), after fitting its repeatable error, shape (m,
    m).
    """
    repeats = error.columns.shape[1]
    together = np.ascontiguousarray(np.vstack([error.columns.T, rows]) / error.noise)
    (whole,), _ = grams(error.process, np.array([error.ratio]), (error.times, error.records), together)
    return taken_up(whole, repeats)


def taken_up(whole: np.ndarray, count: int) -> np.ndarray:
    """Return the products after fitting the first coordinates, which have a unit prior deviation; `whole` (m, m)."""
    own, across, among = whole[:count, :count] + np.eye(count), whole[:count, count:], whole[count:, count:]
    return np.asarray(among - across.T @ np.linalg.solve(own, across))
