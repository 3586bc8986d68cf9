r"""Whitening of a stationary process in white noise, by its innovations.

With the state x of the process, one component for each time constant, :math:`a = \exp(-\Delta t/\tau)`:

.. math:: v = y - \mathbf{1}^T x, \quad S = \mathbf{1}^T P \mathbf{1} + 1, \quad x^+ = a (x + P \mathbf{1}\, v / S)

for each row of readings alike. A recording starts with x = 0 and the stationary P; a gap is a longer Δt. Where Δt stays
the same the gains settle, and the rest is one linear filter. Only the ratio ρ = κ/σ counts: unit noise is taken here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from deatwin.ident.mismatch.likelihood.model import Process
from deatwin.ident.mismatch.thresholds import ACCURACY

SETTLED = 1e-12
"""Largest change of P still to come that counts as settled, as a share of the innovation's variance: over 21,000
samples it amounts to 1e-8 nats."""
ROUNDING = 16.0 * float(np.finfo(float).eps)
"""Additional tolerance for each unit of ρ²: rounding errors of P grow with the variance of the process."""
DIGITS = ".8g"
"""Digits to which equal steps agree."""
PIECE = 1000
"""Number of samples in a block while the gains have not settled."""
DOUBLINGS = 60
"""Largest number of doublings of the time over which P settles; nobody records more than 2^60 samples."""


@dataclass(frozen=True, eq=False)
class Filter:
    """State space of the process for several ratios at once: diagonals a and stationary variances, (k, p)."""

    ratios: np.ndarray
    process: Process
    _settled: dict[str, tuple[float, np.ndarray]] = field(default_factory=dict, init=False, repr=False)

    @property
    def variances(self) -> np.ndarray:
        """Stationary variance of each component, shape (k, p)."""
        return np.multiply.outer(self.ratios**2, np.array(self.process.weights))

    def decay(self, step: float) -> np.ndarray:
        """exp(-Δt/τ), shape (p,)."""
        return np.exp(-step / np.array(self.process.times))

    def start(self) -> np.ndarray:
        """Return P before the first sample of a recording, shape (k, p, p)."""
        return self.variances[:, :, None] * np.eye(len(self.process.weights))

    def gain(self, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gains (k, p) and innovation variances (k,) for a given P."""
        row = cov.sum(axis=2)
        innovation = row.sum(axis=1) + 1.0
        return row / innovation[:, None], innovation

    def for_step(self, step: float) -> tuple[float, np.ndarray]:
        """Return the first step met that equals this one, but for rounding, and its stationary P."""
        # Missing samples make thousands of stretches of a few different steps.
        name = f"{step:{DIGITS}}"
        if name not in self._settled:
            self._settled[name] = step, self.settled(step)
        return self._settled[name]

    def allowed(self, final: np.ndarray) -> np.ndarray:
        """Return the sum of changes of P, (k,), that is negligible relative to the innovation's variance."""
        return np.asarray((SETTLED + ROUNDING * self.ratios**2) * self.gain(final)[1])

    def settled(self, step: float) -> np.ndarray:
        """Return the stationary P, by doubling (Anderson 1978, doi:10.1016/0005-1098(78)90088-3), shape (k, p, p)."""
        decay, k = self.decay(step), self.ratios.size
        unit = np.eye(decay.size)
        move = np.broadcast_to(np.diag(decay), (k, *unit.shape))
        seen = np.ones((k, *unit.shape))
        cov = (self.variances * (1.0 - decay**2))[:, :, None] * unit
        for _ in range(DOUBLINGS):
            middle, turned = np.linalg.inv(unit + cov @ seen), np.swapaxes(move, 1, 2)
            more = move @ middle @ cov @ turned
            seen = seen + turned @ seen @ middle @ move
            move, cov = move @ middle @ move, cov + more
            if np.abs(more).max() <= np.finfo(float).eps * np.abs(cov).max():
                break
        return (cov + np.swapaxes(cov, 1, 2)) / 2.0


@dataclass(frozen=True, eq=False)
class Block:
    """Innovations of some samples for some ratios, (k, m, n), with their variances, (k, n)."""

    samples: slice
    ratios: slice
    values: np.ndarray
    variances: np.ndarray

    @property
    def whitened(self) -> np.ndarray:
        """Innovations divided by their standard deviations."""
        return self.values / np.sqrt(self.variances)[:, None, :]


def blocks(
    process: Process, ratios: np.ndarray, clock: tuple[np.ndarray, np.ndarray], rows: np.ndarray
) -> Iterator[Block]:
    """Yield the innovations of rows (m, n) in blocks; times and recording numbers are (n,) each."""
    times, records = clock
    ends, of = [*(1 + np.flatnonzero(np.diff(records))), times.size], Filter(ratios, process)
    for first, last in zip([0, *ends[:-1]], ends, strict=True):
        yield from _recording(of, times[first:last], rows[:, first:last], first)


