"""Result of estimating nonlinear output frequency responses, with its warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

import numpy as np

from deatwin.ident.frequency.output_responses.powers import InputSpectrum
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError

_SHOWN = 0.01  # truncation errors below this share of the gain are not drawn


class NofrfWarning(UserWarning):
    """Issued if a nonlinear output frequency response is not reliable; the message advises what to do."""


class NofrfStatus(Enum):
    """Reliability of an estimated nonlinear output frequency response.

    The value of each member is a message for the user.
    """

    OK = "the test signal and its amplitudes suit the requested orders"
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
    ERRATIC_EXCITATION = (
        "the contributions to the powers of this excitation cancel at some frequencies, where the NOFRF is erratic: "
        "random recordings are unsuitable; use design_excitation"
    )
    TRUNCATED = (
        "orders that were not fitted act at these levels: they change a NOFRF by more than 1 %; lower the amplitude or "
        "fit more orders"
    )

    @property
    def ok(self) -> bool:
        """True if no problem was found."""
        return self is NofrfStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class Nofrf(Described):
    """Nonlinear output frequency responses G_1, ..., G_N, estimated by `nofrf`.

    The model was simulated with the excitation multiplied by several factors, which are called levels. At each level,
    the output's spectrum was fitted by Y_1 + ... + Y_N with Y_n = G_n U_n, where U_n is the spectrum of the n-th power
    of the input.

    Parameters
    ----------
    order : int
        Requested order, at most N.
    orders : tuple of FrequencyResponse, length N
        Responses G_1, ..., G_N, in output unit per n-th power of the input unit. Each is given at the lines at which
        U_n is not zero. Their covariances are those of the exact G_n (`nofrf_exact`).
    outputs : tuple of FrequencyResponse, length N
        Orders Y_1, ..., Y_N of the output at level 1, at all lines, in the output's unit.
    inputs : tuple of InputSpectrum, length N
        Spectra U_1, ..., U_N at level 1.
    levels : ndarray, shape (n_levels,)
        Levels that were fitted, dimensionless.
    lost_levels : ndarray, shape (n_lost,)
        Levels that were left out because the model diverges.
    condition : float
        Condition number of the least-squares problem, with columns scaled to unit length.
    residual : ndarray, shape (n_levels, N)
        Residual of the output's spectrum at each level after the first 1, 2, ..., N orders are subtracted: root sum of
        squares over the lines, divided by that of the spectrum.
    left_out : ndarray, shape (n_fits,)
        Leave-one-out error of fits of 1, 2, ... orders: root sum of squares of the errors with which each level's
        spectrum is predicted from the other levels, divided by that of all spectra. Infinite if there are too few
        levels.
    truncation : tuple of ndarray, length N
        Magnitude of the change of each G_n if two more orders are fitted, shape (n_values,), in the unit of G_n. It
        estimates the error due to orders that were not fitted. NaN if there are too few levels.
    advisable_level : float
        Factor, at most 1, by which all levels should be multiplied so that the model does not diverge, and the
        truncation error of Y_1, ..., Y_n is at most about 1 % of their rms, for the requested order n. 1 if no
        reduction is needed, NaN if the truncation error is not known.
    status : NofrfStatus
        Most serious problem that was found, or OK.
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
        """Response G_n of the requested order."""
        return self.orders[self.order - 1]

    @property
    def values(self) -> Complex:
        """Values of `response`, complex, shape (n_values,), in output unit per n-th power of the input unit."""
        return self.response.values

    @property
    def omega(self) -> Array:
        """Angular frequencies of `values`, rad/s, shape (n_values,)."""
        return self.response.omega

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies of `values`, Hz, shape (n_values,)."""
        return self.response.frequency_Hz

    @property
    def highest(self) -> int:
        """Number N of orders that were fitted."""
        return len(self.orders)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the gain of the requested order, with its truncation error if visible, on `ax` or new axes."""
        return self._draw(self.order, axes_or_new(ax))

    def plot_orders(self, axes: Sequence[Axes] | None = None) -> tuple[Axes, ...]:
        """Plot the gain of each response up to the requested order on its own axes, `axes` or new ones."""
        if axes is None:
            from matplotlib import pyplot

            size = (6.4, 0.8 + 2.2 * self.order)
            found = pyplot.subplots(self.order, 1, sharex=True, squeeze=False, figsize=size, layout="constrained")[1]
            axes = list(found[:, 0])
        if len(axes) != self.order:
            raise ModelError(f"{self.order} orders need as many axes; got {len(axes)}")
        for number, axis in enumerate(axes, start=1):
            self._draw(number, axis).set_xscale("linear")  # one scale for all panels, because even orders begin at zero
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


def _by_line(found: Nofrf) -> Variables:
    """Return G_n, U_n and the residual of the fit; NaN at lines where G_n does not exist."""
    shape, along = (found.highest, found.inputs[0].omega.size), ("order", "frequency")
    g, truncation = np.full(shape, np.nan, dtype=np.complex128), np.full(shape, np.nan)
    for n, (response, power) in enumerate(zip(found.orders, found.inputs, strict=True)):
        g[n, power.defined] = response.values
        truncation[n, power.defined] = found.truncation[n]
    inputs = np.array([power.values for power in found.inputs])
    return {"": (along, g), "truncation": (along, truncation), "input": (along, inputs)}
