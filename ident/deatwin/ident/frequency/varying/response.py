"""A frequency response along time; at each time, the parameters are taken as constant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only
from deatwin.ident.frequency.linear import levels, motion
from deatwin.ident.frequency.response import Band, FrequencyResponse
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import PART_COORDINATES, Described, Metadata, attribute, coordinate, squared, variable
from deatwin.plant.drawing import Axes, axes_or_new, written_unit
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.colors import Normalize


_NARROW = 10.0  # largest ratio of gains for which colours are linear in the gain
_RANGE = 1e4  # largest ratio of gains on the colour scale; smaller gains share one colour


class VaryingStatus(Enum):
    """Status of the frequency response at one time. The value of each member is a message for the user."""

    OK = "the equilibrium of this time is stable"
    UNSTABLE = (
        "the equilibrium of this time is unstable: the response is that of the linearised model, "
        "which no experiment can show; choose another operating input or identify again"
    )
    NONE = (
        "the model of this time has no equilibrium that could be followed at its operating input, and so no "
        "response; choose another operating input or identify again"
    )

    @property
    def ok(self) -> bool:
        """True if the equilibrium is stable."""
        return self is VaryingStatus.OK


_DECADES = 20.0  # ratio of the highest to the lowest frequency above which the axis is logarithmic


@dataclass(frozen=True, kw_only=True, eq=False)
class VaryingResponse(Described):
    """Frequency response of a model whose parameters change with time.

    At each time, the parameters and the operating input are taken as constant.

    Parameters
    ----------
    timepts : ndarray, shape (n_times,)
        Increasing times on the experiment's clock, s.
    operating_inputs : ndarray, shape (n_times,)
        Input at the operating point of each time, in its unit.
    models : tuple of (NarxModel or None), length n_times
        Model with the parameters of each time. Its ``operating`` range is centred at its equilibrium. None if there is
        no equilibrium.
    responses : tuple of (FrequencyResponse or None), length n_times
        Response of each model at n_values points: generalised frequency response H_n, nonlinear output frequency
        response G_n, or output spectrum Y_n. None if there is no model; at least one is not None.
    correct : callable
        Function without arguments that computes `frozen_correction`.
    """

    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    operating_inputs: Array = field(
        metadata=variable("time", name="operating_input", unit=lambda found: found._model.input_units[0])
    )
    models: tuple[NarxModel | None, ...]
    responses: tuple[FrequencyResponse | None, ...]
    correct: Callable[[], Complex]

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "values": variable("time", "point", name="", unit=attrgetter("unit")),
        "covariance": variable("time", "point", "part", "other_part", unit=lambda found: squared(found.unit)),
        "frozen_error": variable("time", "point", unit=attrgetter("unit")),
        "omega": variable("point", "tone", unit="rad/s"),
        "frequency_Hz": coordinate("point", "tone", unit="Hz"),
        "equilibria": variable("time", name="equilibrium", unit=lambda found: found._model.output_units[0]),
        "equilibrium_std": variable("time", unit=lambda found: found._model.output_units[0]),
        "status": variable("time", of=lambda found: [each.name for each in found.statuses]),
        "symbol": attribute(),
        "order": attribute(),
        **PART_COORDINATES,
    }

    @property
    def _model(self) -> NarxModel:
        return next(model for model in self.models if model is not None)

    @property
    def _first(self) -> FrequencyResponse:
        return next(response for response in self.responses if response is not None)

    @property
    def symbol(self) -> str:
        """Symbol "H", "G" or "Y"."""
        return self._first.symbol

    @property
    def order(self) -> int:
        """Order n; 0 for the sum of all orders."""
        return self._first.order

    @property
    def label(self) -> str:
        """Symbol and order, for axes and legends."""
        return self._first.label

    @property
    def omega(self) -> Array:
        """Angular frequencies, rad/s, shape (n_values,), or (n_values, order) for H_n of order 2 or higher."""
        return self._first.omega

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies, Hz, of the same shape as ``omega``."""
        return self._first.frequency_Hz

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self._first.unit

    @cached_property
    def statuses(self) -> tuple[VaryingStatus, ...]:
        """Status of the response at each time, length n_times."""
        return tuple(VaryingStatus.NONE if r is None else VaryingStatus[r.status.name] for r in self.responses)

    @cached_property
    def equilibria(self) -> Array:
        """Output at the equilibrium of each time, in its unit, shape (n_times,); NaN if there is none."""
        return read_only([np.nan if response is None else response.point.output for response in self.responses])

    @cached_property
    def equilibrium_std(self) -> Array:
        """Standard deviation of ``equilibria``, which the uncertainty of the parameters causes, shape (n_times,)."""
        return read_only(
            [
                np.nan if model is None or response is None else _std_of(model, response)
                for model, response in zip(self.models, self.responses, strict=True)
            ]
        )

    @cached_property
    def values(self) -> Complex:
        """Complex response in ``unit``, shape (n_times, n_values); NaN at times without an equilibrium."""
        values = self._stacked(lambda response: response.values)
        values.setflags(write=False)
        return values

    @cached_property
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n_times, n_values, 2, 2), to first order in the parameters."""
        return read_only(self._stacked(lambda response: response.covariance))

    @property
    def gain(self) -> Array:
        """Magnitude of the response in ``unit``, shape (n_times, n_values)."""
        return np.asarray(np.abs(self.values), dtype=np.float64)

    @cached_property
    def frozen_correction(self) -> Complex:
        """Correction for the rate at which the parameters change, complex, shape (n_times, n_values), in ``unit``.

        To first order in this rate, the response of the time-varying model is ``values`` plus the correction. The rate
        is the difference quotient between the neighbouring times of the trajectory, even if ``timepts`` are farther
        apart. The correction is NaN at times without a stable equilibrium, if a neighbouring time of the trajectory has
        no equilibrium, or if the trajectory has only one time.
        """
        correction = self.correct()
        correction.setflags(write=False)
        return correction

    @property
    def frozen_error(self) -> Array:
        """Error of taking the parameters as constant: magnitude of ``frozen_correction``, shape (n_times, n_values).

        The error is small if the parameters change little within the memory of the system.
        """
        return np.asarray(np.abs(self.frozen_correction), dtype=np.float64)

    def band(self, level: float = 0.95) -> Band:
        """Return the pointwise band of the gain, shape (n_times, n_values), of coverage probability `level`.

        The band is computed to first order in the parameters, and is NaN at times without a response. The
        parameters' uncertainty may be too large for the first order; `propagate`, applied to one of ``models``, tests
        this. The band does not include ``frozen_error``.
        """
        low, high, law = np.moveaxis(self._stacked(partial(_limits, level)), 1, 0)
        return Band(level=level, low=read_only(low), high=read_only(high), linear_law=law == 1.0)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the gain as a map over time and frequency, on `ax` or new axes.

        Times with an unstable equilibrium are hatched; times without a response are blank. If each point has several
        frequencies, the frequency axis is the first one that differs between points.
        """
        axes = axes_or_new(ax)
        borders, gain, label = _along_line(self)
        low, norm = colours(gain)
        mesh = axes.pcolormesh(edges(self.timepts), borders, np.maximum(gain, low).T, norm=norm, rasterized=True)
        gaps = np.isnan(gain).all(axis=0)
        if borders[0] > 0 and borders[-1] > _DECADES * borders[0] and not gaps.any():
            axes.set_yscale("log")
        spans = _unstable(self)
        for first, last in spans:
            span = axes.axvspan(first, last, facecolor="none", edgecolor="white", hatch="//", linewidth=0)
            span.set_label("unstable" if (first, last) == spans[0] else "")
        if spans:
            axes.legend(loc="upper left", frameon=True, facecolor="0.6", labelcolor="black")
        name = self.label.strip("$")
        bar = axes.figure.colorbar(mesh, ax=axes, extend="min" if np.nanmin(gain) < low else "neither")
        bar.set_label(f"$|{name}|$ ({written_unit(self.unit)})" if self.unit else f"$|{name}|$")
        axes.set(xlabel="time (s)", ylabel=label)
        return axes

    def _stacked(self, get: Callable[[FrequencyResponse], NDArray[Any]]) -> NDArray[Any]:
        """Stack the arrays of all times; NaN where there is none."""
        missing = np.full_like(get(self._first), np.nan)
        return np.stack([missing if response is None else get(response) for response in self.responses])


