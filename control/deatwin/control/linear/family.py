"""Linear models at all operating points and samples, as arrays, for the margins of an uncertain model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import instance, numbers, positive, require_fields, taking
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.linear.narx import signals_of
from deatwin.control.linear.realisation import Realisation
from deatwin.ident.arguments import keep_read_only, read_only, real_numbers
from deatwin.ident.frequency.dc import equilibrium, expand
from deatwin.ident.frequency.linear import levels, motion, operating_input_of, polynomial_model
from deatwin.ident.frequency.many import follow_equilibrium, stable_polynomials
from deatwin.ident.narx import NarxModel
from deatwin.plant.arrays import Array, Booleans
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import ModelError
from deatwin.plant.rigs.base import ReadingTime, require_reading_time

_ROUNDING = 4 * np.finfo(float).eps
_LOST = "this sample has no equilibrium at this input on the branch of the model's own"


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearFamily(Rebuilt):
    """Linear models, one for each operating point and each sample of the uncertain parameters.

    The transfer functions are ``G(z) = (b_0 + b_1 z^-1 + ...) / (1 + a_1 z^-1 + ...)``, as in `LinearModel`.

    Parameters
    ----------
    operating_inputs : ndarray, shape (n_points,)
        Constant inputs, in the input's unit.
    operating_outputs : ndarray, shape (n_points, n_samples)
        Outputs at rest, in their unit; NaN if there is no equilibrium.
    numerators : ndarray, shape (n_points, n_samples, n_b)
        Coefficients b_0, b_1, ..., output unit per input unit; zero if there is no equilibrium.
    denominators : ndarray, shape (n_points, n_samples, n_a + 1)
        Coefficients 1, a_1, a_2, ...; 1, 0, 0, ... if there is no equilibrium.
    exists : ndarray of bool, shape (n_points, n_samples)
        True if there is an equilibrium.
    stable : ndarray of bool, shape (n_points, n_samples)
        True if there is a stable equilibrium.
    has_gain : ndarray of bool, shape (n_points, n_samples)
        True if there is an equilibrium, and its static gain is known and not mere rounding error.
    sample_time : float
        Sampling time, s.
    input_name, output_name, input_unit, output_unit : str
        Names and units of the signals.
    realisations : tuple of tuple of (Realisation or None)
        State-space matrices of each model, as ``realisations[point][sample]``; None if there is no equilibrium. If they
        are given, gain, poles and margins are computed from them. Empty if the models are given by coefficients alone.

    Raises
    ------
    ModelError
        If the shapes do not fit together.
    """

    operating_inputs: Array
    operating_outputs: Array
    numerators: Array
    denominators: Array
    exists: Booleans
    stable: Booleans
    has_gain: Booleans
    sample_time: float
    input_name: str = "input"
    output_name: str = "output"
    input_unit: str = ""
    output_unit: str = ""
    realisations: tuple[tuple[Realisation | None, ...], ...] = ()

    def __post_init__(self) -> None:
        require_fields(
            self,
            operating_inputs=numbers,
            operating_outputs=numbers,
            numerators=numbers,
            denominators=numbers,
            sample_time=positive,
        )
        shape = np.shape(self.exists)
        keep_read_only(self, "operating_inputs", "operating_outputs", "numerators", "denominators")
        keep_read_only(self, "exists", "stable", "has_gain", kind=np.bool_)
        fits = [a.shape == shape for a in (self.operating_outputs, self.stable, self.has_gain)]
        fits += [a.ndim == 3 and a.shape[:2] == shape for a in (self.numerators, self.denominators)]
        if self.realisations:
            fits += [[len(row) for row in self.realisations] == [shape[1]] * shape[0]]
        if len(shape) != 2 or 0 in shape or not all(fits) or self.operating_inputs.shape != shape[:1]:
            raise ModelError(
                "a family of linear models needs arrays over the same operating points and samples, "
                "at least one of each"
            )

    @classmethod
    def of(cls, models: Sequence[Sequence[LinearModel]]) -> LinearFamily:
        """Gather linear models into a family.

        Parameters
        ----------
        models : sequence of sequence of LinearModel, lengths n_points and n_samples
            Models as ``models[point][sample]``, all with the same signals and sampling time.

        Returns
        -------
        LinearFamily
            Family whose coefficients are padded with zeros to a common length.

        Raises
        ------
        ModelError
            If there are no models, if the number of samples differs between operating points, or if the models differ in
            their signals or sampling time.
        """
        if not models or not models[0] or any(len(row) != len(models[0]) for row in models):
            raise ModelError("give at least one linear model for each operating point, and as many at each")
        signals = _signals(models[0][0])
        for other in (_signals(m) for row in models for m in row):
            if differing := [name for name, value in signals.items() if other[name] != value]:
                pair = ", ".join(f"{name} {signals[name]!r} and {other[name]!r}" for name in differing)
                raise ModelError(f"the models of a family must have the same signals and sample time; they have {pair}")
        n_b, n_a = (max(getattr(m, k).size for row in models for m in row) for k in ("numerator", "denominator"))
        outputs = [[np.nan if m.operating_output is None else m.operating_output for m in row] for row in models]
        statuses = np.array([[m.status for m in row] for row in models], dtype=object)
        exists = np.isfinite(np.array(outputs))
        return cls(
            operating_inputs=np.array([row[0].operating_input for row in models]),
            operating_outputs=np.array(outputs),
            numerators=np.array([[np.pad(m.numerator, (0, n_b - m.numerator.size)) for m in row] for row in models]),
            denominators=np.array(
                [[np.pad(m.denominator, (0, n_a - m.denominator.size)) for m in row] for row in models]
            ),
            exists=exists,
            stable=exists & (statuses != LinearStatus.UNSTABLE),
            has_gain=exists & (statuses != LinearStatus.NO_GAIN) & (statuses != LinearStatus.INACCURATE),
            **signals,
            realisations=_realisations(models),
        )

    @property
    def n_points(self) -> int:
        """Number of operating points."""
        return self.exists.shape[0]

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.exists.shape[1]

    @cached_property
    def static_gains(self) -> Array:
        """G(1), output unit per input unit, shape (n_points, n_samples); NaN without an equilibrium."""
        if self.realisations:
            known = [[np.nan if one is None else one.static_gain for one in row] for row in self.realisations]
            return read_only(known)
        with np.errstate(divide="ignore", invalid="ignore"):
            gains = self.numerators.sum(axis=2) / self.denominators.sum(axis=2)
        return read_only(np.where(self.exists, gains, np.nan))

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in the z plane, shape (n_points, n_samples, n_a); NaN without an equilibrium."""
        n_a = self.denominators.shape[2] - 1
        if n_a == 0:
            return read_only(np.zeros((*self.exists.shape, 0)), np.complex128)
        if self.realisations:
            modes = [[np.zeros(0) if one is None else one.modes for one in row] for row in self.realisations]
            padded = np.array([[np.pad(one, (0, n_a - one.size)) for one in row] for row in modes], dtype=np.complex128)
            padded[~self.exists] = np.nan
            return read_only(padded, np.complex128)
        companion = np.zeros((*self.exists.shape, n_a, n_a))
        companion[..., 1:, :-1] = np.eye(n_a - 1)
        companion[..., 0, :] = -self.denominators[..., 1:]
        poles = np.linalg.eigvals(companion).astype(np.complex128)
        poles[~self.exists] = np.nan
        return read_only(poles, np.complex128)

    def in_loop(self, reading: ReadingTime) -> LinearFamily:
        """Return the models from the command to the readings, with the delay that a control loop has.

        Parameters
        ----------
        reading : ReadingTime
            Instant within a sample at which the reading is taken.

        Returns
        -------
        LinearFamily
            Family with `LinearModel.in_loop` applied to each model: the first coefficients b_0 are zero.

        Raises
        ------
        ModelError
            If `reading` is not a `ReadingTime`, or if it is the start of the hold although the output depends on the
            command of the same sample.
        """
        require_reading_time(reading, ModelError)
        if reading is ReadingTime.START_OF_HOLD:
            answering = np.argwhere(self.numerators[:, :, 0] != 0.0)
            if answering.size:
                self.at(*(int(i) for i in answering[0])).in_loop(reading)  # raises the error
            return self
        late = tuple(tuple(one and one.delayed() for one in row) for row in self.realisations)
        return replace(self, numerators=np.pad(self.numerators, ((0, 0), (0, 0), (1, 0))), realisations=late)

    def at(self, point: int, sample: int) -> LinearModel:
        """Return the model at the indices `point` and `sample`, without a covariance."""
        signals = _signals(self) | {"operating_input": float(self.operating_inputs[point])}
        if not self.exists[point, sample]:
            return LinearModel.without_equilibrium(_LOST, **signals)
        numerator, denominator = self.numerators[point, sample], self.denominators[point, sample]
        size = numerator.size + denominator.size - 1
        model = LinearModel(
            numerator=numerator,
            denominator=denominator,
            covariance=np.zeros((size, size)),
            operating_output=float(self.operating_outputs[point, sample]),
            realisation=self.realisations[point][sample] if self.realisations else None,
            **signals,
        )
        least_gain = 0.0 if self.has_gain[point, sample] else np.inf
        return model.judged(bool(self.stable[point, sample]), least_gain)


