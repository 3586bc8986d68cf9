"""Spectrum of each order of the output in the steady state of a periodic input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import read_only, real_numbers
from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.frequency.gfrf import names_of
from deatwin.ident.frequency.hierarchy import CrossOrders, Jet, Orders, solve_parts
from deatwin.ident.frequency.linear import whole_order
from deatwin.ident.frequency.many import spectrum_of_many
from deatwin.ident.frequency.response import FrequencyResponse, FrequencyStatus
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.errors import ModelError

_EXCITED = 1e-12  # share of the largest line below which a line is a rounding error in the signal as given


def output_spectrum(
    model: NarxModel, excitation: ArrayLike, order: int, *, operating_input: ArrayLike | None = None
) -> FrequencyResponse:
    """Compute the spectrum of the steady-state output under a periodic input, up to a given order.

    The spectrum is Y = Y_1 + ... + Y_N. If the excitation is multiplied by a factor, Y_n grows with the n-th power of
    this factor.

    Parameters
    ----------
    model : NarxModel
        Model of one output.
    excitation : array_like, shape (n_samples,), or (n_inputs, n_samples) for several inputs
        One period of the input as deviations from the operating input, at the model's sampling time, in the input's
        unit.
    order : int
        Highest order N, at least 1.
    operating_input : float, or array_like of shape (n_inputs,), optional
        Constant input about which the model is expanded, in its unit; the mean of the training inputs by default.

    Returns
    -------
    FrequencyResponse
        Fourier coefficients Y = (1/n_samples) sum_k v(k) e^(-jwkT), in the output's unit, at all lines of the period
        from 0 to half the sampling rate. v is the output's deviation from the equilibrium, w the angular frequency and
        T the sampling time.

    Raises
    ------
    ModelError
        If an argument is invalid; if the model has several outputs or no equilibrium; if the excitation is so large
        that an order overflows; or if a line of the excitation coincides with a pole on the unit circle.
    """
    highest = whole_order(order)
    return _steady(model, excitation, operating_input, highest).response(range(1, highest + 1), 0)


def output_orders(
    model: NarxModel, excitation: ArrayLike, order: int, *, operating_input: ArrayLike | None = None
) -> tuple[FrequencyResponse, ...]:
    """Compute the spectra Y_1, ..., Y_N of the orders of the steady-state output under a periodic input.

    If the excitation is multiplied by a factor, Y_n grows with the n-th power of this factor.

    Parameters
    ----------
    model : NarxModel
        Model of one output.
    excitation : array_like, shape (n_samples,), or (n_inputs, n_samples) for several inputs
        One period of the input as deviations from the operating input, at the model's sampling time, in the input's
        unit.
    order : int
        Highest order N, at least 1.
    operating_input : float, or array_like of shape (n_inputs,), optional
        Constant input about which the model is expanded, in its unit; the mean of the training inputs by default.

    Returns
    -------
    tuple of FrequencyResponse, length N
        Fourier coefficients Y_1, ..., Y_N, in the output's unit, at all lines of the period from 0 to half the sampling
        rate. Their sum is the result of `output_spectrum`.

    Raises
    ------
    ModelError
        For the reasons given in `output_spectrum`.
    """
    highest = whole_order(order)
    steady = _steady(model, excitation, operating_input, highest)
    return tuple(steady.response((n,), n) for n in range(1, highest + 1))


def line_frequencies(n_samples: int, sample_time: float) -> Array:
    """Return the lines of a period from 0 to half the sampling rate in rad/s, shape (n_samples // 2 + 1,)."""
    return read_only(2 * np.pi * np.fft.rfftfreq(n_samples, sample_time))


def spectrum_of(values: ArrayLike) -> Complex:
    """Return Fourier coefficients of complete periods, (1/n) sum_k x(k) e^(-jwkT), (..., n // 2 + 1)."""
    given = np.asarray(values, dtype=np.float64)
    return np.asarray(np.fft.rfft(given) / given.shape[-1], dtype=np.complex128)


def excited_lines(spectrum: Complex) -> NDArray[np.bool_]:
    """Return which lines exceed rounding errors. Shapes: `spectrum`, as the result (n_lines,)."""
    size = np.abs(spectrum)
    return np.asarray(size > _EXCITED * size.max(), dtype=np.bool_)


def representable(values: Complex, what: str) -> Complex:
    """Return a computed result, after a check that it is finite."""
    if not np.all(np.isfinite(values)):
        raise ModelError(f"the excitation is so large that {what} overflows; lower its amplitude")
    return values


def one_period(excitation: ArrayLike, sample_time: float, n_inputs: int = 1) -> Array:
    """Return a period of inputs, after a check. Shapes: (n_samples,) or (n_inputs, n_samples), as the result."""
    values = real_numbers(excitation, "the excitation")
    wanted = "(n_samples,)" if n_inputs == 1 else f"({n_inputs}, n_samples)"
    several = values.ndim == 2 and values.shape[0] == n_inputs
    if not (values.ndim == 1 if n_inputs == 1 else several) or values.shape[-1] < 2:
        raise ModelError(
            f"the excitation has the shape {values.shape}; it must be one period of at least two samples, of shape "
            f"{wanted}"
        )
    wrong = np.argwhere(~np.isfinite(values))
    if wrong.size:
        raise ModelError(
            f"sample {wrong[0][-1]} of the excitation is {values[tuple(wrong[0])]}; all must be finite deviations from the "
            "operating input"
        )
    own = getattr(excitation, "sample_time", sample_time)
    if not np.isclose(own, sample_time, rtol=1e-9, atol=0.0):
        raise ModelError(
            f"the excitation has a sample time of {own:g} s, the model one of {sample_time:g} s; design it at the "
            "model's"
        )
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steady:
    """Orders of the output in the steady state; derivatives are computed when first needed."""

    model: NarxModel
    about: Deviations
    parts: Orders

    @cached_property
    def values(self) -> dict[int, Jet]:
        return self._solve(by_theta=False)

    @cached_property
    def slopes(self) -> dict[int, Jet]:
        return self._solve(by_theta=True)

    def _solve(self, *, by_theta: bool) -> dict[int, Jet]:
        with np.errstate(over="ignore", invalid="ignore"):  # overflow is reported where the parts are summed
            return solve_parts(self.about.model.terms, self.about.model.theta, self.parts, by_theta=by_theta)

    def response(self, wanted: Sequence[int], number: int) -> FrequencyResponse:
        """The sum of some orders."""
        values = np.zeros(self.parts.n_samples // 2 + 1, dtype=np.complex128)
        with np.errstate(over="ignore", invalid="ignore"):
            for n in wanted:
                if n in self.values:
                    values += spectrum_of(self.values[n].value)
        return FrequencyResponse(
            symbol="Y",
            order=number,
            values=representable(values, f"order {number or wanted[-1]} of the output"),
            omega=line_frequencies(self.parts.n_samples, self.model.sample_time),
            point=self.about.point,
            status=FrequencyStatus.at(self.about.point),
            unit=self.model.output_units[0],
            theta_cov=self.model.theta_cov,
            theta_dof=self.model.theta_dof,
            differentiate=partial(self._gradient, wanted),
            evaluate=partial(spectrum_of_many, self.model, self.about.point, self.parts, wanted),
        )

    def _gradient(self, wanted: Sequence[int]) -> Complex:
        gradient = np.zeros((self.parts.n_samples // 2 + 1, self.about.jacobian.shape[1]), dtype=np.complex128)
        with np.errstate(over="ignore", invalid="ignore"):
            for n in wanted:
                slope = self.slopes[n].slope if n in self.slopes else None
                if slope is not None:
                    gradient += spectrum_of(slope).T @ self.about.jacobian
        return representable(gradient, f"the derivative of order {wanted[-1]} of the output")


def _steady(model: NarxModel, excitation: ArrayLike, operating_input: ArrayLike | None, highest: int) -> _Steady:
    about = deviations(model, operating_input)
    period = one_period(excitation, model.sample_time, len(model.input_names))
    return _Steady(model=model, about=about, parts=Orders(period, highest))


def cross_order(
    model: NarxModel, excitation: ArrayLike, powers: Sequence[int], operating_input: ArrayLike | None = None
) -> FrequencyResponse:
    """Part of the output with a power of each input. Shapes: `excitation` (n_inputs, n); `powers` (n_inputs,)."""
    about = deviations(model, operating_input)
    parts = CrossOrders(one_period(excitation, model.sample_time, len(powers)), powers)
    found = _Steady(model=model, about=about, parts=parts).response((parts.whole,), sum(powers))
    return replace(found, inputs=names_of(model, [row for row, power in enumerate(powers) for _ in range(power)]))


def inner_lines(
    model: NarxModel, excitation: Array, order: int, operating_input: ArrayLike | None = None
) -> FrequencyResponse:
    """Return the lines at which an order is complex and not zero, so that its covariance has two dimensions."""
    whole = output_orders(model, excitation, order, operating_input=operating_input)[-1]
    inner = np.arange(1, whole.values.size - 1)
    return whole.at_points(inner[whole.gain[inner] > 1e-9 * whole.gain.max()])