def _limits(level: float, response: FrequencyResponse) -> Array:
    band = response.band(level)
    return np.stack([band.low, band.high, band.linear_law])


def _std_of(model: NarxModel, response: FrequencyResponse) -> float:
    moves = motion(model, levels(model, response.point.operating_input, response.point.output))
    variance = float(moves @ model.theta_cov @ moves)
    return max(variance, 0.0) ** 0.5


def _along_line(response: VaryingResponse) -> tuple[Array, Array, str]:
    """Return cell borders of increasing frequencies in Hz, the gain between them, and the label of the axis."""
    frequency, gain = response.frequency_Hz, response.gain
    label = "frequency (Hz)"
    if frequency.ndim == 2:
        frequency, label = first_tone(frequency)
    order = np.argsort(frequency, kind="stable")
    frequency, gain = frequency[order], gain[:, order]
    if response.symbol != "G" or frequency.size == 1:
        return edges(frequency), gain, label
    half = np.diff(frequency).min() / 2
    gaps = np.flatnonzero(np.diff(frequency) > 2.001 * half)
    borders = np.concatenate([frequency[:1] - half, frequency + half])
    borders = np.insert(borders, gaps + 2, frequency[gaps + 1] - half)
    return borders, np.insert(gain, gaps + 1, np.nan, axis=1), label


