"""Draw frequency responses of several frequencies: contours over the first two, the others held constant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.drawing import drawn_points, say_zero
from deatwin.plant.drawing import written_unit

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
    """Return the points at which the frequencies after the second are the middle ones of those given."""
    if response.omega.ndim == 1 or response.omega.shape[1] == 2:
        return response
    held = np.unique(response.omega[:, 2:], axis=0)
    return response.at_points(np.all(response.omega[:, 2:] == held[len(held) // 2], axis=1))


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
