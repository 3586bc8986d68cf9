"""Nonlinear output frequency responses that were fitted, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.checks import real_number
from deatwin.ident.frequency.frozen import Frozen
from deatwin.ident.frequency.many import Evaluated
from deatwin.ident.frequency.output_responses.powers import InputSpectrum
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.frequency.spectrum import representable
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, variable
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SHOWN = 0.01  # truncation errors below this share of the gain are not drawn


class NofrfWarning(UserWarning):
    """A NOFRF was computed, but is not to be relied upon; the text is the status' advice."""


class NofrfStatus(Enum):
    """Whether nonlinear output frequency responses can be relied on; the value is the advice."""

    OK = "excitation and levels suit these orders"
    UNSTABLE = (
        "the operating point is unstable: the output does not settle there; choose another operating input or "
        "identify again"
    )
    DIVERGED = (
        "the model diverges at the levels that were left out: the excitation is too large for it; lower its amplitude"
    )
    NOT_SETTLED = (
        "the output does not repeat with the period of the excitation: the model is very slow or oscillates by itself; "
        "choose a longer period or a lower amplitude"
    )
    ILL_CONDITIONED = (
        "the levels hardly tell the orders apart; choose levels of both signs, spread out to the largest, or fewer "
        "orders"
    )
    ERRATIC_EXCITATION = (
        "the contributions to the powers of this excitation cancel at some frequencies, where the NOFRF is erratic: "
        "random records that suit identification do not suit this; use design_excitation"
    )
    TRUNCATED = (
        "orders that were not fitted act at these levels: they change a NOFRF by more than 1 %; lower the amplitude or "
        "fit more orders"
    )
    UNVERIFIED = (
        "the levels do not tell what the orders that were not fitted do: nothing is known of the error they make; give "
        "at least two more levels than orders, spread out"
    )

    @property
    def ok(self) -> bool:
        """Whether there is nothing to be said against them."""
        return self is NofrfStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class Nofrf(Described, Frozen):
    """Nonlinear output frequency responses G_1, ..., G_N by least squares over levels of an excitation.

    Parameters
    ----------
    order : int
        The order that was asked for.
    orders : tuple of FrequencyResponse, length N
        G_1, ..., G_N, each at the lines where it exists; output unit by power of the input unit. Their derivatives
        and covariances are those of the exact G_n, and with other parameters they change as these do.
    outputs : tuple of FrequencyResponse, length N
        The orders of the output, Y_n = G_n U_n, at level 1 and at all lines.
    inputs : tuple of InputSpectrum, length N
        U_1, ..., U_N, of the excitation at level 1.
    levels : ndarray, shape (n_levels,)
        Factors of the excitation that were used.
    lost_levels : ndarray, shape (n_lost,)
        Those at which the model diverges.
    condition : float
        Condition number of the fit, its columns scaled to length one.
    residual : ndarray, shape (n_levels, N)
        Share of the output's spectrum at each level that the first n orders of the fit leave, in root sum of squares.
    left_out : ndarray, shape (n,)
        For fits of 1, 2, ... orders: share of the spectra that the fit without a level leaves there, over all levels;
        infinite where the levels are too few to leave one out.
    truncation : tuple of ndarray, length N
        By how much each G_n moves when two more orders are fitted, shape (n,) as G_n and in its unit: about the error
        by the orders that were not fitted. NaN where the levels do not tell.
    advisable_level : float
        Factor of the levels at which the truncation error of the orders of the output up to ``order`` would be about
        1 % of them (root mean squares over their lines), from its power law, and at which no level is known to
        diverge; 1 if both hold already, NaN if the truncation error is not known. At the ends of an order's range,
        where U_n is small, G_n may still be off by more: see ``truncation``.
    status : NofrfStatus
        The gravest of what there is to say.
    """

    order: int
    orders: tuple[FrequencyResponse, ...]
    outputs: tuple[FrequencyResponse, ...]
    inputs: tuple[InputSpectrum, ...]
    levels: Array = field(metadata=coordinate("level", name="level"))
    lost_levels: Array
    condition: float = field(metadata=attribute())
    residual: Array = field(metadata=variable("level", "order"))
    left_out: Array
    truncation: tuple[Array, ...]
    advisable_level: float
    status: NofrfStatus = field(metadata=attribute())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "by_line": several(lambda found: _by_line(found)),
        "order": coordinate("order", of=lambda found: np.arange(1, found.highest + 1)),
        "unit": coordinate("order", of=lambda found: [response.unit for response in found.orders]),
        "input_unit": coordinate("order", of=lambda found: [power.unit for power in found.inputs]),
        "frequency": coordinate("frequency", of=lambda found: found.inputs[0].frequency_Hz, unit="Hz"),
    }

    @property
    def response(self) -> FrequencyResponse:
        """G of the order that was asked for."""
        return self.orders[self.order - 1]

    @property
    def values(self) -> Complex:
        """Values of that response, complex, shape (n,), in output unit by power of the input unit."""
        return self.response.values

    @property
    def omega(self) -> Array:
        """Angular frequency of the values in rad/s, shape (n,)."""
        return self.response.omega

    @property
    def frequency_Hz(self) -> Array:
        """Frequency of the values in Hz, shape (n,)."""
        return self.response.frequency_Hz

    @property
    def highest(self) -> int:
        """N, the number of orders that were fitted."""
        return len(self.orders)

    @property
    def output_unit(self) -> str:
        """Unit of the output."""
        return self.outputs[0].unit

    def output_spectrum(self, level: float = 1.0) -> FrequencyResponse:
        """Return the output's spectrum as the sum of the orders that were fitted.

        Parameters
        ----------
        level : float
            Factor of the excitation.

        Returns
        -------
        FrequencyResponse
            Fourier coefficients in the output's unit at all lines of the period.

        Raises
        ------
        ModelError
            If the level is not a finite number, or so large that an order overflows.
        """
        factor = real_number(level, "the level")
        if not np.isfinite(factor):
            raise ModelError(f"the level is {factor}; it must be finite")
        with np.errstate(over="ignore", invalid="ignore"):
            shares = np.power(factor, np.arange(1, self.highest + 1))
            values = shares @ np.array([y.values for y in self.outputs])
        evaluates = [y.evaluate for y in self.outputs if y.evaluate is not None]
        return replace(
            self.outputs[0],
            order=0,
            values=representable(values, f"the output at {factor:g} times it"),
            differentiate=partial(_summed_gradient, self.outputs, shares),
            evaluate=partial(_summed, evaluates, shares) if len(evaluates) == self.highest else None,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the gain of the order that was asked for over frequency, with its truncation error where it shows.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        return self._draw(self.order, axes_or_new(ax))

    def plot_orders(self, axes: Sequence[Axes] | None = None) -> tuple[Axes, ...]:
        """Draw the gains of G_1 up to the order that was asked for, one above the other.

        Parameters
        ----------
        axes : sequence of matplotlib Axes, optional
            One for each order; new ones otherwise.

        Returns
        -------
        tuple of matplotlib Axes

        Raises
        ------
        ModelError
            If they are not as many.
        """
        if axes is None:
            from matplotlib import pyplot

            size = (6.4, 0.8 + 2.2 * self.order)
            found = pyplot.subplots(self.order, 1, sharex=True, squeeze=False, figsize=size, layout="constrained")[1]
            axes = list(found[:, 0])
        if len(axes) != self.order:
            raise ModelError(f"{self.order} orders need as many axes; got {len(axes)}")
        for number, axis in enumerate(axes, start=1):
            self._draw(number, axis).set_xscale("linear")  # one scale for all: even orders begin at zero
        for axis in axes[:-1]:
            axis.set_xlabel("")
        return tuple(axes)

    def _draw(self, number: int, axes: Axes) -> Axes:
        response, error = self.orders[number - 1], self.truncation[number - 1]
        response.plot(axes)
        shown = error > _SHOWN * response.gain
        if shown.any():
            error_shown = np.where(shown, error, np.nan)
            axes.plot(response.frequency_Hz, error_shown, ":.", color="0.4", label="truncation error")
            axes.legend()
        return axes


def _summed_gradient(outputs: Sequence[FrequencyResponse], shares: Array) -> Complex:
    return np.asarray(np.tensordot(shares, [y.gradient for y in outputs], axes=1), dtype=np.complex128)


def _summed(evaluates: Sequence[Callable[[Array], Evaluated]], shares: Array, thetas: Array) -> Evaluated:
    """The sum at other parameters; which of them have an equilibrium is the same for all orders."""
    found = [evaluate(thetas) for evaluate in evaluates]
    return replace(found[0], values=np.tensordot(shares, [each.values for each in found], axes=1))


def _by_line(found: Nofrf) -> Variables:
    """G_n, U_n and what the fit leaves; NaN at lines where a G_n does not exist."""
    shape, along = (found.highest, found.inputs[0].omega.size), ("order", "frequency")
    g, truncation = np.full(shape, np.nan, dtype=np.complex128), np.full(shape, np.nan)
    for n, (response, power) in enumerate(zip(found.orders, found.inputs, strict=True)):
        g[n, power.defined] = response.values
        truncation[n, power.defined] = found.truncation[n]
    inputs = np.array([power.values for power in found.inputs])
    return {"": (along, g), "truncation": (along, truncation), "input": (along, inputs)}