def _signals(owner: LinearModel | LinearFamily) -> dict[str, Any]:
    names = ("sample_time", "input_name", "output_name", "input_unit", "output_unit")
    return {name: getattr(owner, name) for name in names}


@taking(model=instance(NarxModel))
def linearise_many(model: NarxModel, operating_inputs: ArrayLike, thetas: ArrayLike | None = None) -> LinearFamily:
    """Linearise a single-input, single-output model at many operating points and for many parameter samples at once.

    The equilibrium of each sample is found by following the equilibrium of the model in small steps, from the model's
    parameters to those of the sample. If this branch of equilibria ends on the way, the sample has no equilibrium.

    Parameters
    ----------
    model : NarxModel
        Identified model. Apply `LinearFamily.in_loop` to the result before you design a controller.
    operating_inputs : array_like, shape (n_points,)
        Constant inputs, in their unit.
    thetas : array_like, shape (n_samples, n_terms), optional
        Parameter samples, for example drawn by `ThetaPosterior.sample`; by default only the model's own parameters.

    Raises
    ------
    ModelError
        If the model has several inputs or outputs, or if operating inputs or parameters are not finite numbers of the
        stated shapes.
    """
    if len(model.input_names) != 1:
        raise ModelError(f"the model has {len(model.input_names)} inputs; a controller is designed for one")
    polynomial_model(model)
    operating_input_of(model, None)  # raises an error unless the model has one output
    points = np.ravel(real_numbers(operating_inputs, "operating_inputs"))
    samples = np.atleast_2d(model.theta if thetas is None else real_numbers(thetas, "thetas"))
    if not (points.size and np.isfinite(points).all()):
        raise ModelError("operating_inputs must be finite numbers, at least one")
    if samples.shape[1:] != model.theta.shape or not np.isfinite(samples).all():
        raise ModelError(f"thetas have the shape {samples.shape}; they must be finite, {model.theta.size} in a row")
    found = [_at_one_point(model, point, samples) for point in points.tolist()]
    outputs, numerators, denominators, exists = (np.array(values) for values in zip(*found, strict=True))
    stable = exists & stable_polynomials(denominators)
    return LinearFamily(
        operating_inputs=points,
        operating_outputs=outputs,
        numerators=numerators,
        denominators=denominators,
        exists=exists,
        stable=stable,
        has_gain=exists & (numerators.sum(axis=2) != 0.0),
        **signals_of(model),
    )


