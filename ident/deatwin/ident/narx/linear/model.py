"""The linear model: polynomials with their covariance; prediction, free run, poles, frequency response."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import positive, read_only, real_number, real_numbers
from deatwin.ident.narx.document import set_covariance, set_signals, signals_of
from deatwin.ident.narx.drive import require_suits, signals_like
from deatwin.ident.narx.linear.polynomials import Orders, Polynomials, is_stable
from deatwin.ident.narx.linear.prediction import lagged, prediction_errors, recursed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.response import DIVERGED, NarxResponse, ResponseStatus, response_over
from deatwin.ident.narx.terms import Term, Variable, channel_numbers
from deatwin.plant.arguments import each
from deatwin.plant.arrays import Array, texts
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, document, several, squared, variable
from deatwin.plant.documents import Saved
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

if TYPE_CHECKING:
    from control import TransferFunction


SCHEMA = "deatwin/linear/1"
_WARMUP_PER_STATE = 10  # samples of warm-up; noise on the state at the start falls with their square root


def _document(model: LinearModel) -> dict[str, Any]:
    """Return a model as plain data."""

    def signals(names: tuple[str, ...], units: tuple[str, ...]) -> list[dict[str, str]]:
        return [{"name": name, "unit": unit} for name, unit in zip(names, units, strict=True)]

    return {
        "schema": SCHEMA,
        "sample_time_s": float(model.sample_time),
        "inputs": signals(model.input_names, model.input_units),
        "outputs": signals(model.output_names, model.output_units),
        "a": model.a.tolist(),
        "b": [b.tolist() for b in model.b],
        "c": model.c.tolist(),
        "d": model.d.tolist(),
        "f": [f.tolist() for f in model.f],
        "offset": float(model.offset),
        "theta_cov": model.theta_cov.tolist(),
        "noise_variance": float(model.noise_variance),
        "provenance": dict(model.provenance),
    }


def fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the model from a document."""
    return {
        **{name: document[name] for name in ("a", "c", "d", "theta_cov")},
        **{name: tuple(document[name]) for name in ("b", "f")},
        "offset": float(document["offset"]),
        "noise_variance": float(document["noise_variance"]),
        **signals_of(document),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel(Described, Saved, schema=SCHEMA, document=_document, fields=fields_of):
    """Linear model with one output, A y(k) = sum_i (B_i/F_i) u_i(k) + (C/D) e(k) + offset.

    A, B_i, C, D and F_i are polynomials in the backward shift q^-1; e is white noise. An ARX model has C = D = F_i = 1,
    an ARMAX model D = F_i = 1, an output-error model A = C = D = 1, and a Box-Jenkins model A = 1.

    Parameters
    ----------
    a, c, d : array_like, shape (order + 1,)
        Coefficients of A, C and D for the powers q^0, q^-1, ...; the first is 1.
    b : sequence of array_like
        Coefficients of B_i for each input, in the output's unit per input unit. Leading zeros represent the delay.
    f : sequence of array_like, optional
        Coefficients of F_i for each input, of which the first is 1. By default all F_i are 1.
    offset : float
        Constant on the right side of the equation, in the output's unit.
    theta_cov : ndarray, shape (n_theta, n_theta), optional
        Covariance of the free coefficients (``theta``); zero if omitted. It is valid only if the residuals are white.
    noise_variance : float
        Variance of e(k), square of the output's unit.
    sample_time : float
        Sample time, s.
    input_names, output_names, input_units, output_units : tuple of str
        Names and units of the signals.
    provenance : mapping of str to str
        Notes on the origin of the model, such as the identifier and the recordings.

    Raises
    ------
    ModelError
        If the numbers of polynomials, names and units do not agree, `theta_cov` has the wrong shape, or a value is not
        allowed: A, C, D or F_i does not begin with 1, B_i is zero, `sample_time` is not positive, or a number is not
        finite.

    Examples
    --------
    >>> model = LinearModel(a=[1, -0.6], b=[[0, 0.3]], sample_time=1.0)
    >>> print(model.to_narx())
    y(k) = 0.6 y(k-1) + 0.3 u(k-1) + e(k)
    """

    a: Array
    b: tuple[Array, ...]
    sample_time: float = field(metadata=attribute())
    c: Array = field(default_factory=lambda: np.ones(1))
    d: Array = field(default_factory=lambda: np.ones(1))
    f: tuple[Array, ...] = ()
    offset: float = field(default=0.0, metadata=variable(unit=lambda model: model.output_units[0]))
    theta_cov: Array = field(
        default_factory=lambda: np.zeros((0, 0)), metadata=variable("coefficient", "other_coefficient")
    )
    noise_variance: float = field(default=0.0, metadata=variable(unit=lambda model: squared(model.output_units[0])))
    input_names: tuple[str, ...] = field(
        default=(), metadata=coordinate("input", name="input", of=lambda model: list(model.input_names))
    )
    output_names: tuple[str, ...] = ("output",)
    input_units: tuple[str, ...] = field(
        default=(), metadata=coordinate("input", name="input_unit", of=lambda model: list(model.input_units))
    )
    output_units: tuple[str, ...] = ("",)
    provenance: Mapping[str, str] = field(default_factory=dict)

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "polynomials_by_power": several(lambda model: model.polynomials.by_power()),
        "theta": variable("coefficient"),
        "output_name": attribute(of=lambda model: model.output_names[0]),
        "output_unit": attribute(of=lambda model: model.output_units[0]),
        "power": coordinate("power", of=lambda model: np.arange(model.polynomials.longest)),
        "document": document(_document),
    }

    def __post_init__(self) -> None:
        each(real_numbers)(self.b, "b")
        each(real_numbers)(self.f, "f")
        m = len(self.b)
        for name in ("a", "c", "d"):
            object.__setattr__(self, name, real_numbers(getattr(self, name), name))
        for name in ("offset", "noise_variance"):
            real_number(getattr(self, name), name)
        positive(self.sample_time, "sample_time")
        object.__setattr__(self, "b", tuple(read_only(b) for b in self.b))
        object.__setattr__(self, "f", tuple(read_only(f) for f in (self.f if len(self.f) else [[1.0]] * m)))
        names = ("input",) if m == 1 else tuple(f"input{i}" for i in range(1, m + 1))
        object.__setattr__(self, "input_names", texts(self.input_names) or names)
        object.__setattr__(self, "input_units", texts(self.input_units) or ("",) * m)
        if m == 0 or not len(self.f) == len(self.input_names) == len(self.input_units) == m:
            raise ModelError(
                f"{m} polynomials b need as many f, input names and units; got {len(self.f)}, "
                f"{len(self.input_names)} and {len(self.input_units)}"
            )
        set_signals(self)
        self.polynomials.require()
        set_covariance(self, self.theta.size)
        if not 0 <= self.noise_variance < math.inf:
            raise ModelError(f"noise_variance = {self.noise_variance}; it must be finite and not negative")

    @property
    def polynomials(self) -> Polynomials:
        """All coefficients of the model."""
        return Polynomials(self.a, self.b, self.c, self.d, self.f, self.offset)

    @cached_property
    def orders(self) -> Orders:
        """Orders and delays of the polynomials."""
        return Orders.of(self.polynomials)

    @property
    def theta(self) -> Array:
        """The free coefficients, shape (n_theta,), in the order a, b_1, b_2, ..., f_1, f_2, ..., c, d, offset."""
        return self.orders.join(self.polynomials)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles from the inputs to the output: the roots of A and of all F_i, shape (n_poles,)."""
        return np.concatenate([np.roots(p).astype(np.complex128) for p in (self.a, *self.f)])

    def __str__(self) -> str:
        rows = {"A": self.a, "C": self.c, "D": self.d}
        rows |= {f"B{i}": b for i, b in enumerate(self.b, start=1)}
        rows |= {f"F{i}": f for i, f in enumerate(self.f, start=1)}
        lines = [f"{name} = {_written(p)}" for name, p in sorted(rows.items()) if p.size > 1 or name[0] == "B"]
        return "\n".join([*lines, f"offset = {self.offset:.6g}"])

    def predict(self, recording: Recording) -> NarxResponse:
        """Predict each output sample of a `recording` from the measurements before it.

        The initial states of the 1/F_i are estimated from the first samples, which do not count as predicted: ten
        samples for each state, or a third of the recording if this is less. ``.outputs`` has the shape (1, n), and holds
        the measured values before ``.first``. ModelError if the recording does not suit the model, or a root of C or of
        an F_i is not inside the unit circle.
        """
        self._require(recording)
        if not all(is_stable(p) for p in (self.c, *self.f)):
            raise ModelError("a root of C or F lies on or outside of the unit circle: the predictor is unstable")
        output, states = recording.outputs[0], sum(self.orders.nf)
        found = prediction_errors(self.orders, self.polynomials, recording.inputs, output, np.zeros(states))
        warmup = self._warmup(recording, states)
        start = -np.linalg.lstsq(found.start_gradient[:, :warmup].T, found.errors[:warmup], rcond=None)[0]
        errors = (found.errors + start @ found.start_gradient)[warmup:]
        outputs = output.copy()
        outputs[output.size - errors.size :] -= errors
        return response_over(recording, outputs[None], output.size - errors.size, self.output_units)

    def simulate(self, recording: Recording, *, warmup: int | None = None) -> NarxResponse:
        """Simulate the output over a `recording` from its inputs and an initial state, without noise (free run).

        The state is fitted to the first `warmup` outputs by least squares; later ones are not used. By default, these
        are ten samples for each pole, or a third of the recording if this is less. With one sample for each pole, the run
        starts exactly from the measured outputs, including their noise, like the free run of a NARX model. ``.outputs`` of
        the response has the shape (1, n), and is computed from ``.first`` on; a run that diverges has the status
        ``DIVERGED``. ModelError if the recording does not suit the model, or `warmup` does not lie between the number of
        poles and that of samples.
        """
        self._require(recording)
        lag, poles, output = self.orders.input_lag, self.poles.size, recording.outputs[0]
        wanted = self._warmup(recording, poles) if warmup is None else warmup
        if not poles <= wanted <= recording.n_samples - lag - 1:
            raise ModelError(
                f"warmup = {wanted}; it must be at least the number of poles, {poles}, "
                f"and leave something of the recording's {recording.n_samples} samples"
            )
        first, outputs = lag + wanted, output.copy()
        outputs[first:] = _free_run(self.polynomials, lag, recording.inputs, output, wanted)
        bad = ~(np.abs(outputs) < DIVERGED * max(float(np.abs(output).max()), np.finfo(float).tiny))
        if not bad.any():
            return response_over(recording, outputs[None], first, self.output_units)
        failed = int(np.argmax(bad))
        outputs[failed:] = outputs[failed - 1]
        when = float(recording.timepts[failed])
        return response_over(recording, outputs[None], first, self.output_units, ResponseStatus.DIVERGED, when)

    def to_control(self) -> TransferFunction:
        """Return B_i/(A F_i) from each input to the output as a discrete system of python-control."""
        import control

        pairs = [(b, np.convolve(self.a, f)) for b, f in zip(self.b, self.f, strict=True)]
        size = max(polynomial.size for pair in pairs for polynomial in pair)
        padded = [[np.pad(p, (0, size - p.size)) for p in pair] for pair in pairs]
        return control.tf(
            [[num for num, _ in padded]],
            [[den for _, den in padded]],
            self.sample_time,
            inputs=list(self.input_names),
            outputs=list(self.output_names),
        )

    def to_narx(self) -> NarxModel:
        """Return an ARX or ARMAX model as a NARX or NARMAX model of degree 1; ModelError unless D and all F are 1."""
        if self.d.size > 1 or any(f.size > 1 for f in self.f):
            raise ModelError("only ARX and ARMAX models are NARX models: D and F must be 1")
        variables = [*lagged_signals(self.orders), *(Variable("e", 0, k) for k in range(1, self.c.size))]
        sign = np.r_[-np.ones(self.a.size - 1), np.ones(self.theta.size - self.a.size + 1)]
        terms = (*(Term.product([v]) for v in variables), Term(()))
        keep = np.arange(len(terms)) if self.offset or self.theta_cov[-1, -1] else np.arange(len(variables))
        return NarxModel(
            terms=tuple(terms[i] for i in keep),
            theta=(sign * self.theta)[keep],
            theta_cov=(np.outer(sign, sign) * self.theta_cov)[np.ix_(keep, keep)],
            noise_variance=self.noise_variance,
            **signals_like(self),
            provenance=self.provenance,
        )

    def _require(self, recording: Recording) -> None:
        """Raise ModelError unless a recording has the model's sample time and signals."""
        fewest = self.orders.first + self.orders.nd + self.poles.size + 1
        require_suits(recording, self, with_outputs=True, fewest=fewest)

    def _warmup(self, recording: Recording, states: int) -> int:
        return max(states, min(_WARMUP_PER_STATE * states, recording.n_samples // 3))


def lagged_signals(orders: Orders) -> list[Variable]:
    """Return the lagged output and inputs of an ARX model, in the order of its parameters."""
    variables = [Variable("y", 0, k) for k in range(1, orders.na + 1)]
    for channel, nb, nk in zip(channel_numbers(len(orders.nb)), orders.nb, orders.nk, strict=True):
        variables += [Variable("u", channel, k) for k in range(nk, nk + nb)]
    return variables


def _written(polynomial: Array) -> str:
    parts = [f"{value:.6g}" + (f" q^-{k}" if k else "") for k, value in enumerate(polynomial) if value or not k]
    return " + ".join(parts).replace("+ -", "- ")


def _free_run(p: Polynomials, lag: int, inputs: Array, output: Array, warmup: int) -> Array:
    """Simulate the deterministic part from a state fitted to the first `warmup` outputs after `lag`; returns the rest."""
    n = output.size - lag
    drive, free = np.full(n, p.offset), [recursed(p.a, np.eye(p.a.size - 1, n))]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable run overflows; detected by the caller
        for u, b, f in zip(inputs, p.b, p.f, strict=True):
            drive += recursed(f, b @ lagged(u, range(b.size), lag))
            free.append(recursed(np.convolve(p.a, f), np.eye(f.size - 1, n)))
        run, states = recursed(p.a, drive), np.concatenate(free)
        start = np.linalg.lstsq(states[:, :warmup].T, (output[lag:] - run)[:warmup], rcond=None)[0]
        return np.asarray((run + start @ states)[warmup:], dtype=np.float64)
