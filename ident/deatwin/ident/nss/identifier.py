"""Common base of estimators of nonlinear state spaces: scales, linear start, search and model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from deatwin.ident.arguments import real_number, whole_number
from deatwin.ident.look.best_linear import best_linear_approximation
from deatwin.ident.narx.drive import signals_like
from deatwin.ident.narx.estimate import converged
from deatwin.ident.narx.identifier import FitStatus, Identifier, Progress, silent
from deatwin.ident.narx.regression import Recordings, flatten, provenance_of, require_alike, require_no_target
from deatwin.ident.nss.document import weights_of
from deatwin.ident.nss.linear_start import Lines, in_own_coordinates, linear_start
from deatwin.ident.nss.model import NonlinearStateSpace
from deatwin.ident.nss.search import Found, Point, Record, all_fitted, covariance, judged, search, triangle
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

_LINEAR_STEPS = 25  # Steps of the linear start, which need not converge to the last digit
_PATIENCE = 20  # Steps without a lower held-out error after which a search ends: it may rise before a better valley


class StateSpaceIdentifier(Identifier):
    """Base class of the estimators of nonlinear state spaces.

    Attributes
    ----------
    model_ : NonlinearStateSpace
        The identified model. ``theta_cov`` is valid if the noise is white and on the readings.
    status_ : FitStatus
        Outcome. ``DONE``: the gradient of the error over all samples is small. ``INTERRUPTED``: the fit was ended by
        Ctrl-C. ``HELD_OUT``: the held-out error stopped falling, so the fit deliberately ended before the minimum.
        ``NOT_CONVERGED``: the fit reached its largest number of steps, or no further step lowered the error.
    linear_error_ : ndarray, shape (n_outputs,)
        Rms free-run error of the initial linear model over all samples, in the outputs' units.
    error_ : ndarray, shape (n_outputs,)
        Rms free-run error of ``model_`` over all samples, in the outputs' units.
    held_out_error_ : ndarray, shape (n_outputs,)
        Rms free-run error on the held-out samples, in the outputs' units, before the model is refitted to all samples;
        NaN if no samples are held out.
    first_states_ : ndarray, shape (n_recordings, n_states)
        State of the model at the first sample of each recording: the argument ``initial`` of
        `NonlinearStateSpace.simulate`.
    """

    model_: NonlinearStateSpace
    first_states_: Array
    status_: FitStatus
    states: int
    feedthrough: bool
    held_out: float
    max_steps: int

    @abstractmethod
    def _begun(self, linear: Point, records: Sequence[Record]) -> list[Point]:
        """Return the starting points of the search."""

    @abstractmethod
    def _needed(self, record: Recording) -> int:
        """Return the number of free weights, without those that only change the states' coordinates."""

    @abstractmethod
    def _require(self) -> None:
        """Raise ModelError unless the arguments make sense."""

    def fit(self, recordings: Recordings, y: None = None, *, progress: Progress | None = None) -> Self:
        """Estimate the weights from `recordings`; `y` must be None, and `progress` takes a share and a description."""
        from threadpoolctl import threadpool_limits

        require_no_target(y)
        chosen = flatten(recordings)
        require_alike(chosen)
        self._require()
        told = progress or silent
        with threadpool_limits(1):  # tall and narrow matrices, for which more threads only wait for each other
            sides, records = _scaled(chosen, self.held_out, self._needed(chosen[0]))
            told(0.0, "a linear state space")
            found = linear_start(
                records, self.states, lines=_lines(chosen, sides), steps=_LINEAR_STEPS, feedthrough=self.feedthrough
            )
            whole = all_fitted(records)
            self.linear_error_ = _errors(found.point, whole)[0] * sides["output"][1]
            start = found.point
            if not found.interrupted:
                points = self._begun(in_own_coordinates(found.point, records), records)
                start, found = self._searched(points, records, told)
            self.held_out_error_ = _errors(found.point, records)[1] * sides["output"][1]
            overfitted = found.overfitted
            if not found.interrupted:
                found = _on_all(found, start, whole, self.max_steps)
            point, rows = found.point, triangle(found.point, whole)
            self.error_ = _errors(point, whole)[0] * sides["output"][1]
            self.first_states_ = point.starts
            self.model_ = _model(self, point, rows, whole, chosen, sides)
        self.status_ = _status(found, overfitted, rows, whole)
        if not found.interrupted:  # a caller's progress may raise the interrupt again
            told(1.0, "done")
        return self

    def _require_whole(self, *names: str) -> None:
        for name in (*names, "max_steps"):
            whole_number(getattr(self, name), name)
        if not 0.0 <= real_number(self.held_out, "held_out") < 1.0:
            raise ModelError(f"held_out = {self.held_out}; it must be at least 0 and below 1")

    def _searched(self, starts: Sequence[Point], records: Sequence[Record], told: Progress) -> tuple[Point, Found]:
        """Fit all weights from each start; return the best result and its start."""
        found: list[Found] = []
        for number, start in enumerate(starts):

            def say(count: int, point: Point, number: int = number) -> None:
                share = (number + count / self.max_steps) / len(starts)
                told(share, f"step {count} of search {number + 1} of {len(starts)}")

            found.append(
                search(start.system, start.starts, records, steps=self.max_steps, patience=_PATIENCE, progress=say)
            )
            if found[-1].interrupted:
                break
        ends = [one.point.held_out if self.held_out else one.point.cost for one in found]
        best = int(np.argmin(ends))
        return starts[best], replace(found[best], interrupted=found[-1].interrupted)


