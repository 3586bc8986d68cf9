"""Frequency responses of NARX models with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.dc import Equilibrium, equilibrium
from deatwin.ident.frequency.linear import LinearPart, linear_part
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import read_only
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

_LINEAR_LAW = (
    4.0  # gains below this many standard deviations (of the longer axis of the ellipse) are not normal
)


class FrequencyStatus(Enum):
    """Whether a frequency response can be observed; the value is the advice."""

    OK = "the operating point is stable"
    UNSTABLE = (
        "the operating point is unstable: the response is that of the linearised model, no experiment "
        "settles to it; choose another operating input or identify again"
    )

    @property
    def ok(self) -> bool:
        """Whether the operating point is stable."""
        return self is FrequencyStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class Band:
    """A pointwise confidence band of the gain.

    Parameters
    ----------
    level : float
        Probability at each frequency.
    low, high : ndarray, shape (n,)
        Limits in output unit by input unit.
    linear_law : ndarray of bool, shape (n,)
        Whether the gain is far enough from zero for the linear law to hold there.
    """

    level: float
    low: Array
    high: Array
    linear_law: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyResponse:
    """First-order frequency response H_1 at an operating point.

    Parameters
    ----------
    values : ndarray of complex, shape (n,)
        H_1 in output unit by input unit.
    omega : ndarray, shape (n,)
        Angular frequency in rad/s.
    gradient : ndarray of complex, shape (n, n_terms)
        Derivative of H_1 with respect to the model's parameters, the motion of the equilibrium included.
    covariance : ndarray, shape (n, 2, 2)
        Covariance of real and imaginary part, to first order.
    point : Equilibrium
        The operating point.
    status : FrequencyStatus
        Whether it is stable.
    unit : str
        Unit of the values.
    """

    values: NDArray[np.complex128]
    omega: Array
    gradient: NDArray[np.complex128]
    covariance: Array
    point: Equilibrium
    status: FrequencyStatus
    unit: str

    def __post_init__(self) -> None:
        for array in (self.values, self.omega, self.gradient, self.covariance):
            array.setflags(write=False)

    @property
    def frequency_Hz(self) -> Array:
        """Frequency in Hz, shape (n,)."""
        return self.omega / (2 * np.pi)

    @property
    def gain(self) -> Array:
        """Magnitude of H_1, shape (n,)."""
        return np.asarray(np.abs(self.values), dtype=np.float64)

    @property
    def phase_deg(self) -> Array:
        """Phase in degrees, unwrapped along the frequencies, shape (n,)."""
        return np.asarray(np.degrees(np.unwrap(np.angle(self.values))), dtype=np.float64)

    @property
    def gain_deviation(self) -> Array:
        """Standard deviation of the gain, shape (n,): the ellipse projected on the direction of H_1."""
        direction = np.where(self.values == 0, 1.0, self.values / np.where(self.gain == 0, 1.0, self.gain))
        parts = np.stack([direction.real, direction.imag], axis=-1)
        return np.sqrt(np.einsum("ni,nij,nj->n", parts, self.covariance, parts).clip(min=0.0))

    def band(self, level: float = 0.95) -> Band:
        """Return a pointwise confidence band of the gain.

        The parameters are taken as normal and the gain as linear in them. That fails where the gain is not
        large against its uncertainty (the gain of a normal complex number near zero is Rice-distributed):
        where it is less than four standard deviations of the longer axis of the ellipse, ``linear_law`` is
        False. The lower limit is never below zero.

        Parameters
        ----------
        level : float
            Probability at each frequency, between 0 and 1.

        Returns
        -------
        Band

        Raises
        ------
        ModelError
            If the level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ModelError(f"level = {level}; it must lie between 0 and 1")
        half = NormalDist().inv_cdf(0.5 + level / 2) * self.gain_deviation
        longest = np.sqrt(np.linalg.eigvalsh(self.covariance)[:, -1].clip(min=0.0))
        return Band(
            level=level,
            low=read_only((self.gain - half).clip(min=0.0)),
            high=read_only(self.gain + half),
            linear_law=self.gain >= _LINEAR_LAW * longest,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the gain over frequency with its 95 % band.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        band = self.band()
        (line,) = axes.plot(self.frequency_Hz, self.gain, label="$|H_1|$")
        axes.fill_between(
            self.frequency_Hz,
            band.low,
            band.high,
            color=line.get_color(),
            alpha=0.25,
            linewidth=0,
            label="95 % band",
        )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("frequency (Hz)")
        axes.set_ylabel(f"gain ({self.unit})" if self.unit else "gain")
        axes.legend()
        return axes


def gfrf(
    model: NarxModel, order: int, omega: ArrayLike, *, operating_input: ArrayLike | None = None
) -> FrequencyResponse:
    """Compute the generalised frequency response of an order; in this version the first, H_1.

    About the equilibrium at the operating input, H_1 = sum_l b_l e^(-j w l T) / (1 - sum_l a_l e^(-j w l T)).

    Parameters
    ----------
    model : NarxModel
        Model of one input and one output.
    order : int
        1.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s, up to half the sampling rate.
    operating_input : float, optional
        Constant input about which the model is linearised, in the input's unit; the centre of the training
        data by default (0 when there is none, as after `remove_dc`).

    Returns
    -------
    FrequencyResponse
        With its covariance from that of the parameters.

    Raises
    ------
    ModelError
        If the order is not available, the model has several inputs or no equilibrium, or a frequency is too
        high.

    References
    ----------
    Peyton Jones, Billings, "Recursive algorithm for computing the frequency response of a class of non-linear
    difference equation models", Int. J. Control 50 (1989) 1925-1940.
    Ridler, Salter, "An approach to the treatment of uncertainty in complex S-parameter measurements",
    Metrologia 39 (2002) 295-302.
    """
    if order != 1:
        raise ModelError(f"order = {order!r}: this version computes frequency responses of order 1 only")
    if len(model.input_names) != 1:
        raise ModelError(
            f"the model has {len(model.input_names)} inputs; "
            "this version computes frequency responses of one input"
        )
    frequencies = read_only(np.atleast_1d(np.asarray(omega, dtype=np.float64)))
    nyquist = np.pi / model.sample_time
    if frequencies.ndim != 1 or not np.all(np.abs(frequencies) <= nyquist * (1 + 1e-9)):
        raise ModelError(
            "omega must be one-dimensional, in rad/s, and not above half the sampling rate, "
            f"{nyquist:.6g} rad/s"
        )
    point = equilibrium(model, operating_input)
    linear = linear_part(model, point.operating_input, point.output)
    values, gradient = _first_order(linear, frequencies * model.sample_time)
    parts = np.stack([gradient.real, gradient.imag], axis=1)
    return FrequencyResponse(
        values=values,
        omega=frequencies,
        gradient=gradient,
        covariance=parts @ model.theta_cov @ parts.swapaxes(1, 2),
        point=point,
        status=FrequencyStatus.OK if point.is_stable else FrequencyStatus.UNSTABLE,
        unit=_ratio(model.output_units[0], model.input_units[0]),
    )


def _first_order(linear: LinearPart, angle: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return H_1 and its derivative by theta at normalised frequencies in rad."""
    delayed_output = np.exp(-1j * np.outer(angle, linear.output_lags))
    delayed_input = np.exp(-1j * np.outer(angle, linear.input_lags))
    denominator = 1.0 - delayed_output @ linear.a
    values = delayed_input @ linear.b / denominator
    gradient = (
        delayed_input @ linear.b_theta + values[:, None] * (delayed_output @ linear.a_theta)
    ) / denominator[:, None]
    return values, gradient


def _ratio(output_unit: str, input_unit: str) -> str:
    return f"{output_unit}/{input_unit}" if output_unit and input_unit else ""
