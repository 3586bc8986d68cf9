"""Prediction errors of a linear model, their exact gradient by filtering, and the search for the least of them.

With n = A y - sum_i w_i - offset and w_i = (B_i/F_i) u_i, e = (D/C) n (Ljung, 1999, section 10.3). Inputs before the
record act on w_i as nf_i pulses at its start; e is zero before the first error, and D acts on measured n only.

The search starts from a long ARX model, which is consistent for any noise. Linear least squares put its noise (Hannan,
Rissanen, Biometrika 69 (1982) 81-94) and its plant (Steiglitz, McBride, IEEE Trans. Automat. Contr. 10 (1965) 461-464)
into few coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.narx.estimate import converged
from deatwin.ident.narx.linear.polynomials import ONE, Orders, Polynomials, is_stable, reflected
from deatwin.plant.arrays import Array

Record = tuple[Array, Array]  # Scaled inputs, (n_inputs, n), and output, (n,)


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Prediction errors of one record and their gradients."""

    errors: Array  # shape (n,): One-step prediction errors from sample ``first + nd`` of the record on
    theta_gradient: Array  # shape (n_theta, n): Derivative of the errors with respect to the parameters
    start_gradient: Array  # shape (sum of nf, n): Derivative of the errors with respect to the state at the start


def prediction_errors(
    orders: Orders, polynomials: Polynomials, inputs: Array, output: Array, start: Array
) -> PredictionErrors:
    """Prediction errors of a record and their gradient. Shapes: `inputs` (n_inputs, n); `output` (n,)."""
    p, nd = polynomials, orders.nd

    def whitened(rows: Array) -> Array:
        n = rows.shape[-1]
        moved = (p.d[k] * rows[..., nd - k : n - k] for k in range(nd + 1))
        return recursed(p.c, np.asarray(sum(moved)))

    past = lagged(output, range(orders.na + 1), orders.first)
    noise = p.a @ past - p.offset
    taps, pulses = [], []
    by_f: list[Array] = []
    for i, (u, f, pulse) in enumerate(zip(inputs, p.f, np.split(start, np.cumsum(orders.nf)[:-1]), strict=True)):
        delay, nb, nf = orders.nk[i], orders.nb[i], orders.nf[i]
        rows = lagged(u, range(delay, delay + nb), orders.first)
        drive = p.b[i][delay:] @ rows
        drive[:nf] += pulse
        w = recursed(f, drive)
        noise -= w
        taps.append(-whitened(recursed(f, rows)))
        by_f.append(whitened(recursed(f, _delayed(w, range(1, nf + 1)))))
        pulses.append(-whitened(recursed(f, np.eye(nf, drive.size))))
    errors = whitened(noise)
    parts = [
        whitened(past[1:]),
        *taps,
        *by_f,
        -recursed(p.c, _delayed(errors, range(1, orders.nc + 1))),
        recursed(p.c, np.array([noise[nd - k : noise.size - k] for k in range(1, nd + 1)]).reshape(nd, errors.size)),
        *([-whitened(np.ones((1, noise.size)))] if orders.offset else []),
    ]
    return PredictionErrors(errors, np.concatenate(parts), np.concatenate(pulses))


def lagged(signal: Array, lags: Sequence[int], first: int) -> Array:
    """Return a signal (n,) at several lags from a sample on, (n_lags, n - first)."""
    n = signal.size
    return np.array([signal[first - lag : n - lag] for lag in lags]).reshape(len(lags), n - first)


def filtered(numerator: ArrayLike, denominator: ArrayLike, rows: Array) -> Array:
    """Filter rows (..., n) from rest."""
    from scipy.signal import lfilter

    return np.asarray(lfilter(numerator, denominator, rows), dtype=np.float64)


def recursed(denominator: Array, rows: Array) -> Array:
    """Filter rows (..., n) by 1/denominator from rest. Shapes: `denominator` (order + 1,)."""
    return rows if denominator.size == 1 or rows.size == 0 else filtered([1.0], denominator, rows)


