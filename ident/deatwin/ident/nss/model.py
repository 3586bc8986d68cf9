"""The nonlinear state space: weights with their covariance; free run, bands, poles of its linear part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import positive, read_only, real_numbers, whole_number
from deatwin.ident.narx.document import set_covariance, set_signals
from deatwin.ident.narx.drive import Drive, require_suits
from deatwin.ident.narx.posterior import PredictiveBand, quantile
from deatwin.ident.narx.response import DIVERGED, NarxResponse, ResponseStatus, response_over
from deatwin.ident.narx.shapes import own_functions, rebuilt
from deatwin.ident.nss.basis import Basis, numbered
from deatwin.ident.nss.document import SCHEMA, WEIGHTS, fields_of, to_document, weights_of
from deatwin.ident.nss.march import System
from deatwin.ident.nss.search import Opening, opened
from deatwin.plant.arrays import Array, texts
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, document, squared, variable
from deatwin.plant.documents import Saved
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_WARMUP_PER_STATE = 10  # Samples from which the first state is estimated: its noise falls with their square root


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearStateSpace(Described, Saved, schema=SCHEMA, document=to_document, fields=fields_of):
    """Nonlinear state space x(k+1) = W phi(k), y(k) = V phi(k) + e(k).

    x are the states, y the outputs and e the noise of the readings. The regressors phi are 1, the states, the inputs
    and the terms. A term is a product of powers and functions of states (x1, x2, ...), inputs (u, or u1, u2, ...) and
    directions (s1, s2, ...). A direction is a weighted sum of the regressors, s = P phi; the terms in this sum may
    contain directions of lower number only. In these equations, each input and output is scaled: its origin is subtracted, and
    the result is divided by its scale.

    Parameters
    ----------
    terms : sequence of str
        Nonlinear terms, such as ``"x1^2 u"``, ``"|x2|"`` or ``"tanh(s1,1)"``, which is tanh(s1/1).
    transition : array_like, shape (n_states, n_regressors)
        Matrix W. Its columns are the weights of 1, the states, the inputs and the terms, in this order.
    output : array_like, shape (n_outputs, n_regressors)
        Matrix V, with columns in the same order.
    directions : array_like, shape (n_directions, n_regressors), optional
        Matrix P, with columns in the same order; no directions if omitted.
    sample_time : float
        Sampling interval in s.
    free_directions, free_transition, free_output : array_like of bool, optional
        True for each weight of P, W and V that was estimated (a free weight); all are free if omitted.
    theta_cov : array_like, shape (n_theta, n_theta), optional
        Covariance of the free weights of P, W and V, row by row; zero if omitted. It is valid if the errors of the free
        run are white. Changes of the weights that only transform the states leave the outputs unchanged and have zero
        variance.
    noise_variance : array_like, shape (n_outputs,), optional
        Variance of the noise e, in the squared units of the outputs; zero if omitted.
    input_names, output_names, input_units, output_units : sequence of str, optional
        Names and units of the signals.
    input_origin, input_scale, output_origin, output_scale : array_like, optional
        Origins and scales of the signals, in their units; 0 and 1 if omitted.
    provenance : mapping of str to str
        Notes on the origin of the model, such as the identifier and the recordings.

    Raises
    ------
    ModelError
        If shapes or values are inconsistent, or a term cannot be parsed.

    Examples
    --------
    >>> import numpy as np
    >>> model = NonlinearStateSpace(
    ...     terms=["x1^3"], transition=[[0, 0.5, 1, -0.1]], output=[[0, 1, 0, 0]], sample_time=1.0
    ... )
    >>> model.simulate(np.ones(5), initial=[0.0]).outputs.round(4).tolist()
    [[0.0, 1.0, 1.4, 1.4256, 1.4231]]
    """

    terms: tuple[str, ...]
    transition: Array
    output: Array
    sample_time: float
    directions: Array = field(default_factory=lambda: np.zeros((0, 0)))
    free_directions: NDArray[np.bool_] | None = None
    free_transition: NDArray[np.bool_] | None = None
    free_output: NDArray[np.bool_] | None = None
    theta_cov: Array = field(default_factory=lambda: np.zeros((0, 0)))
    noise_variance: Array = field(default_factory=lambda: np.zeros(0))
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    input_origin: Array = field(default_factory=lambda: np.zeros(0))
    input_scale: Array = field(default_factory=lambda: np.zeros(0))
    output_origin: Array = field(default_factory=lambda: np.zeros(0))
    output_scale: Array = field(default_factory=lambda: np.zeros(0))
    provenance: Mapping[str, str] = field(default_factory=dict)

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "regressor": coordinate("regressor", of=lambda model: list(model.system.basis.labels)),
        "output_name": coordinate("output", name="output", of=lambda model: list(model.output_names)),
        "transition": variable("state", "regressor"),
        "output": variable("output", "regressor", name="output_weights"),
        "directions": variable("direction", "regressor"),
        "theta_cov": variable("weight", "other_weight"),
        "noise_variance": variable(
            "output", unit=lambda model: squared(model.output_units[0] if len({*model.output_units}) == 1 else "")
        ),
        "sample_time": attribute(),
        **{
            f"{side}_{key}": attribute(of=lambda model, name=f"{side}_{key}": list(getattr(model, name)))
            for side in ("input", "output")
            for key in ("names", "units", "origin", "scale")
        },
        "document": document(to_document),
    }

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process may not know the registered functions of the terms.
        return rebuilt, (own_functions(" ".join(self.terms)), *super().__reduce__())

    def __post_init__(self) -> None:
        terms = texts(self.terms)
        w, v = (np.atleast_2d(real_numbers(getattr(self, name), name)) for name in ("transition", "output"))
        n, p = len(w), len(v)
        m = w.shape[1] - 1 - n - len(terms)
        if m < 1 or v.shape[1] != w.shape[1]:
            raise ModelError(
                f"transition of shape {w.shape} and output of shape {v.shape}: both need a column for 1, for each of "
                f"the {n} states, for each input and for each of the {len(terms)} terms"
            )
        directions = real_numbers(self.directions, "directions")
        directions = directions if directions.size else np.zeros((0, w.shape[1]))
        if directions.ndim != 2 or directions.shape[1] != w.shape[1]:
            raise ModelError(f"directions have the shape {directions.shape}; they need {w.shape[1]} columns")
        weights = dict(zip(WEIGHTS, (directions, w, v), strict=True))
        for name, values in weights.items():
            given = getattr(self, f"free_{name}")
            free = np.ones(values.shape, dtype=bool) if given is None else _truths(given, f"free_{name}")
            free = free.reshape(values.shape) if free.size == values.size == 0 else free
            if free.shape != values.shape or not np.all(np.isfinite(values)):
                raise ModelError(f"{name} and free_{name} must be finite and of one shape; got {free.shape}")
            free.setflags(write=False)
            object.__setattr__(self, name, read_only(values))
            object.__setattr__(self, f"free_{name}", free)
        object.__setattr__(self, "terms", terms)
        self._take_signals({"input": m, "output": p})
        object.__setattr__(self, "sample_time", positive(self.sample_time, "sample_time"))
        basis = self.system.basis
        later = basis.levels >= np.arange(1, 1 + basis.directions)[:, None]
        if np.any(later & (self.free_directions | (self.directions != 0.0))):
            raise ModelError("a direction weighs a term that holds it or a later one; these weights are 0 and not free")
        set_covariance(self, self.system.theta.size)

    def _take_signals(self, counts: Mapping[str, int]) -> None:
        """Complete and check the descriptions of inputs and outputs."""
        for side, count in counts.items():
            names = (side,) if count == 1 else tuple(numbered(side, count))
            filled = {"names": names, "units": ("",) * count}
            for key, default in filled.items():
                object.__setattr__(self, f"{side}_{key}", texts(getattr(self, f"{side}_{key}")) or default)
            for key, value in (("origin", 0.0), ("scale", 1.0)):
                given = np.atleast_1d(real_numbers(getattr(self, f"{side}_{key}"), f"{side}_{key}"))
                values = given if given.size else np.full(count, value)
                object.__setattr__(self, f"{side}_{key}", read_only(values))
            held = [getattr(self, f"{side}_{key}") for key in ("names", "units", "origin", "scale")]
            if (
                any(np.shape(one) != (count,) for one in held)
                or not np.all(np.isfinite(held[2:]))
                or not np.all(held[3] > 0)
            ):
                raise ModelError(
                    f"{count} {side}s need as many names, units, finite origins, and finite scales above 0"
                )
        set_signals(self)
        noise = np.atleast_1d(real_numbers(self.noise_variance, "noise_variance"))
        noise = noise if noise.size else np.zeros(counts["output"])
        if noise.shape != (counts["output"],) or not np.all((noise >= 0.0) & np.isfinite(noise)):
            raise ModelError(
                f"noise_variance = {noise}; each of the {counts['output']} outputs needs one of at least 0"
            )
        object.__setattr__(self, "noise_variance", read_only(noise))

    @cached_property
    def system(self) -> System:
        """Weights in the form that the simulation needs."""
        n = len(self.transition)
        basis = Basis(n, self.directions.shape[1] - 1 - n - len(self.terms), len(self.directions), self.terms)
        return System(basis=basis, **weights_of(self))

    @property
    def theta(self) -> Array:
        """Free weights of P, W and V, row by row, shape (n_theta,)."""
        return self.system.theta

    @property
    def n_states(self) -> int:
        """Number of states."""
        return len(self.transition)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles of the linear part: eigenvalues of the states' weights in W.

        These are the poles for small signals unless a term is linear near zero, such as tanh(x1,1).
        """
        return np.linalg.eigvals(self.system.linear_parts[0]).astype(np.complex128)

    def __str__(self) -> str:
        labels = self.system.basis.labels
        names = (
            [f"{name}(k)" for name in numbered("s", len(self.directions))],
            [f"{name}(k+1)" for name in numbered("x", self.n_states)],
            ["y(k)"] if len(self.output) == 1 else [f"{name}(k)" for name in numbered("y", len(self.output))],
        )
        lines = []
        for rows, weights in zip(names, (getattr(self, name) for name in WEIGHTS), strict=True):
            for name, row in zip(rows, weights, strict=True):
                parts = [f"{value:.4g} {label}" for value, label in zip(row, labels, strict=False) if value]
                lines.append(f"{name} = " + (" + ".join(parts).replace("+ -", "- ") or "0"))
        return "\n".join(lines)

    def simulate(
        self, recording: Recording | ArrayLike, *, warmup: int | None = None, initial: ArrayLike | None = None
    ) -> NarxResponse:
        """Simulate the outputs from the inputs alone (free run).

        Parameters
        ----------
        recording : Recording, or array_like of shape (n,) or (n_inputs, n)
            Inputs in the model's units. If ``initial`` is not given, the first outputs of a recording determine the
            initial state.
        warmup : int, optional
            Number of samples whose outputs determine the initial state, at least 1. The response is computed from the
            next sample on. Defaults to ten samples for each state, but at most a third of the recording.
        initial : array_like, shape (n_states,), optional
            Initial state. If it is not given and there are no recorded outputs, the run starts from zero.

        Returns
        -------
        NarxResponse
            Response with ``.outputs`` of shape (n_outputs, n). If the run diverges, ``.status`` says so, and the
            outputs keep their last value, or the origin if the run diverges at its first sample.

        Raises
        ------
        ModelError
            If shapes are inconsistent, or the recording does not suit the model.
        """
        return self._run(*self._begun(recording, warmup, initial))

    def _run(self, drive: Drive, start: Opening) -> NarxResponse:
        outputs, _, reached = self.system.run(self._scaled(drive.inputs, "input"), start.state, limit=DIVERGED)
        values = outputs.T * self.output_scale[:, None] + self.output_origin[:, None]
        values[:, : drive.first] = drive.outputs[:, : drive.first]
        if reached >= values.shape[1]:
            return response_over(drive, values, drive.first, self.output_units)
        last = max(reached, drive.first)
        values[:, last:] = values[:, [last - 1]] if last else self.output_origin[:, None]
        when = float(drive.timepts[reached])
        return response_over(drive, values, drive.first, self.output_units, ResponseStatus.DIVERGED, when)

    def predict(self, recording: Recording, *, steps: int = 1) -> NarxResponse:
        """Return the free run over a `recording` for any `steps`, because the noise is on the readings."""
        whole_number(steps, "steps", most=recording.n_samples - 1)
        return self.simulate(recording)

    def free_run_band(self, recording: Recording, *, warmup: int | None = None, level: float = 0.95) -> PredictiveBand:
        """Return the predictive band of new readings in free run over a `recording`, with the probability `level`.

        The band includes the noise of the readings and, to first order, the uncertainty of the weights and of the
        initial state, which the first `warmup` samples determine as in `simulate`. It is valid if the free-run errors of
        the fit are white. ModelError if the recording does not suit the model, or the run diverges.
        """
        require_suits(recording, self, with_outputs=True, fewest=2)
        half = quantile(level, math.inf)
        drive, start = self._begun(recording, warmup, None)
        response = self._run(drive, start)
        if not response.status.ok:
            raise ModelError(f"the free run diverged at {response.failed_at_s:.6g} s: there is no band")
        gradient = self.system.sensitivities(self._scaled(recording.inputs, "input"), start.state)[1]
        n = self.theta.size
        weights = gradient[:, :, :n] + gradient[:, :, n:] @ start.by_theta
        variance = np.einsum("kpi,ij,kpj->pk", weights, self.theta_cov, weights, optimize=True)
        variance += np.einsum("kpi,ij,kpj->pk", gradient[:, :, n:], start.covariance, gradient[:, :, n:])
        total = variance * self.output_scale[:, None] ** 2 + self.noise_variance[:, None]
        wide = half * np.sqrt(np.maximum(total, 0.0))
        wide[:, : response.first] = 0.0
        return PredictiveBand(
            outputs=response.outputs,
            lower=read_only(response.outputs - wide),
            upper=read_only(response.outputs + wide),
            level=level,
            measured=recording.outputs,
            timepts=recording.timepts,
            first=response.first,
            units=self.output_units,
        )

    def _scaled(self, signals: Array, side: str) -> Array:
        origin, scale = getattr(self, f"{side}_origin"), getattr(self, f"{side}_scale")
        return np.asarray((signals - origin[:, None]) / scale[:, None])

    def _begun(
        self, given: Recording | ArrayLike, warmup: int | None, initial: ArrayLike | None
    ) -> tuple[Drive, Opening]:
        """Return inputs and initial state of a run."""
        n = self.n_states
        if isinstance(given, Recording) and initial is None and given.output_names:
            require_suits(given, self, with_outputs=True, fewest=2)
            wanted = min(_WARMUP_PER_STATE * n, max(given.n_samples // 3, 1)) if warmup is None else warmup
            wanted = whole_number(wanted, "warmup", most=given.n_samples - 1)
            first = slice(0, wanted)
            noise = np.sqrt(self.noise_variance) / self.output_scale
            inputs, outputs = (
                self._scaled(given.inputs[:, first], "input"),
                self._scaled(given.outputs[:, first], "output"),
            )
            return Drive.recorded(given, wanted), opened(self.system, inputs, outputs, noise)
        if warmup is not None:
            raise ModelError("warmup counts recorded outputs, and none are used here: give initial alone")
        if isinstance(given, Recording):
            require_suits(given, self, with_outputs=False, fewest=1)
        known = np.zeros(n) if initial is None else real_numbers(initial, "initial")
        if known.shape != (n,) or not np.all(np.isfinite(known)):
            raise ModelError(f"initial has the shape {known.shape}; it must be a finite state of shape ({n},)")
        drive = Drive.of(
            given,
            None,
            input_names=self.input_names,
            n_outputs=len(self.output_names),
            sample_time=self.sample_time,
            first=0,
            fewest=0,
        )
        return drive, Opening.known(known, self.theta.size)


def _truths(given: ArrayLike, name: str) -> NDArray[np.bool_]:
    """Return truth values as a new array, after a check."""
    try:
        return np.array(given, dtype=bool)
    except ValueError:
        raise ModelError(f"{name} must be truth values, with rows of the same length") from None
