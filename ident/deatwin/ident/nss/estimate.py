"""The estimator of nonlinear state spaces: a linear one, then its nonlinear terms by the least free-run error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.look.best_linear import best_linear_approximation
from deatwin.ident.narx.identifier import FitStatus, Identifier, Progress, silent
from deatwin.ident.narx.regression import Recordings, flatten, require_alike
from deatwin.ident.nss.basis import Basis, monomials
from deatwin.ident.nss.document import WEIGHTS
from deatwin.ident.nss.linear_start import Lines, in_own_coordinates, linear_start
from deatwin.ident.nss.march import System
from deatwin.ident.nss.model import NonlinearStateSpace
from deatwin.ident.nss.search import Found, Point, Record, all_fitted, covariance, search
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]
_LINEAR_STEPS = 25
"""Of the linear start, whose end is not needed to the last digit."""


class Pnlss(Identifier):
    """Polynomial nonlinear state space, with functions as terms, by the least error of the free run.

    The start is a linear state space: by subspace identification from the best linear approximation where the input is
    periodic, or from the samples, then by the free run. Its state is turned into the first output, its changes, and so
    on, each of unit size and without what is in those before, so that x1 is about the output and x2 its rate. Then all
    weights are fitted by Levenberg's and Marquardt's method with exact sensitivities. The free run over the end of each
    recording, which is not fitted, ends the search; if its error still falls at the end, all samples are fitted then.

    Parameters
    ----------
    states : int
        Number of states.
    degrees : sequence of int
        Degrees, from 2 on, of the monomials in the equation of the state.
    output_degrees : sequence of int
        Degrees of the monomials in the equation of the output.
    inputs_in_products : bool
        True if monomials hold inputs too; False if states alone.
    terms, output_terms : sequence of str
        Further terms of the state and of the output, as ``"|x2|"``, ``"tanh(s1,1) u"`` or one with a function of
        `register_function`. Functions that are built in are those of NARX terms.
    directions : int
        Number of weighted sums s1, s2, ... of 1, states and inputs that terms may hold; their weights are learned too.
    starts : int
        Number of random starts of the directions, of which the one with the least held-out error is kept.
    feedthrough : bool
        True if inputs act on the output within the sample.
    held_out : float
        Share of each recording, at its end, that ends the search; 0 to fit all samples.
    max_steps : int
        Largest number of steps of a search.
    seed : int
        Seed of the random starts.

    Attributes
    ----------
    model_ : NonlinearStateSpace
        The identified model. ``theta_cov`` is valid if the noise is white and on the readings.
    status_ : FitStatus
        Outcome of the search.
    linear_error_, error_, held_out_error_ : ndarray, shape (n_outputs,)
        Root mean square of the free-run error of the linear start and of the model on the fitted samples, and of the
        model on the held-out ones (NaN without), in the outputs' units.

    References
    ----------
    Paduart, Lauwers, Swevers, Smolders, Schoukens, Pintelon, "Identification of nonlinear systems using polynomial
    nonlinear state space models", Automatica 46 (2010) 647-656, doi:10.1016/j.automatica.2010.01.001.
    """

    model_: NonlinearStateSpace

    def __init__(
        self,
        *,
        states: int = 2,
        degrees: Sequence[int] = (2, 3),
        output_degrees: Sequence[int] = (),
        inputs_in_products: bool = True,
        terms: Sequence[str] = (),
        output_terms: Sequence[str] = (),
        directions: int = 0,
        starts: int = 1,
        feedthrough: bool = True,
        held_out: float = 0.2,
        max_steps: int = 100,
        seed: int = 0,
    ) -> None:
        self.states = states
        self.degrees = degrees
        self.output_degrees = output_degrees
        self.inputs_in_products = inputs_in_products
        self.terms = terms
        self.output_terms = output_terms
        self.directions = directions
        self.starts = starts
        self.feedthrough = feedthrough
        self.held_out = held_out
        self.max_steps = max_steps
        self.seed = seed

    def fit(self, recordings: Recordings, *, progress: Progress | None = None) -> Self:
        """Estimate the weights.

        Ctrl-C ends the search: the best model so far is kept, and ``status_`` says so.

        Parameters
        ----------
        recordings : Recording, Experiment, or several
            Training data with a common sample time; each recording has its own first state.
        progress : callable, optional
            Called with the share done, between 0 and 1, and a description of the current step.

        Returns
        -------
        Pnlss
            The estimator itself.

        Raises
        ------
        ModelError
            If an argument makes no sense, or the recordings do not suit the estimator.
        """
        from threadpoolctl import threadpool_limits

        chosen = flatten(recordings)
        require_alike(chosen)
        self._require()
        told = progress or silent
        with threadpool_limits(1):  # tall and narrow matrices: more threads only wait for each other
            sides, records = _scaled(chosen, self.held_out, self._needed(chosen[0]))
            told(0.0, "a linear state space")
            point = linear_start(
                records, self.states, lines=_lines(chosen, sides), steps=_LINEAR_STEPS, feedthrough=self.feedthrough
            )
            self.linear_error_ = _errors(point, records)[0] * sides["output"][1]
            found = self._nonlinear(in_own_coordinates(point, records), records, told)
            point, whole = found.point, all_fitted(records)
            self.held_out_error_ = _errors(point, records)[1] * sides["output"][1]
            if not (found.overfitted or found.interrupted):
                last = search(point.system, point.starts, whole, steps=self.max_steps)
                point = last.point if np.isfinite(last.point.cost) else point
            self.error_ = _errors(point, records)[0] * sides["output"][1]
            self.model_ = _model(self, point, whole, chosen, sides)
        self.status_ = FitStatus.INTERRUPTED if found.interrupted else FitStatus.DONE
        told(1.0, "done")
        return self

    def _require(self) -> None:
        """Raise ModelError unless the arguments make sense."""
        for name in ("states", "starts", "max_steps"):
            if not (isinstance(getattr(self, name), int | np.integer) and getattr(self, name) >= 1):
                raise ModelError(f"{name} = {getattr(self, name)!r}; it must be a whole number of at least 1")
        if not 0.0 <= self.held_out < 1.0:
            raise ModelError(f"held_out = {self.held_out}; it must be at least 0 and below 1")
        wrong = [d for d in (*self.degrees, *self.output_degrees) if not isinstance(d, int | np.integer) or d < 2]
        if wrong:
            raise ModelError(
                f"a degree of {wrong[0]}; degrees are whole numbers from 2 on, linear terms are always there"
            )
        if self.directions < 0:
            raise ModelError(f"directions = {self.directions}; it must not be negative")

    def _needed(self, record: Recording) -> int:
        """Return the free weights of a model over such recordings, the states' coordinates not counted."""
        basis, rates, readings = self._basis(len(record.inputs))
        n, p = self.states, len(record.outputs)
        weights = self.directions * basis.linear + n * (basis.linear + len(rates)) + p * (basis.linear + len(readings))
        return weights - n * n

    def _basis(self, n_inputs: int) -> tuple[Basis, tuple[str, ...], tuple[str, ...]]:
        """Return the regressors, and which terms are in the equation of the state and of the output."""
        names = Basis(self.states, n_inputs, 0, ()).names[: None if self.inputs_in_products else self.states]
        rates = tuple(dict.fromkeys((*monomials(names, self.degrees), *self.terms)))
        readings = tuple(dict.fromkeys((*monomials(names, self.output_degrees), *self.output_terms)))
        basis = Basis(self.states, n_inputs, self.directions, tuple(dict.fromkeys((*rates, *readings))))
        held = {basis.names[factor.variable] for term in basis.terms for factor in term}
        if unused := [name for name in basis.names if name[0] == "s" and name not in held]:
            raise ModelError(f"no term holds the direction {unused[0]}: give fewer directions, or a term of it")
        return basis, rates, readings

    def _nonlinear(self, linear: Point, records: Sequence[Record], told: Progress) -> Found:
        """Fit all weights from each start, and return the best end."""
        found: list[Found] = []
        tried = self.starts if self.directions else 1
        rng = np.random.default_rng(self.seed)
        for number in range(tried):
            system = self._begun(linear.system, rng)

            def say(count: int, point: Point, number: int = number) -> None:
                told((number + count / self.max_steps) / tried, f"step {count} of search {number + 1} of {tried}")

            found.append(search(system, linear.starts, records, steps=self.max_steps, patience=20, progress=say))
            if found[-1].interrupted:
                break
        best = min(found, key=lambda one: one.point.held_out if self.held_out else one.point.cost)
        return replace(best, interrupted=found[-1].interrupted)

    def _begun(self, linear: System, rng: np.random.Generator) -> System:
        """Return the linear system with all terms, whose weights are zero."""
        basis, rates, readings = self._basis(linear.basis.inputs)
        first = basis.linear
        held = {"transition": rates, "output": readings}
        weights, free = {}, {}
        for name, terms in held.items():
            known = getattr(linear, name)
            weights[name] = np.zeros((len(known), basis.size))
            weights[name][:, :first] = known
            free[name] = np.ones(weights[name].shape, dtype=bool)
            free[name][:, first:] = [term in terms for term in basis.written]
        free["output"][:, 1 + basis.states : first] = self.feedthrough
        # Directions of unit size, over states and inputs of unit size: functions bend where the data are.
        drawn = rng.standard_normal((basis.directions, first))
        weights["directions"] = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
        free["directions"] = np.ones(drawn.shape, dtype=bool)
        return System(basis=basis, **weights, **{f"free_{name}": free[name] for name in WEIGHTS})