def _delayed(signal: Array, lags: Sequence[int]) -> Array:
    """Return a signal at several lags, zero before its start, shape (n_lags, n)."""
    rows = np.zeros((len(lags), signal.size))
    for row, lag in zip(rows, lags, strict=True):
        row[lag:] = signal[: signal.size - lag]
    return rows


@dataclass(frozen=True, eq=False)
class Minimum:
    """Result of a search."""

    theta: Array  # shape (n_theta,): Parameters
    theta_cov: Array
    noise_variance: float  # sigma^2: sum of squares divided by the number of errors minus unknowns
    complete: bool  # False after an interrupt
    converged: bool = True  # True if the gradient is small


class PredictionErrorLoss:
    """Prediction errors as a function of theta and initial states; infinite if C or an F is unstable."""

    def __init__(self, orders: Orders, records: Sequence[Record]) -> None:
        self.orders = orders
        self.records = records
        self.n_start = sum(orders.nf)
        self.n_errors = sum(output.size - orders.first - orders.nd for _, output in records)
        self.best: tuple[float, Array] = np.inf, np.empty(0)
        self._last: tuple[Array, list[PredictionErrors]] = np.empty(0), []

    @property
    def n_unknowns(self) -> int:
        """Number of parameters plus initial states."""
        return self.orders.n_theta + len(self.records) * self.n_start

    def _each(self, unknowns: Array) -> list[PredictionErrors]:
        """Return errors and gradients of each record, cached for the last point."""
        if not np.array_equal(self._last[0], unknowns):
            theta, starts = np.split(unknowns, [self.orders.n_theta])
            p = self.orders.split(theta)
            each = zip(self.records, starts.reshape(len(self.records), self.n_start), strict=True)
            self._last = unknowns.copy(), [prediction_errors(self.orders, p, *r, start) for r, start in each]
        return self._last[1]

    def errors(self, unknowns: Array) -> Array:
        """Return all errors, (n_errors,), and keep the unknowns (n_unknowns,) if they are the best so far."""
        p = self.orders.split(unknowns[: self.orders.n_theta])
        if not all(is_stable(polynomial) for polynomial in (p.c, *p.f)):
            return np.full(self.n_errors, np.inf)
        errors = np.concatenate([one.errors for one in self._each(unknowns)])
        loss = float(errors @ errors)
        if loss < self.best[0]:
            self.best = loss, unknowns.copy()
        return errors

    def gradient(self, unknowns: Array) -> Array:
        """Return the derivative of the errors, shape (n_errors, n_unknowns). Shapes: `unknowns` (n_unknowns,)."""
        from scipy.linalg import block_diag

        each = self._each(unknowns)
        theta = np.concatenate([one.theta_gradient for one in each], axis=1)
        return np.asarray(np.concatenate([theta, block_diag(*(one.start_gradient for one in each))]).T)

    def started(self, polynomials: Polynomials) -> Array:
        """Return the unknowns for given polynomials, with the best initial states for them."""
        zero = np.zeros(self.n_start)
        starts = []
        for record in self.records:
            one = prediction_errors(self.orders, polynomials, *record, zero)
            starts.append(-np.linalg.lstsq(one.start_gradient.T, one.errors, rcond=None)[0])
        return np.concatenate([self.orders.join(polynomials), *starts])


def minimise(loss: PredictionErrorLoss, start: Polynomials) -> Minimum:
    """Search from one start."""
    from scipy.optimize import least_squares

    unknowns, complete = loss.started(start), True
    loss.best = float(np.sum(loss.errors(unknowns) ** 2)), unknowns
    try:
        least_squares(
            loss.errors, unknowns, loss.gradient, x_scale="jac", ftol=1e-12, xtol=1e-10, gtol=1e-12, max_nfev=200
        )
    except KeyboardInterrupt:
        complete = False
    square, unknowns = loss.best
    variance = square / (loss.n_errors - loss.n_unknowns)
    slopes, errors = loss.gradient(unknowns), loss.errors(unknowns)
    root = _inverse_root(slopes)
    n = loss.orders.n_theta
    size = float(np.sqrt(sum(output @ output for _, output in loss.records)))
    ended = converged(slopes, errors, errors.size, size)
    return Minimum(unknowns[:n], variance * (root @ root.T)[:n, :n], variance, complete, ended)


