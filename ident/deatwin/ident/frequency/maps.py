"""Frequency responses of several frequencies: contours, a surface, and slices of more than two frequencies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import real_numbers
from deatwin.ident.frequency.drawing import drawn_points, say_zero
from deatwin.plant.drawing import written_unit
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.frequency.response import FrequencyResponse


Array = NDArray[np.float64]

_FEWEST_ON_A_LINE = 3  # least number of frequencies on each axis of a grid


def plot_map(response: FrequencyResponse, axes: Axes) -> Axes:
    """Draw the gain over the first two frequencies: contours on a grid, else points coloured by gain."""
    plane = _middle_slice(response)
    grid = _grid(plane)
    if grid is None:
        return _plot_points(response, axes)
    _label_map(axes.figure.colorbar(_contours(plane, grid, axes), ax=axes), plane, axes)
    return axes


def plot_surface(response: FrequencyResponse, ax: Any | None = None) -> Any:
    """Plot the gain over a grid of two frequencies as a surface, in dB.

    Parameters
    ----------
    response : FrequencyResponse
        Response of order 2 or more on a grid, see `frequency_grid`. Frequencies beyond the second are held constant, as
        in `plot_response`.
    ax : matplotlib 3-D Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib 3-D Axes

    Raises
    ------
    ModelError
        If the points do not form a grid, or the axes are not three-dimensional.
    """
    plane = _middle_slice(response)
    grid = _grid(plane)
    if grid is None:
        raise ModelError("a surface needs values on a grid of two frequencies; see frequency_grid")
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.figure().add_subplot(projection="3d")
    if not hasattr(ax, "plot_surface"):
        raise ModelError('a surface needs three-dimensional axes: add_subplot(projection="3d")')
    heights = grid.of(_decibels(plane))
    ax.plot_surface(*np.meshgrid(grid.first, grid.second, indexing="ij"), heights, cmap="viridis", linewidth=0)
    ax.set_zlabel(_gain_label(plane))
    _label_frequencies(plane, ax)
    return ax


def slice_of(response: FrequencyResponse, held_Hz: ArrayLike) -> FrequencyResponse:
    """Return the points of a response at which all frequencies after the second are nearest to given ones.

    Parameters
    ----------
    response : FrequencyResponse
        Response of order 3 or more.
    held_Hz : float, or array_like of shape (order - 2,)
        Frequencies to hold constant, Hz.

    Returns
    -------
    FrequencyResponse
        Response of the same order, with fewer points.

    Raises
    ------
    ModelError
        If the order is below 3, or the number of frequencies is not order - 2.
    """
    _require_more_than_two(response)
    held = np.atleast_1d(real_numbers(held_Hz, "held_Hz"))
    others = response.frequency_Hz[:, 2:]
    if held.shape != others.shape[1:] or not np.all(np.isfinite(held)):
        raise ModelError(f"held_Hz has the shape {held.shape}; order {response.order} needs {others.shape[1:]}, in Hz")
    nearest = others[np.argmin(np.sum((others - held) ** 2, axis=1))]
    chosen = np.flatnonzero(np.all(others == nearest, axis=1))
    return response.at_points(chosen)


class _Grid(NamedTuple):
    """All pairs of two lists of frequencies in Hz, and the position of each pair among the points."""

    first: Array
    second: Array
    position: NDArray[np.intp]

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        return values[self.position]


def _grid(response: FrequencyResponse) -> _Grid | None:
    """Return the grid that the first two frequencies form; None if they form none."""
    if not _is_slice(response):
        return None
    first, row = np.unique(response.frequency_Hz[:, 0], return_inverse=True)
    second, column = np.unique(response.frequency_Hz[:, 1], return_inverse=True)
    if min(first.size, second.size) < _FEWEST_ON_A_LINE or first.size * second.size != len(row):
        return None
    position = np.full((first.size, second.size), -1, dtype=np.intp)
    position[row, column] = np.arange(len(row))
    return _Grid(first, second, position) if np.all(position >= 0) else None


def _is_slice(response: FrequencyResponse) -> bool:
    """Return whether all frequencies after the second are constant."""
    return response.omega.ndim == 2 and bool(np.all(response.omega[:, 2:] == response.omega[:1, 2:]))


def _middle_slice(response: FrequencyResponse) -> FrequencyResponse:
    if response.omega.ndim == 1 or response.omega.shape[1] == 2:
        return response
    held = np.unique(response.frequency_Hz[:, 2:], axis=0)
    return slice_of(response, held[len(held) // 2])


def _require_more_than_two(response: FrequencyResponse) -> None:
    if response.omega.ndim == 1 or response.omega.shape[1] < 3:
        raise ModelError(f"a slice holds the third frequency; {response.label} has {response.omega.ndim}")


def _decibels(response: FrequencyResponse) -> Array:
    """Return the gain in dB relative to 1 unit; NaN where there is no value."""
    decibels = np.full(response.gain.shape, np.nan)
    np.log10(response.gain, out=decibels, where=drawn_points(response))
    return np.round(20 * decibels, 9)  # rounded, so that a constant gain has no contours


def _levels(decibels: Array) -> Array:
    """Return round contour levels that cover all values."""
    from matplotlib.ticker import MaxNLocator

    known = decibels[np.isfinite(decibels)]
    low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
    margin = max(0.0, 0.5 - (high - low))  # a constant response also needs a range of colours
    return np.asarray(MaxNLocator(18).tick_values(low - margin, high + margin), dtype=np.float64)


def _contours(response: FrequencyResponse, grid: _Grid, axes: Axes) -> Any:
    decibels = _decibels(response)
    drawn = axes.contourf(grid.first, grid.second, grid.of(decibels).T, levels=_levels(decibels), cmap="viridis")
    axes.contour(drawn, colors="white", linewidths=0.3, linestyles="solid")
    say_zero(drawn_points(response), axes)
    if response.theta_cov.any():
        doubtful = ~response.band().linear_law
        if doubtful.any():
            _hatch(grid.of(doubtful), grid, axes)
    return drawn


def _hatch(doubtful: NDArray[np.bool_], grid: _Grid, axes: Axes) -> None:
    from matplotlib.patches import Patch

    hatched = axes.contourf(
        grid.first, grid.second, doubtful.T.astype(float), levels=[0.5, 1.5], colors="none", hatches=["//"]
    )
    hatched.set_edgecolor("white")
    hatched.set_linewidth(0.0)
    proxy = Patch(facecolor="0.5", edgecolor="white", hatch="//", label="linear law fails")
    axes.legend(handles=[proxy], loc="upper right", frameon=True, facecolor="0.9", labelcolor="black")


def _plot_points(response: FrequencyResponse, axes: Axes) -> Axes:
    first, second = response.frequency_Hz[:, :2].T
    drawn = axes.scatter(first, second, c=_decibels(response), cmap="viridis", s=14)
    _label_map(axes.figure.colorbar(drawn, ax=axes), response, axes)
    return axes


def _label_map(bar: Any, response: FrequencyResponse, axes: Axes) -> None:
    bar.set_label(_gain_label(response))
    _label_frequencies(response, axes)


def _label_frequencies(response: FrequencyResponse, axes: Any) -> None:
    axes.set_xlabel("$f_1$ (Hz)")
    axes.set_ylabel("$f_2$ (Hz)")
    others = response.frequency_Hz[:, 2:]
    if _is_slice(response) and others.size:
        axes.set_title(", ".join(f"$f_{i}$ = {held:.3g} Hz" for i, held in enumerate(others[0], start=3)))


def _gain_label(response: FrequencyResponse) -> str:
    unit = written_unit(response.unit)
    return f"|{response.label}| (dB re 1 {unit})" if unit else f"|{response.label}| (dB)"