Sides = dict[str, tuple[Array, Array]]


def _scaled(recordings: Sequence[Recording], held_out: float, needed: int) -> tuple[Sides, list[Record]]:
    """Return origins and scales of inputs and outputs, and the scaled records; ModelError if they are unsuitable."""
    sides = {}
    for side in ("input", "output"):
        rows = np.concatenate([getattr(record, f"{side}s") for record in recordings], axis=1)
        if len(rows) == 0:
            raise ModelError(f"the recordings have no {side}s; a nonlinear state space needs one")
        sides[side] = (rows.mean(axis=1), rows.std(axis=1))
        if flat := [
            name for name, size in zip(getattr(recordings[0], f"{side}_names"), sides[side][1], strict=True) if not size
        ]:
            raise ModelError(f'the {side} "{flat[0]}" is constant: nothing can be learned from it')
    records = []
    for record in recordings:
        inputs, outputs = (
            (signals - sides[side][0][:, None]) / sides[side][1][:, None]
            for side, signals in (("input", record.inputs), ("output", record.outputs))
        )
        fitted = max(round(record.n_samples * (1.0 - held_out)), 1)
        records.append(Record(inputs=inputs, outputs=outputs, fitted=fitted))
    told = sum(record.fitted for record in records) * len(records[0].outputs)
    if told <= needed:
        raise ModelError(
            f"{told} fitted readings for {needed} weights: give longer recordings, fewer states or terms, or less held out"
        )
    return sides, records


def _lines(recordings: Sequence[Recording], sides: Sides) -> Lines | None:
    """Return the best linear approximation in scaled signals; None if the recordings do not allow one."""
    first = recordings[0]
    if len(first.inputs) > 1 or len(first.outputs) > 1:
        return None
    try:
        found = best_linear_approximation(recordings)
    except DataError:
        return None
    by = float(sides["input"][1][0] / sides["output"][1][0])
    deviations = by * np.sqrt(found.variance)
    sound = deviations > 0.0
    angles = 2.0 * np.pi * found.frequencies * first.sample_time
    return by * found.response[sound, None, None], angles[sound], deviations[sound]


def _on_all(found: Found, start: Point, whole: Sequence[Record], max_steps: int) -> Found:
    """Fit all samples: to convergence, or from the start for as many steps as the held-out samples allowed."""
    if not found.overfitted:
        return search(found.point.system, found.point.starts, whole, steps=max_steps)
    again = search(start.system, start.starts, whole, steps=found.steps) if found.steps else found
    # Only if the other samples do not lead the search astray; otherwise the held-out samples found a better end.
    better = again.point.cost < judged(found.point.system, found.point.starts, whole).cost
    return again if better else replace(found, interrupted=again.interrupted)


def _status(found: Found, overfitted: bool, rows: Array, whole: Sequence[Record]) -> FitStatus:
    """Return the status of a search over all samples; `rows` is the `triangle` at its end."""
    if found.interrupted:
        return FitStatus.INTERRUPTED
    readings = np.concatenate([record.outputs.ravel() for record in whole])
    if converged(rows[:, :-1], rows[:, -1], readings.size, float(np.linalg.norm(readings))):
        return FitStatus.DONE
    return FitStatus.HELD_OUT if overfitted else FitStatus.NOT_CONVERGED


def _errors(point: Point, records: Sequence[Record]) -> tuple[Array, Array]:
    """Return the rms error of each output on the fitted and on the held-out samples, in scaled outputs."""
    parts: tuple[list[Array], list[Array]] = ([], [])
    for record, start in zip(records, point.starts, strict=True):
        left = (record.outputs.T - point.system.run(record.inputs, start)[0]) ** 2
        left[np.isnan(left)] = np.inf  # NaN after the end of a diverged run
        parts[0].append(left[: record.fitted])
        parts[1].append(left[record.fitted :])
    fitted, rest = (np.concatenate(part) for part in parts)
    return np.sqrt(fitted.mean(axis=0)), np.sqrt(rest.mean(axis=0)) if len(rest) else np.full(rest.shape[1], np.nan)


def _model(
    identifier: Identifier,
    point: Point,
    rows: Array,
    records: Sequence[Record],
    recordings: Sequence[Recording],
    sides: Sides,
) -> NonlinearStateSpace:
    """Return the model with its covariance; `rows` is the `triangle` at the point."""
    cov, noise = covariance(point, rows, records)
    system = point.system
    return NonlinearStateSpace(
        terms=system.basis.written,
        **weights_of(system),
        theta_cov=cov,
        noise_variance=noise * sides["output"][1] ** 2,
        **signals_like(recordings[0]),
        input_origin=sides["input"][0],
        input_scale=sides["input"][1],
        output_origin=sides["output"][0],
        output_scale=sides["output"][1],
        provenance=provenance_of(identifier, recordings, sum(record.n_samples for record in recordings)),
    )
