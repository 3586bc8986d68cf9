"""A frequency response of any order with gain, phase, and the uncertainty due to the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property, partial
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only
from deatwin.ident.frequency.dc import Equilibrium
from deatwin.ident.frequency.many import Many, then
from deatwin.ident.frequency.uncertainty.gain_phase import interval_radius
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.copies import Frozen
from deatwin.plant.datasets import PART_COORDINATES, Described, Metadata, attribute, coordinate, squared, variable
from deatwin.plant.drawing import Axes

LINEAR_LAW = 4.0  # Standard deviations (along the longer axis) below which a gain is not normally distributed


class FrequencyStatus(Enum):
    """Stability of the operating point of a frequency response.

    The value of each member is a message for the user.
    """

    OK = "the operating point is stable"
    UNSTABLE = (
        "the operating point is unstable: the response is that of the linearised model, "
        "which no experiment can show; choose another operating input or identify again"
    )

    @property
    def ok(self) -> bool:
        """True if the operating point is stable."""
        return self is FrequencyStatus.OK

    @classmethod
    def at(cls, point: Equilibrium) -> FrequencyStatus:
        """Return the status of the chosen equilibrium of `point`."""
        return cls.OK if point.is_stable else cls.UNSTABLE


@dataclass(frozen=True, kw_only=True, eq=False)
class Band(Frozen):
    """Pointwise confidence band of the gain.

    Parameters
    ----------
    level : float
        Coverage probability at each frequency.
    low, high : ndarray, shape (n,)
        Lower and upper limits of the gain, in the response's unit.
    linear_law : ndarray of bool, shape (n,)
        True where the gain is so large, compared with its uncertainty, that first-order propagation holds.
    """

    level: float
    low: Array
    high: Array
    linear_law: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Pointwise(Frozen):
    """A function of frequency points that can be evaluated at a selection of them."""

    function: Callable[..., Any]  # Function that takes the points as its first argument
    points: Array  # shape (n, ...): Points at which it is evaluated

    def __call__(self, *arguments: Any) -> Any:
        """Evaluate the function at its points."""
        return self.function(self.points, *arguments)

    def at(self, chosen: NDArray[np.intp]) -> Pointwise:
        """Return the function restricted to chosen points. Shapes: `chosen` (n_chosen,)."""
        return Pointwise(self.function, self.points[chosen])


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyResponse(Described):
    """Frequency response or output spectrum of order n at an operating point, with its uncertainty.

    H_n is a generalised frequency response (`gfrf`), G_n a nonlinear output frequency response (`nofrf`), and Y_n the
    n-th order of the output's spectrum (`output_orders`). The uncertainty is that of the model's parameters.

    Parameters
    ----------
    symbol : str
        Symbol of the response: "H", "G" or "Y".
    order : int
        Order n; 0 for the sum of all orders.
    values : ndarray of complex, shape (n_values,)
        Complex values, in ``unit``.
    omega : ndarray, shape (n_values,), or (n_values, order) for H_n of order 2 and more
        Angular frequencies, rad/s.
    point : Equilibrium
        Operating point at which the model was expanded.
    status : FrequencyStatus
        Status, which states whether the operating point is stable.
    unit : str
        Unit of the values.
    theta_cov : ndarray, shape (n_terms, n_terms)
        Covariance of the model's parameters.
    differentiate : callable
        Function without arguments. It returns the derivative of the values with respect to the parameters, complex,
        shape (n_values, n_terms), including the shift of the equilibrium.
    evaluate : callable, optional
        Function that takes draws of the parameters, shape (n_draws, n_terms). For each draw it returns the values, and
        whether the equilibrium exists and is stable. Without this function, the model is analysed anew for each draw.
    theta_dof : float
        Degrees of freedom of the parameters' Student-t distribution; infinite for a normal distribution.
    inputs : tuple of str
        Names of inputs, as many as the order n; a name may occur several times. For H_n: the input to which each of the
        n frequencies belongs. For G_n and Y_n: the inputs whose product the response belongs to. Empty for a model of
        one input.
    """

    symbol: str = field(metadata=attribute())
    order: int = field(metadata=attribute())
    values: Complex = field(metadata=variable("point", name="", unit=attrgetter("unit")))
    omega: Array = field(metadata=variable("point", "tone", unit="rad/s"))
    point: Equilibrium
    status: FrequencyStatus = field(metadata=attribute())
    unit: str
    theta_cov: Array
    differentiate: Callable[[], Complex]
    evaluate: Many | None = None
    theta_dof: float = math.inf
    inputs: tuple[str, ...] = ()

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "covariance": variable("point", "part", "other_part", unit=lambda response: squared(response.unit)),
        "frequency_Hz": coordinate("point", "tone", unit="Hz"),
        "operating_input": attribute(of=lambda response: _plain(response.point.operating_input)),
        "operating_output": attribute(of=attrgetter("point.output")),
        **PART_COORDINATES,
    }

    @cached_property
    def gradient(self) -> Complex:
        """Derivative of the values with respect to the model's parameters, complex, shape (n_values, n_terms)."""
        gradient = self.differentiate()
        gradient.setflags(write=False)
        return gradient

    @cached_property
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n_values, 2, 2), to first order."""
        parts = np.stack([self.gradient.real, self.gradient.imag], axis=1)
        return read_only(parts @ self.theta_cov @ parts.swapaxes(1, 2))

    def at_points(self, chosen: NDArray[Any] | slice) -> FrequencyResponse:
        """Return the response at selected points; `chosen` is a mask, an array of indices or a slice."""
        where = np.arange(self.values.size)[chosen]
        derive, many = self.differentiate, self.evaluate
        return replace(
            self,
            values=self.values[where],
            omega=self.omega[where],
            differentiate=derive.at(where) if isinstance(derive, Pointwise) else partial(_rows, self, where),
            evaluate=many.at(where) if isinstance(many, Pointwise) else then(many, partial(_columns, where)),
        )

    @property
    def label(self) -> str:
        """Symbol, order and (if there are several) inputs, as text for axes and legends."""
        order = f"_{self.order}" if self.order else ""
        names = ",".join(self.inputs).replace("_", r"\_").replace(" ", r"\ ")
        return f"${self.symbol}{order}" + (rf"^{{\mathrm{{{names}}}}}$" if names else "$")

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies, Hz, of the same shape as ``omega``."""
        return self.omega / (2 * np.pi)

    @property
    def gain(self) -> Array:
        """Magnitude, shape (n_values,)."""
        return np.asarray(np.abs(self.values), dtype=np.float64)

    @property
    def phase_deg(self) -> Array:
        """Phase, degrees, shape (n_values,); unwrapped if the response depends on one frequency only."""
        phase = np.angle(self.values)
        if self.omega.ndim == 1:
            known = np.isfinite(phase)
            phase[known] = np.unwrap(phase[known])
        return np.asarray(np.degrees(phase), dtype=np.float64)

    @property
    def gain_deviation(self) -> Array:
        """First-order standard deviation of the gain, shape (n_values,), in ``unit``."""
        return self._deviation(self._direction)

    @property
    def phase_deviation_deg(self) -> Array:
        """First-order standard deviation of the phase, degrees, shape (n_values,).

        The standard deviation is infinite where the gain is zero and uncertain.
        """
        across = self._deviation(1j * self._direction)
        ratio = np.full(across.shape, np.inf)
        np.divide(across, self.gain, out=ratio, where=self.gain > 0)
        return np.degrees(np.where(across == 0, 0.0, ratio))

    @property
    def _direction(self) -> Complex:
        """Return the values divided by their magnitudes; 1 for a value of zero."""
        gain = self.gain
        return np.where(gain == 0, 1.0, self.values / np.where(gain == 0, 1.0, gain))

    def _deviation(self, direction: Complex) -> Array:
        parts = np.stack([direction.real, direction.imag], axis=-1)
        return np.sqrt(np.einsum("ni,nij,nj->n", parts, self.covariance, parts).clip(min=0.0))

    @property
    def _longest_deviation(self) -> Array:
        """Return the standard deviation along the longer axis of the ellipse."""
        real, cross, imag = self.covariance[:, 0, 0], self.covariance[:, 0, 1], self.covariance[:, 1, 1]
        return np.sqrt((real + imag) / 2 + np.hypot((real - imag) / 2, cross))

    def band(self, level: float = 0.95) -> Band:
        """Return a pointwise confidence band of the gain, of coverage probability `level`, between 0 and 1.

        The parameters are assumed to be normal, or Student-t if ``theta_dof`` is finite, and the gain to be linear in
        them, which fails if the gain is not large compared with its uncertainty. ``linear_law`` is therefore False where
        the gain is below four standard deviations along the longer axis of the covariance ellipse. To test whether the
        complex response is linear in the parameters, use `propagate`. The lower limit is never below zero.
        """
        half = interval_radius(level, self.theta_dof) * self.gain_deviation
        return Band(
            level=level,
            low=read_only((self.gain - half).clip(min=0.0)),
            high=read_only(self.gain + half),
            linear_law=self.gain >= LINEAR_LAW * self._longest_deviation,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the gain over one frequency with its 95 % band, or over two as contours, on `ax` or new axes.

        A response of order three or more on a grid is plotted over the first two frequencies, with the other
        frequencies held constant. Points that do not form a grid are plotted as points. See also `bode`.
        """
        from deatwin.ident.frequency.drawing import plot_response

        return plot_response(self, ax)


def _rows(response: FrequencyResponse, where: NDArray[np.intp]) -> Complex:
    return response.gradient[where]


def _columns(where: NDArray[np.intp], values: Complex) -> Complex:
    return values[:, where]


def _plain(values: Array) -> float | list[float]:
    """Return a single number as a number, and several as a list, as files store them."""
    return float(values[0]) if values.size == 1 else [float(value) for value in values]
