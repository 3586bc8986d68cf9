"""Convert frequency responses to ``control.frd``, and keep the covariance that python-control cannot hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import instance, numbers, taking
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.ident.arguments import keep_read_only
from deatwin.ident.frequency import FrequencyResponse
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import PART_COORDINATES, Described, Metadata, attribute, coordinate, squared, variable
from deatwin.plant.drawing import Axes, axes_or_new, numbers_of_decades, plain_numbers, written_unit
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from control import FrequencyResponseData


_TWO_SIDED = 1.959964  # Half width of the 95 % interval of a normal law, in standard deviations


@dataclass(frozen=True, kw_only=True, eq=False)
class Frd(Described):
    """Frequency response as an object of python-control, with a covariance at each frequency.

    Parameters
    ----------
    system : control.FrequencyResponseData
        Response from one input to one output, for ``control.bode_plot``, ``control.nyquist_plot`` and similar
        functions. The response has no timebase (``dt`` is None).
    covariance : ndarray, shape (n, 2, 2)
        First-order covariance of real and imaginary part at each frequency, in the square of the response's unit.
    unit : str
        Unit of the response; empty if it is not known.
    """

    system: FrequencyResponseData
    covariance: Array = field(metadata=variable("point", "part", "other_part", unit=lambda frd: squared(frd.unit)))
    unit: str = ""

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "omega": variable("point", unit="rad/s"),
        "values": variable("point", name="", unit=attrgetter("unit")),
        "frequency_Hz": coordinate("point", of=lambda frd: frd.omega / (2 * np.pi), unit="Hz"),
        "name": attribute(of=lambda frd: str(frd.system.name)),
        **PART_COORDINATES,
    }

    def __post_init__(self) -> None:
        keep_read_only(self, "covariance")
        if self.covariance.shape != (self.omega.size, 2, 2):
            raise ModelError(
                f"the covariance has the shape {self.covariance.shape}: {self.omega.size} frequencies need "
                f"({self.omega.size}, 2, 2)"
            )

    @property
    def omega(self) -> Array:
        """Angular frequencies, increasing, shape (n,), rad/s."""
        return np.asarray(self.system.omega, dtype=np.float64)

    @property
    def values(self) -> Complex:
        """The response, shape (n,), in its unit."""
        return np.asarray(self.system.frdata[0, 0], dtype=np.complex128)

    @property
    def gain_deviation(self) -> Array:
        """Standard deviation of the gain, shape (n,), in the response's unit; if the gain is 0, of the real part."""
        gain = np.abs(self.values)
        direction = np.where(gain == 0.0, 1.0, self.values / np.where(gain == 0.0, 1.0, gain))
        parts = np.stack([direction.real, direction.imag], axis=-1)
        return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", parts, self.covariance, parts).clip(min=0.0)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the gain with its pointwise 95 % band over frequency, on `ax` or new axes."""
        axes = axes_or_new(ax)
        shown = self.omega > 0.0  # a logarithmic axis cannot show zero
        frequency, gain = self.omega[shown] / (2 * np.pi), np.abs(self.values[shown])
        half = _TWO_SIDED * self.gain_deviation[shown]
        line = axes.loglog(frequency, gain, label="gain")[0]
        low = np.maximum(gain - half, 1e-3 * gain)
        axes.fill_between(frequency, low, gain + half, alpha=0.3, color=line.get_color(), label="95 %")
        plain_numbers(axes.xaxis)
        numbers_of_decades(axes.yaxis)
        axes.set_xlabel("frequency (Hz)")
        axes.set_ylabel(f"gain ({written_unit(self.unit)})" if self.unit else "gain")
        axes.legend()
        return axes


@taking(input_name=instance(str), output_name=instance(str), name=instance(str))
def to_frd(
    response: FrequencyResponse, *, input_name: str = "input", output_name: str = "output", name: str = "response"
) -> Frd:
    """Convert the frequency response H_1 of an identified model to a frequency response of python-control.

    Parameters
    ----------
    response : FrequencyResponse
        Response of order 1, from `gfrf`.
    input_name, output_name : str
        Names of input and output.
    name : str
        Name of the system, shown in legends.

    Returns
    -------
    Frd
        Frequency response in order of increasing frequency, with its covariance.

    Raises
    ------
    ModelError
        If the response is not of first order or holds negative frequencies.
    """
    if not isinstance(response, FrequencyResponse) or response.order != 1 or response.symbol not in ("H", "G"):
        raise ModelError("python-control holds linear responses: give that of frf, or of gfrf with the order 1")
    signals = (input_name, output_name)
    return _frd(response.omega, response.values, response.covariance, signals, response.unit, name)


@taking(linear=linear_model, omega=numbers, name=instance(str))
def linear_frd(linear: LinearModel, omega: ArrayLike, *, name: str = "response") -> Frd:
    """Convert the frequency response of a linear model to a frequency response of python-control.

    Parameters
    ----------
    linear : LinearModel
        Linear model, with the covariance of its coefficients.
    omega : array_like, shape (n,)
        Angular frequencies from 0 to half the sampling rate, rad/s.
    name : str
        Name of the system, shown in legends.

    Returns
    -------
    Frd
        Frequency response in order of increasing frequency. Its covariance is propagated from the coefficients.

    Raises
    ------
    ModelError
        If the model has no equilibrium, or a frequency does not lie between 0 and half the sampling rate.
    """
    linear.rest_output  # noqa: B018  (raises without an equilibrium)
    given = np.atleast_1d(np.asarray(omega, dtype=np.float64))
    highest = np.pi / linear.sample_time
    if given.ndim != 1 or given.size == 0 or not np.all(given <= highest * (1 + 1e-9)):
        raise ModelError(f"omega must be frequencies from 0 to half the sampling rate, {highest:.6g} rad/s")
    values = linear.response(given)
    signals = (linear.input_name, linear.output_name)
    units = (linear.output_unit, linear.input_unit)
    unit = "/".join(units) if all(units) else ""
    if not linear.covariance.any():  # with many slow modes, the coefficients below would lose all digits
        return _frd(given, values, np.zeros((given.size, 2, 2)), signals, unit, name)
    delay = np.exp(-1j * given * linear.sample_time)[:, None]
    bottom = np.polyval(linear.denominator[::-1], delay)
    by_numerator = delay ** np.arange(linear.numerator.size) / bottom
    by_denominator = -values[:, None] * delay ** np.arange(1, linear.denominator.size) / bottom
    slopes = np.concatenate([by_numerator, by_denominator], axis=1)
    parts = np.stack([slopes.real, slopes.imag], axis=1)
    return _frd(given, values, parts @ linear.covariance @ parts.swapaxes(1, 2), signals, unit, name)


def _frd(omega: Array, values: Complex, covariance: Array, signals: tuple[str, str], unit: str, name: str) -> Frd:
    import control

    order = np.argsort(omega, kind="stable")
    if not np.all(omega >= 0.0):  # true for NaN, too
        raise ModelError("the responses of python-control are over frequencies from 0 on; give those only")
    system = control.frd(values[order], omega[order], None, inputs=[signals[0]], outputs=[signals[1]], name=name)
    return Frd(system=system, covariance=covariance[order], unit=unit)