def _at_one_point(model: NarxModel, level: float, thetas: Array) -> tuple[Array, Array, Array, Booleans]:
    """Return, for each sample, the output at rest, numerator, denominator, and whether there is an equilibrium."""
    variables = model.table.variables
    lags = {kind: max((v.lag for v in variables if v.kind == kind), default=0) for kind in "uy"}
    numerators, denominators = np.zeros((len(thetas), lags["u"] + 1)), np.zeros((len(thetas), lags["y"] + 1))
    denominators[:, 0] = 1.0
    nowhere = np.full(len(thetas), np.nan), numerators, denominators, np.zeros(len(thetas), dtype=np.bool_)
    try:
        point = equilibrium(model, level)
        motion(model, levels(model, point.operating_input, point.output))  # fails without a direction of the branch
    except ModelError:
        return nowhere
    outputs, exists = follow_equilibrium(model, point, thetas)
    inputs = point.operating_input - model.input_origin
    for m, term in enumerate(model.terms):
        for remaining, share, _ in expand(term, inputs, outputs - model.output_origin[0]):
            if remaining.degree == 1:
                (variable,) = remaining.expanded
                side, sign = (denominators, -1.0) if variable.kind == "y" else (numerators, 1.0)
                side[:, variable.lag] += sign * share * thetas[:, m]
    stiffness, sizes = denominators.sum(axis=1), np.abs(denominators).sum(axis=1)
    with np.errstate(invalid="ignore"):
        exists = exists & (np.abs(stiffness) > _ROUNDING * sizes)  # otherwise the model integrates
    exists &= np.isfinite(numerators).all(axis=1) & np.isfinite(denominators).all(axis=1)
    numerators[~exists], denominators[~exists, 1:] = 0.0, 0.0
    return np.where(exists, outputs, np.nan), numerators, denominators, exists


def _realisations(models: Sequence[Sequence[LinearModel]]) -> tuple[tuple[Realisation | None, ...], ...]:
    """Return the realisations of the models, if every model with an equilibrium has one."""
    if any(m.realisation is None and m.operating_output is not None for row in models for m in row):
        return ()
    return tuple(tuple(m.realisation for m in row) for row in models)
