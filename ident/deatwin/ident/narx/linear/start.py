"""Start the search for the polynomials from a long ARX model, and then with the structure that is wanted.

A long ARX model is consistent for any noise. Linear least squares put its noise (Hannan, Rissanen, Biometrika 69 (1982)
81-94) and its plant (Steiglitz, McBride, IEEE Trans. Automat. Contr. 10 (1965) 461-464) into few coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.narx.linear.polynomials import Orders, Polynomials, reflected
from deatwin.ident.narx.linear.prediction import Record, filtered, lagged
from deatwin.plant.arrays import Array

_ONE = np.ones(1)
_ONE.setflags(write=False)
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
        e = filtered(arx.a, _ONE, output) - arx.offset
        for u, b in zip(inputs, arx.b, strict=True):
            e -= filtered(b, _ONE, u)
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
    return arx._replace(a=_ONE, f=f, offset=arx.offset / float(a.sum()))


def _condensed(orders: Orders, records: Sequence[Record], long: Polynomials) -> Polynomials:
    """Make an output-error model from the long ARX model: its response to each input, with few coefficients."""
    a = reflected(long.a)
    plants = []
    for i, taps in enumerate(long.b):
        pairs = [(inputs[i : i + 1], filtered(taps, a, inputs[i])) for inputs, _ in records]
        plants.append(_steiglitz_mcbride(pairs, orders.nb[i], orders.nf[i], orders.nk[i]))
    b, f = zip(*plants, strict=True)
    return Polynomials(a=_ONE, b=b, c=_ONE, d=_ONE, f=f, offset=long.offset / float(a.sum()))


def _steiglitz_mcbride(pairs: list[Record], nb: int, nf: int, nk: int) -> tuple[Array, Array]:
    """Return b and f of the iteration whose free run is nearest to the outputs, for one input."""
    orders = Orders(na=nf, nb=(nb,), nc=0, nd=0, nf=(0,), nk=(nk,), offset=False)
    f = np.eye(1, nf + 1)[0]
    best, found = np.inf, (np.zeros(nk + nb), f)
    for _ in range(_ROUNDS if nf else 1):
        arx = _arx([(filtered(_ONE, f, u), filtered(_ONE, f, y)) for u, y in pairs], orders)
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
