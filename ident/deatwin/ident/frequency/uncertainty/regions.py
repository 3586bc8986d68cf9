"""Responses at other parameters, such as posterior draws, and the base class of propagated and sampled uncertainties."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import probability, whole_number
from deatwin.ident.frequency.drawing import drawn_points
from deatwin.ident.frequency.many import Evaluated
from deatwin.ident.frequency.response import Band, FrequencyResponse
from deatwin.ident.frequency.uncertainty.gain_phase import Ellipses, region_radius
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.posterior import ThetaPosterior
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, nested, several, variable
from deatwin.plant.drawing import Axes, axes_or_new, written_unit
from deatwin.plant.errors import ModelError

Quantity = Callable[[Any], FrequencyResponse]
"""Function that computes a frequency response of a model, such as ``partial(gfrf, order=2, omega=omega)``."""


def draw_theta(model: NarxModel, rng: np.random.Generator, n_draws: int) -> Array:
    """Draw parameters from a model's posterior, which is normal or Student-t. Shapes: returns (n_draws, n_theta)."""
    return ThetaPosterior(model=model).sample(rng, n_draws).theta


def response_of(model: NarxModel, quantity: Quantity, level: float) -> FrequencyResponse:
    """Return a quantity of a model after a check."""
    probability(level)
    if not callable(quantity):
        raise ModelError(
            f"quantity = {quantity!r}; it must be a function of a model, as partial(gfrf, order=1, omega=omega)"
        )
    response = quantity(model)
    if not isinstance(response, FrequencyResponse):
        raise ModelError(
            f"the quantity returned a {type(response).__name__}; it must return a FrequencyResponse, as "
            "partial(gfrf, order=2, omega=omega) does"
        )
    return response


def evaluate(model: NarxModel, quantity: Quantity, response: FrequencyResponse, thetas: Array) -> Evaluated:
    """Compute a quantity at many parameter vectors, all at once if possible. Shapes: `thetas` (n_draws, n_theta)."""
    if response.evaluate is not None:
        many = response.evaluate(thetas)
        if many.values.shape != (len(thetas), response.values.size):
            raise ModelError(
                f"{response.label} has {response.values.size} points, but at {len(thetas)} parameters its values have "
                f"the shape {many.values.shape}; take some of its points with at_points"
            )
        return many
    values = np.full((len(thetas), response.values.size), np.nan + 0j)
    exists, stable = np.zeros(len(thetas), dtype=bool), np.zeros(len(thetas), dtype=bool)
    for i, theta in enumerate(thetas):
        try:
            found = quantity(replace(model, theta=theta))
        except ModelError:  # the quantity exists for the model itself, so these parameters are the reason
            continue
        if found.values.shape == response.values.shape:
            values[i], exists[i], stable[i] = found.values, True, found.status.ok
    return Evaluated(values=values, exists=exists, stable=stable)