Sides = dict[str, tuple[Array, Array]]


def _scaled(recordings: Sequence[Recording], held_out: float, needed: int) -> tuple[Sides, list[Record]]:
    """Return origins and scales of inputs and outputs, and the scaled records; ModelError where they tell too little."""
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
    """Return the best linear approximation in scaled signals; None where the recordings do not give one."""
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


def _errors(point: Point, records: Sequence[Record]) -> tuple[Array, Array]:
    """Return the rms error of each output on the fitted and on the held-out samples, in scaled outputs."""
    parts: tuple[list[Array], list[Array]] = ([], [])
    for record, start in zip(records, point.starts, strict=True):
        left = (record.outputs.T - point.system.run(record.inputs, start)[0]) ** 2
        parts[0].append(left[: record.fitted])
        parts[1].append(left[record.fitted :])
    fitted, rest = (np.concatenate(part) for part in parts)
    return np.sqrt(fitted.mean(axis=0)), np.sqrt(rest.mean(axis=0)) if len(rest) else np.full(rest.shape[1], np.nan)


def _model(
    identifier: Identifier, point: Point, records: Sequence[Record], recordings: Sequence[Recording], sides: Sides
) -> NonlinearStateSpace:
    """Return the model with its covariance."""
    cov, noise, _ = covariance(point, records)
    first, system = recordings[0], point.system
    files = [record.provenance["file"] for record in recordings if "file" in record.provenance]
    return NonlinearStateSpace(
        terms=system.basis.written,
        **{name: getattr(system, name) for name in (*WEIGHTS, *(f"free_{name}" for name in WEIGHTS))},
        theta_cov=cov,
        noise_variance=noise * sides["output"][1] ** 2,
        sample_time=first.sample_time,
        input_names=first.input_names,
        output_names=first.output_names,
        input_units=first.input_units,
        output_units=first.output_units,
        **{
            f"{side}_{key}": values
            for side, both in sides.items()
            for key, values in zip(("origin", "scale"), both, strict=True)
        },
        provenance={
            "identifier": repr(identifier),
            "samples": str(sum(record.n_samples for record in recordings)),
            "recordings": ", ".join(files) or str(len(recordings)),
        },
    )