def grams(
    process: Process, ratios: np.ndarray, clock: tuple[np.ndarray, np.ndarray], rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return products of the whitened rows with each other, (k, m, m), and sums of the log variances, (k,)."""
    products, logs = np.zeros((ratios.size, len(rows), len(rows))), np.zeros(ratios.size)
    for block in blocks(process, ratios, clock, rows):
        # a product of a matrix with its own transpose: half the work
        products[block.ratios] += [w @ w.T for w in block.whitened]
        logs[block.ratios] += np.log(block.variances).sum(axis=1)
    return products, logs


def whitened(process: Process, ratio: float, clock: tuple[np.ndarray, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Return the rows (m, n), whitened for unit noise and one ratio."""
    result = np.empty_like(rows)
    for block in blocks(process, np.array([ratio]), clock, rows):
        result[:, block.samples] = block.whitened[0]
    return result


def _recording(of: Filter, times: np.ndarray, rows: np.ndarray, first: int) -> Iterator[Block]:
    """Filter stretches of equal time steps: sample by sample until the gains have settled, then by a linear filter."""
    steps = np.diff(times, append=2.0 * times[-1] - times[-2] if times.size > 1 else times[-1] + 1.0)
    # Times of day in double precision differ by 1e-9 of a step.
    changes = 1 + np.flatnonzero(np.abs(np.diff(steps)) > ACCURACY * steps[:-1])
    cov, state, at = of.start(), np.zeros((of.ratios.size, len(rows), len(of.process.times))), 0
    for end in (*changes, times.size):
        step, final = of.for_step(float(steps[at]))
        while at < end:
            if _is_settled(cov, final, of.allowed(final)):
                yield from _steady(of, final, step, state, rows[:, at:end], first + at)
                cov, at = final, end
                continue
            stop = min(end, at + PIECE)
            block, cov = _varying(of, cov, final, step, state, rows[:, at:stop], first + at)
            at += block.values.shape[2]
            yield block


def _is_settled(cov: np.ndarray, final: np.ndarray, allowed: np.ndarray) -> bool:
    """Return whether P has become stationary; `allowed` (k,) is the largest sum of changes still to come."""
    return bool((np.abs(cov - final).sum(axis=(1, 2)) <= allowed).all())


def _varying(
    of: Filter, cov: np.ndarray, final: np.ndarray, step: float, state: np.ndarray, rows: np.ndarray, first: int
) -> tuple[Block, np.ndarray]:
    """Filter sample by sample until the gains have settled; `state` (k, m, p) is advanced."""
    decay, allowed, values, variances = of.decay(step), of.allowed(final), [], []
    shrink, grown = np.outer(decay, decay), (of.variances * (1.0 - decay**2))[:, :, None] * np.eye(decay.size)
    for row in rows.T:
        gain, innovation = of.gain(cov)
        values.append(row - state.sum(axis=2))
        variances.append(innovation)
        state += values[-1][:, :, None] * gain[:, None, :]
        state *= decay
        cov = (cov - gain[:, :, None] * gain[:, None, :] * innovation[:, None, None]) * shrink + grown
        if _is_settled(cov, final, allowed):
            break
    samples = slice(first, first + len(values))
    return Block(samples, slice(0, of.ratios.size), np.stack(values, axis=2), np.stack(variances, axis=1)), cov


def _steady(
    of: Filter, cov: np.ndarray, step: float, state: np.ndarray, rows: np.ndarray, first: int
) -> Iterator[Block]:
    """Apply one linear filter per ratio, of the process' order; `state` (k, m, p) is advanced."""
    from scipy.signal import lfilter

    decay, (gains, variances), n = of.decay(step), of.gain(cov), rows.shape[1]
    order, ahead = decay.size, decay ** np.arange(n, 0, -1)[:, None]
    for k, gain in enumerate(gains):
        closed = decay[:, None] * (
            np.eye(order) - gain[:, None]
        )  # transition of the state, including the correction by its reading
        poles, zeros = np.poly(closed), np.poly(decay)
        free = np.array([-np.linalg.matrix_power(closed, i).sum(axis=0) for i in range(order)])
        begin = np.stack([np.convolve(poles, row)[:order] for row in state[k] @ free.T])
        values = lfilter(zeros, poles, rows, zi=begin)[0]
        state[k] = state[k] * decay**n + (values @ ahead) * gain
        yield Block(slice(first, first + n), slice(k, k + 1), values[None], np.full((1, n), variances[k]))