_MOST_ELLIPSES = 24  # most ellipses that are drawn; more would cover each other
_MOST_POINTS = 300


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertain(Described, ABC):
    """Frequency response with its uncertainty."""

    response: FrequencyResponse = field(metadata=nested())  # Response at the model's own parameters
    level: float = field(metadata=attribute())  # Default probability of regions and bands
    dof: float = field(metadata=attribute())  # Degrees of freedom of the parameters' t law; infinite for a normal law

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "covariance": variable("point", "part", "other_part"),
        "bands": several(lambda found: _bands(found)),
    }

    @property
    @abstractmethod
    def source(self) -> str:
        """Origin of the uncertainty, for legends."""

    @property
    def values(self) -> Complex:
        """The response at the model's own parameters, complex, shape (n,), in ``unit``."""
        return self.response.values

    @property
    def omega(self) -> Array:
        """Angular frequency in rad/s, shape (n,) or (n, order)."""
        return self.response.omega

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies, Hz, of the same shape as ``omega``."""
        return self.response.frequency_Hz

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self.response.unit

    @property
    def label(self) -> str:
        """Symbol and order, for axes and legends."""
        return self.response.label

    @property
    def gain(self) -> Array:
        """Magnitude of the values, shape (n,), in ``unit``."""
        return self.response.gain

    @property
    def phase_deg(self) -> Array:
        """Phase, degrees, shape (n,); unwrapped if each value has a single frequency."""
        return self.response.phase_deg

    @property
    @abstractmethod
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n, 2, 2), in the square of ``unit``."""

    @property
    @abstractmethod
    def linear_law(self) -> NDArray[np.bool_]:
        """True where the ellipses describe real and imaginary part, shape (n,)."""

    @abstractmethod
    def gain_band(self, level: float | None = None) -> Band:
        """Return a pointwise band of the gain, in ``unit``, of probability `level`, by default ``self.level``."""

    @abstractmethod
    def phase_band(self, level: float | None = None) -> Band:
        """Return a pointwise band of the phase, degrees, of probability `level`; NaN where it is undefined."""

    def ellipse(self, level: float | None = None, n_points: int = 73) -> Complex:
        """Return closed outlines of the regions of both parts jointly, complex, shape (n, n_points)."""
        n_points = whole_number(n_points, "n_points", 3)
        angle = np.linspace(0.0, 2 * np.pi, n_points)
        outline = self._ellipses.roots @ np.stack([np.cos(angle), np.sin(angle)])
        real, imaginary = np.moveaxis(outline * self._radius(level)[:, None, None], 1, 0)
        return np.asarray(self.values[:, None] + real + 1j * imaginary)

    def contains(self, other: ArrayLike, level: float | None = None) -> NDArray[np.bool_]:
        """Return whether each ellipse contains a value, bool, (..., n). Shapes: `other` (..., n) or (), complex."""
        given = np.asarray(other)
        if given.dtype.kind not in "iufc" or given.shape[-1:] not in ((), self.values.shape):
            raise ModelError(
                f"other holds {given.dtype.name} of shape {given.shape}; it must be one number, or one for each of the "
                f"{self.values.size} frequencies"
            )
        away = given - self.values
        return np.asarray(self._ellipses.squared_distance(away) <= self._radius(level) ** 2)

    @cached_property
    def _ellipses(self) -> Ellipses:
        return Ellipses.of(self.covariance)

    def _radius(self, level: float | None) -> Array:
        return region_radius(self.level if level is None else level, self.dof, self._ellipses.rank)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the response with its ellipses on `ax` or new axes, dashed where the linear law does not hold."""
        from matplotlib.collections import LineCollection

        axes = axes_or_new(ax)
        color = f"C{len(axes.collections)}"
        if self.label not in axes.get_legend_handles_labels()[1]:
            some = self.values[drawn_points(self.response)]
            axes.plot(some.real, some.imag, color=color, linewidth=1.2, markersize=4, label=self.label, **_style(self))
        shown = shown_points(self)
        outlines = self.ellipse()[shown]
        segments = np.stack([outlines.real, outlines.imag], axis=-1)
        holds = self.linear_law[shown]
        name = f"{100 * self.level:g} % ellipses {self.source}"
        for chosen, style, text in ((holds, "-", name), (~holds, "--", f"{name}, where the linear law fails")):
            if chosen.any():
                lines = LineCollection(
                    list(segments[chosen]), colors=color, linewidths=0.9, linestyles=style, alpha=0.8, label=text
                )
                axes.add_collection(lines)
        axes.autoscale_view()
        unit = f" ({written_unit(self.unit)})" if self.unit else ""
        axes.set(xlabel=f"real part{unit}", ylabel=f"imaginary part{unit}")
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize="small")
        return axes


def _bands(found: Uncertain) -> Variables:
    variables: dict[str, Any] = {}
    for name, band, unit in (("gain", found.gain_band(), found.unit), ("phase", found.phase_band(), "deg")):
        variables[f"{name}_low"] = ("point", band.low, unit)
        variables[f"{name}_high"] = ("point", band.high, unit)
        variables[f"{name}_linear_law"] = ("point", band.linear_law)
    return variables


def shown_points(uncertain: Uncertain) -> NDArray[np.int64]:
    """Return which frequencies get an ellipse: an even selection of those whose gain exceeds rounding errors."""
    there = np.flatnonzero(drawn_points(uncertain.response))
    return there[np.unique(np.linspace(0, there.size - 1, min(there.size, _MOST_ELLIPSES)).round().astype(np.int64))]


def plot_draws(uncertain: Uncertain, draws: Complex, axes: Axes) -> None:
    """Draw some draws as points under the ellipses. Shapes: `draws` (n_draws, n)."""
    some = draws[:_MOST_POINTS, shown_points(uncertain)]
    axes.plot(some.real.ravel(), some.imag.ravel(), ".", color="0.6", markersize=1.5, alpha=0.4, zorder=1)


def _style(uncertain: Uncertain) -> dict[str, Any]:
    """Return the line style: points for spectral lines, and where the sums of the frequencies go up and down."""
    steps = np.diff(uncertain.frequency_Hz.reshape(uncertain.values.size, -1).sum(axis=1))
    line = uncertain.omega.ndim == 1 or np.all(steps > 0) or np.all(steps < 0)
    return {} if line and uncertain.response.symbol != "Y" else {"linestyle": "none", "marker": "."}