def _unstable(response: VaryingResponse) -> list[tuple[float, float]]:
    """Return the time spans in s in which the equilibrium is unstable."""
    borders = edges(response.timepts)
    marked = np.array([status is VaryingStatus.UNSTABLE for status in response.statuses], dtype=int)
    change = np.diff(np.concatenate([[0], marked, [0]]))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return [(float(borders[i]), float(borders[j])) for i, j in zip(starts, ends, strict=True)]


def colours(gain: Array) -> tuple[float, Normalize]:
    """Return the gain below which all values share one colour, and the colour scale."""
    from matplotlib.colors import LogNorm, Normalize

    largest = float(np.nanmax(gain, initial=0.0)) or 1.0
    least = float(np.nanmin(gain, initial=largest))
    if largest <= _NARROW * least:
        return least, Normalize(least, largest)
    positive = float(np.nanmin(np.where(gain > 0, gain, np.nan), initial=largest))
    low = max(positive, largest / _RANGE)
    return low, LogNorm(low, largest)


def first_tone(frequency: Array) -> tuple[Array, str]:
    """Return the first tone that is not constant, shape (n,), and its label. Shapes: `frequency` (n, order)."""
    moving = int(np.argmax(np.ptp(frequency, axis=0) > 0))
    if np.unique(frequency[:, moving]).size < len(frequency):
        raise ModelError("a map over time shows one line of frequencies: give each point its own first frequency")
    return frequency[:, moving], f"$f_{moving + 1}$ (Hz)"


def edges(centres: Array) -> Array:
    """Return cell borders halfway between centres, shape (n + 1,)."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Map:
    """A response over time and frequency."""

    timepts: Array  # shape (n_times,): s
    frequencies: Array  # shape (n,): Frequencies of the first tone, Hz
    values: NDArray[np.complex128]  # shape (n_times, n): in the response's unit
    equilibria: Array  # shape (n_times,): in the output's unit
    equilibrium_std: Array

    @classmethod
    def of(cls, response: VaryingResponse) -> Self:
        """Take the arrays from a response along time."""
        frequencies = response.frequency_Hz
        return cls(
            timepts=response.timepts,
            frequencies=frequencies if frequencies.ndim == 1 else frequencies[:, 0],
            values=response.values,
            equilibria=response.equilibria,
            equilibrium_std=response.equilibrium_std,
        )

    @property
    def gain(self) -> Array:
        """Magnitude, shape (n_times, n)."""
        return np.asarray(np.abs(self.values), dtype=np.float64)

    @property
    def change_dB(self) -> Array:
        """Gain divided by its mean over time at each frequency, dB, shape (n_times, n)."""
        return np.asarray(20 * np.log10(self.gain / self.gain.mean(axis=0)))
