"""An order of the output as the sum over its frequency response, Y_n = sum of H_n U ... U."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain, combinations_with_replacement, islice
from math import factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.frequency.gfrf import HIGHEST_ORDER, gradient_at, require_one_input, values_at
from deatwin.ident.frequency.linear import whole_order
from deatwin.ident.frequency.response import FrequencyResponse, FrequencyStatus
from deatwin.ident.frequency.spectrum import excited_lines, line_frequencies, one_period, representable
from deatwin.ident.narx.model import NarxModel

Complex = NDArray[np.complex128]

_BLOCK = 1 << 16  # combinations at a time


def direct_output(
    model: NarxModel, excitation: ArrayLike, order: int, *, operating_input: ArrayLike | None = None
) -> FrequencyResponse:
    """Compute the n-th order of the output by summing over all combinations of input lines, which is slow.

    Y_n(k) = sum of H_n(w_k1, ..., w_kn) U(k1) ... U(kn) over all k1 + ... + kn = k, including lines of negative
    frequency; the sum is taken modulo the number of samples. Lang, Billings, Int. J. Control 64 (1996) 1049-1067.
    """
    order = whole_order(order, HIGHEST_ORDER)
    require_one_input(model, "output_orders")
    about = deviations(model, operating_input)
    period = one_period(excitation, model.sample_time)
    spectrum = np.fft.fft(period) / period.size
    lines = np.flatnonzero(excited_lines(spectrum))
    total = _Sum(spectrum=spectrum, lines=lines, order=order)
    return FrequencyResponse(
        symbol="Y",
        order=order,
        values=total.over(partial(values_at, about), ()),
        omega=line_frequencies(period.size, model.sample_time),
        point=about.point,
        status=FrequencyStatus.at(about.point),
        unit=model.output_units[0],
        theta_cov=model.theta_cov,
        theta_dof=model.theta_dof,
        differentiate=partial(_gradient, total, about),
    )


def _gradient(total: _Sum, about: Deviations) -> Complex:
    return total.over(partial(gradient_at, about), (about.jacobian.shape[1],))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sum:
    """The sum over all multisets of excited lines."""

    spectrum: Complex
    lines: NDArray[np.intp]  # Excited lines
    order: int  # Size of the multisets

    def over(self, response: Callable[[NDArray[np.float64]], Complex], shape: tuple[int, ...]) -> Complex:
        """Sum a response at angles (n, order), with values of shape (n, *shape), to lines up to half the rate."""
        n_samples = self.spectrum.size
        total = np.zeros((n_samples // 2 + 1, *shape), dtype=np.complex128)
        for lines in self._multisets():
            reached = lines.sum(axis=1) % n_samples
            wanted = reached < len(total)  # the others are the complex conjugates
            chosen = lines[wanted]
            values = response(2 * np.pi * chosen / n_samples)
            with np.errstate(over="ignore", invalid="ignore"):
                weight = _permutations(chosen) * self.spectrum[chosen].prod(axis=1)
                np.add.at(total, reached[wanted], (weight * values.T).T)
        return representable(total, f"order {self.order} of the output")

    def _multisets(self) -> Iterator[NDArray[np.intp]]:
        """Yield blocks of shape (n, order), each row in increasing order."""
        combinations = combinations_with_replacement(self.lines.tolist(), self.order)
        while rows := list(islice(combinations, _BLOCK)):
            yield np.fromiter(chain.from_iterable(rows), dtype=np.intp).reshape(-1, self.order)


def _permutations(rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Number of permutations of each sorted row: n! divided by the factorials of the multiplicities."""
    run, repeats = np.ones(len(rows)), np.ones(len(rows))
    for earlier, later in zip(rows.T, rows.T[1:], strict=False):
        run = np.where(earlier == later, run + 1, 1.0)
        repeats *= run
    return factorial(rows.shape[1]) / repeats