def _inverse_root(gradient: Array) -> Array:
    """Return W with W W' = (J'J)^-1; directions that the data do not determine get a very large variance."""
    norms = np.linalg.norm(gradient, axis=0)
    norms[norms == 0.0] = 1.0
    _, singular, right = np.linalg.svd(np.linalg.qr(gradient / norms, mode="r"))
    smallest = np.finfo(float).eps * gradient.shape[1] * max(float(singular[0]), np.finfo(float).tiny)
    return np.asarray(right.T / np.maximum(singular, smallest) / norms[:, None], dtype=np.float64)


_ROUNDS = 20  # Most rounds of the iteration by Steiglitz and McBride
_SETTLED = 1e-6  # Change of a coefficient of F below which these rounds end: the search that follows moves it by more


def starting_points(orders: Orders, records: Sequence[Record]) -> list[Polynomials]:
    """Return polynomials from which the search can start, with stable C and F."""
    long = _arx(records, _lengthened(orders, _long(orders, records)))
    if not any(orders.nf) and orders.nd == 0:
        return [_extended(orders, records, _errors(long, records)), _simple(orders, records)]
    plants = [_from_arx(orders, records), _condensed(orders, records, long)]
    return [_with_noise(orders, records, plant) for plant in plants]


def _long(orders: Orders, records: Sequence[Record]) -> int:
    """Return the order of the long ARX model: several times the desired order, as far as the samples allow."""
    wanted = max(10, 3 * (orders.na + max(orders.nf, default=0) + orders.nc + orders.nd))
    lengths = [output.size for _, output in records]
    room = min(min(lengths) // 3 - max(orders.nk, default=0), sum(lengths) // (4 + 4 * len(orders.nb)))
    return max(1, min(wanted, room))


def _lengthened(orders: Orders, order: int) -> Orders:
    """Return orders of an ARX model in which A and each B have at least a given order."""
    long = tuple(max(order, nb) for nb in orders.nb)
    return replace(orders, na=order, nb=long, nc=0, nd=0, nf=(0,) * len(long))


def _solve(blocks: Sequence[Sequence[Array]], targets: Sequence[Array]) -> Array:
    """Solve least squares over several records, each a list of blocks of rows; collinear rows share their effect."""
    rows = np.concatenate([np.concatenate(block) for block in blocks], axis=1)
    return np.asarray(np.linalg.lstsq(rows.T, np.concatenate(targets), rcond=None)[0])


def _rows(orders: Orders, record: Record, first: int) -> list[Array]:
    """Return regressors of A and of each B from a sample on."""
    inputs, output = record
    taps = [lagged(u, range(nk, nk + nb), first) for u, nk, nb in zip(inputs, orders.nk, orders.nb, strict=True)]
    return [-lagged(output, range(1, orders.na + 1), first), *taps]


def _ones(orders: Orders, record: Record, first: int) -> Array:
    return np.ones((int(orders.offset), record[1].size - first))


def _arx(records: Sequence[Record], orders: Orders) -> Polynomials:
    """Fit an ARX model of given orders."""
    first = orders.first
    blocks = [[*_rows(orders, r, first), _ones(orders, r, first)] for r in records]
    return orders.split(_solve(blocks, [output[first:] for _, output in records]))


def _errors(arx: Polynomials, records: Sequence[Record]) -> list[Array]:
    """Return the errors of an ARX model, zero where its lags are not measured."""
    first = max([arx.a.size, *(b.size for b in arx.b)]) - 1
    errors = []
    for inputs, output in records:
        e = filtered(arx.a, ONE, output) - arx.offset
        for u, b in zip(inputs, arx.b, strict=True):
            e -= filtered(b, ONE, u)
        e[:first] = 0.0
        errors.append(e)
    return errors


def _extended(orders: Orders, records: Sequence[Record], errors: list[Array]) -> Polynomials:
    """Fit an ARMAX model; the errors of the long model serve as lagged noise in C."""
    first = max(orders.first, orders.nc)
    blocks = [
        [*_rows(orders, r, first), lagged(e, range(1, orders.nc + 1), first), _ones(orders, r, first)]
        for r, e in zip(records, errors, strict=True)
    ]
    found = orders.split(_solve(blocks, [output[first:] for _, output in records]))
    return found._replace(c=reflected(found.c))


def _simple(orders: Orders, records: Sequence[Record]) -> Polynomials:
    """Fit an ARMAX model with C = 1."""
    arx = _arx(records, replace(orders, nc=0, nd=0))
    return arx._replace(c=np.eye(1, orders.nc + 1)[0], d=np.eye(1, orders.nd + 1)[0])


def _from_arx(orders: Orders, records: Sequence[Record]) -> Polynomials:
    """Make an output-error model from an ARX model: each F is its A, made stable."""
    arx = _arx(records, replace(_lengthened(orders, max(orders.nf)), nb=orders.nb))
    a = reflected(arx.a)
    f = tuple(reflected(a[: nf + 1]) for nf in orders.nf)
    return arx._replace(a=ONE, f=f, offset=arx.offset / float(a.sum()))


def _condensed(orders: Orders, records: Sequence[Record], long: Polynomials) -> Polynomials:
    """Make an output-error model from the long ARX model: its response to each input, with few coefficients."""
    a = reflected(long.a)
    plants = []
    for i, taps in enumerate(long.b):
        pairs = [(inputs[i : i + 1], filtered(taps, a, inputs[i])) for inputs, _ in records]
        plants.append(_steiglitz_mcbride(pairs, orders.nb[i], orders.nf[i], orders.nk[i]))
    b, f = zip(*plants, strict=True)
    return Polynomials(a=ONE, b=b, c=ONE, d=ONE, f=f, offset=long.offset / float(a.sum()))


def _steiglitz_mcbride(pairs: list[Record], nb: int, nf: int, nk: int) -> tuple[Array, Array]:
    """Return b and f of the iteration whose free run is nearest to the outputs, for one input."""
    orders = Orders(na=nf, nb=(nb,), nc=0, nd=0, nf=(0,), nk=(nk,), offset=False)
    f = np.eye(1, nf + 1)[0]
    best, found = np.inf, (np.zeros(nk + nb), f)
    for _ in range(_ROUNDS if nf else 1):
        arx = _arx([(filtered(ONE, f, u), filtered(ONE, f, y)) for u, y in pairs], orders)
        former, b, f = f, arx.b[0], reflected(arx.a)
        loss = sum(float(np.sum((y - filtered(b, f, u[0])) ** 2)) for u, y in pairs)
        if loss < best:
            best, found = loss, (b, f)
        if np.abs(f - former).max() < _SETTLED:
            break
    return found


def _with_noise(orders: Orders, records: Sequence[Record], plant: Polynomials) -> Polynomials:
    """Fit C and D to the residual of the plant."""
    if orders.nc + orders.nd == 0:
        return plant
    noise: list[Record] = []
    for inputs, output in records:
        w = sum(filtered(b, f, u) for u, b, f in zip(inputs, plant.b, plant.f, strict=True))
        noise.append((np.empty((0, output.size)), output - w - plant.offset))
    alone = Orders(na=orders.nd, nb=(), nc=orders.nc, nd=0, nf=(), nk=(), offset=False)
    long = _arx(noise, _lengthened(alone, _long(alone, noise)))
    arma = _extended(alone, noise, _errors(long, noise))
    return plant._replace(c=arma.c, d=reflected(arma.a))
