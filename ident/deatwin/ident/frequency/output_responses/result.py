"""Result of estimating nonlinear output frequency responses, with its warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.frozen import Frozen
from deatwin.ident.frequency.output_responses.powers import InputSpectrum
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, variable
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SHOWN = 0.01  # truncation errors below this share of the gain are not drawn


class NofrfWarning(UserWarning):
    """Warning that a nonlinear output frequency response is not reliable; the text advises what to do."""


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
class Nofrf(Described, Frozen):
    """Nonlinear output frequency responses G_1, ..., G_N, estimated by least squares over levels of an excitation.

    Parameters
    ----------
    order : int
        Requested order n.
    orders : tuple of FrequencyResponse, length N
        Responses G_1, ..., G_N, each at the lines at which it exists, in output unit per power of the input unit.
        Derivatives, covariances and values at other parameters are those of the exact G_n.
    outputs : tuple of FrequencyResponse, length N
        Orders Y_n = G_n U_n of the output, at level 1 and at all lines.
    inputs : tuple of InputSpectrum, length N
        Spectra U_1, ..., U_N of the powers of the excitation at level 1.
    levels : ndarray, shape (n_levels,)
        Levels that were fitted: factors of the excitation.
    lost_levels : ndarray, shape (n_lost,)
        Levels at which the model diverges.
    condition : float
        Condition number of the fit with columns scaled to unit length.
    residual : ndarray, shape (n_levels, N)
        Part of the output's spectrum at each level that the first 1, 2, ..., N orders leave unexplained: root sum of
        squares, relative to that of the spectrum.
    left_out : ndarray, shape (n_fits,)
        Leave-one-out error of fits of 1, 2, ... orders: rms error of the spectrum predicted at each level from the
        others, relative to the spectrum. Infinite if there are too few levels.
    truncation : tuple of ndarray, length N
        Change of each G_n when two more orders are fitted, shape (n_values,) as G_n and in its unit. This change
        estimates the error caused by orders that were not fitted. NaN if there are too few levels for the estimate.
    advisable_level : float
        Factor by which to multiply the levels so that the truncation error of all orders up to ``order`` falls to about
        1 % (root mean square over their lines, by extrapolation) and the model does not diverge; 1 if the present
        levels already satisfy this, NaN if the truncation error is not known. At the ends of an order's range, where
        U_n is small, the error of G_n may be larger: see ``truncation``.
    status : NofrfStatus
        Most serious problem found, if any.
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
        """Response G_n of the requested order n."""
        return self.orders[self.order - 1]

    @property
    def values(self) -> Complex:
        """Values of that response, complex, shape (n_values,), in output unit per power of the input unit."""
        return self.response.values

    @property
    def omega(self) -> Array:
        """Angular frequencies of the values, rad/s, shape (n_values,)."""
        return self.response.omega

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies of the values, Hz, shape (n_values,)."""
        return self.response.frequency_Hz

    @property
    def highest(self) -> int:
        """Number N of orders that were fitted."""
        return len(self.orders)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot on `ax` or new axes the gain of the requested order, with its truncation error if visible."""
        return self._draw(self.order, axes_or_new(ax))

    def plot_orders(self, axes: Sequence[Axes] | None = None) -> tuple[Axes, ...]:
        """Plot the gains of G_1 up to the requested order, one on each of `axes` or of new axes."""
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
