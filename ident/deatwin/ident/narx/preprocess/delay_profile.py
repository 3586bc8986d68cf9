"""Compute the probability of each dead time, from low-order models of whitened signals with each first input lag."""

from __future__ import annotations

import numpy as np

from deatwin.ident.narx.linear.polynomials import Orders, Polynomials
from deatwin.ident.narx.linear.prediction import PredictionErrorLoss, Record, filtered
from deatwin.ident.narx.linear.start import starting_points
from deatwin.ident.narx.long_arx import LongArx
from deatwin.plant.arrays import Array

_STRUCTURES = ((1, 1), (2, 1), (1, 2), (2, 2), (3, 2))
"""Numbers of coefficients of B and F: first and second order under a held input, with whole and fractional dead times.
With two poles, a single coefficient of B is needed too, or B = (0, b) one sample early is as probable as B = (b, 0)."""
_FAR = 60.0  # Decrease of 2 log likelihood beyond which a dead time is excluded: 1e-13 of the best one's probability
# Excluded dead times in a row after which only these two structures are tried, until one fits again, as it may with an
# input that repeats itself: the simplest, and two poles with a fractional dead time.
_PATIENCE, _PROBES = 5, (0, 3)
_POLES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99)
"""Poles to start from, two to three times apart, because ARX models of few frequencies can be far from every plant."""


def delay_probabilities(arx: LongArx, which: int, latest: int) -> Array:
    """Return the probabilities (latest + 1,) of dead times, all equally probable a priori, by exp(-BIC/2) of each
    structure (Kass, Wasserman, JASA 90 (1995) 928-934). Squares are measured in units of what the best plant leaves
    beyond the noise, per degree of freedom, as in quasi-likelihood."""
    records = _whitened(arx, which)
    squares = np.full((latest + 1, len(_STRUCTURES)), np.inf)
    n_errors, far = 1, 0
    former: list[Polynomials | None] = [None] * len(_STRUCTURES)
    for delay in range(latest, arx.shortest[which] - 1, -1):
        probing = far >= _PATIENCE
        for number, (nb, nf) in enumerate(_STRUCTURES):
            if probing and number not in _PROBES:
                former[number] = None
                continue
            orders = Orders(na=0, nb=(nb,), nc=0, nd=0, nf=(nf,), nk=(delay,), offset=True)
            cut = latest + 3 - (delay + nb)  # all structures then use the same samples of the output
            loss = PredictionErrorLoss(orders, [(inputs[:, cut:], output[cut:]) for inputs, output in records])
            simplest = former[0] if number else None
            squares[delay, number], former[number] = _least(loss, former[number], simplest)
            n_errors = loss.n_errors
        best, here = squares.min(), squares[delay].min()
        far = far + 1 if here - best > _FAR * arx.variance * _excess(best, n_errors, arx) else 0
    dispersion = arx.variance * _excess(float(squares.min()), n_errors, arx)
    unknowns = np.array([nb + nf for nb, nf in _STRUCTURES])
    evidence = -0.5 * (squares / dispersion + unknowns * np.log(n_errors))
    weights = np.exp(evidence - evidence.max()).sum(axis=1)
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def _excess(squares: float, n_errors: int, arx: LongArx) -> float:
    """Return the best low-order model's residual power beyond the long one, in noise variances."""
    freedom = max(arx.n_unknowns - 6, 1)
    return max(1.0, (squares / arx.variance - (n_errors - arx.n_unknowns)) / freedom)


def _least(
    loss: PredictionErrorLoss, former: Polynomials | None, simplest: Polynomials | None
) -> tuple[float, Polynomials]:
    """Return the smallest sum of squares from three starts: the next dead time, a simple model, and ARX."""
    from scipy.optimize import least_squares

    starts = starting_points(loss.orders, loss.records)[1:]
    if former is not None:
        starts.append(former._replace(b=(former.b[0][1:],)))
    nb, nf, delay = loss.orders.nb[0], loss.orders.nf[0], loss.orders.nk[0]
    if simplest is None:
        starts += [_with_pole(loss, pole) for pole in _POLES]
    else:
        b, f = simplest.b[0], simplest.f[0]
        starts.append(simplest._replace(b=(np.pad(b, (0, delay + nb - b.size)),), f=(np.pad(f, (0, nf + 1 - f.size)),)))
    unknowns = [loss.started(start) for start in starts]
    least = min(unknowns, key=lambda x: float(np.sum(loss.errors(x) ** 2)))
    loss.best = np.inf, least
    loss.errors(least)
    # A hundredth of the noise's variance is far more accurate than a probability needs.
    least_squares(loss.errors, least, loss.gradient, x_scale="jac", ftol=0.01 / loss.n_errors, max_nfev=20)
    square, found = loss.best
    return square, loss.orders.split(found[: loss.orders.n_theta])


def _with_pole(loss: PredictionErrorLoss, pole: float) -> Polynomials:
    """Return the first-order model with a given pole; gain and offset are found by least squares."""

    delay, f = loss.orders.nk[0], np.array([1.0, -pole])
    answer = np.concatenate([filtered([1.0], f, inputs[0])[: output.size - delay] for inputs, output in loss.records])
    target = np.concatenate([output[delay:] for _, output in loss.records])
    gain, offset = np.linalg.lstsq(np.column_stack([answer, np.ones(target.size)]), target, rcond=None)[0]
    one = np.ones(1)
    return Polynomials(a=one, b=(np.r_[np.zeros(delay), gain],), c=one, d=one, f=(f,), offset=float(offset))


def _whitened(arx: LongArx, which: int) -> list[Record]:
    """Return an input and the output, minus the contributions of other inputs, both filtered by A."""

    first = max(arx.n_output_lags, arx.longest if arx.b.shape[0] > 1 else 0)
    records: list[Record] = []
    for inputs, output in arx.signals:
        left = filtered(arx.a, [1.0], output)
        for row, b in enumerate(arx.b):
            if row != which:
                left = left - filtered(b, [1.0], inputs[row])
        records.append((filtered(arx.a, [1.0], inputs[which : which + 1])[:, first:], left[first:]))

    return records
