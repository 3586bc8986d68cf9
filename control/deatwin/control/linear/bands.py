"""Bands of gain and modes over the samples of a family of linear models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.control.linear.family import LinearFamily
from deatwin.plant.amplitudes import axis_label
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, gain_unit, several
from deatwin.plant.drawing import Axes, axes_or_new, numbers_of_decades, written_unit

LEVEL = (0.025, 0.975)  # Quantiles of a 95 % band
_SHOWN = {"m": (1e3, "mm"), "N": (1e3, "mN")}
_CLOUD = 200  # Largest number of samples whose poles are drawn
_REAL = 1e-9  # Imaginary part below which a pole counts as real


@dataclass(frozen=True, kw_only=True, eq=False)
class Banded:
    """A quantity with its 95 % band from samples of the model."""

    value: Array
    low: Array  # 2.5 % quantile over the samples that have an equilibrium; NaN where none has
    high: Array  # 97.5 % quantile, likewise

    @classmethod
    def over_samples(cls, values: Array) -> Banded:
        """Compute the band over the samples. Shapes: `values` (n_points, 1 + n_samples, ...)."""
        own, samples = values[:, 0], values[:, 1:] if values.shape[1] > 1 else values
        known = np.isfinite(samples)
        # An order statistic of the finite values; the others are sorted to the end.
        ordered = np.sort(np.where(known, samples, np.inf), axis=1)
        last = np.maximum(known.sum(axis=1, keepdims=True) - 1, 0)
        ends = [np.take_along_axis(ordered, np.rint(level * last).astype(np.intp), axis=1)[:, 0] for level in LEVEL]
        low, high = (np.where(np.isfinite(end), end, np.nan) for end in ends)
        return cls(value=own, low=low, high=high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """Modes over operating points or times; each column follows one mode."""

    poles: Complex
    time_constant: Banded  # shape (n_points, n_modes): Time in which the mode decays to 1/e, s; negative if it grows
    frequency: Banded  # Natural frequency ``|ln z|/(2 pi T)``, Hz
    damping: Banded  # Damping ratio; 1 for a mode that does not oscillate


@dataclass(frozen=True, kw_only=True, eq=False)
class FamilyBands(Described):
    """Gain and modes of a family of linear models, with bands."""

    family: LinearFamily  # Family whose first sample is the model itself; the bands are over the other samples

    ALONG: ClassVar[str]  # Dimension of the dataset
    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "quantities": several(lambda bands: _quantities(bands)),
        "n_samples": attribute(of=lambda bands: bands.family.n_samples - 1),
        "level": attribute(of=lambda _: 0.95),
        "sample_time": attribute(of=attrgetter("family.sample_time")),
        "input_name": attribute(of=attrgetter("family.input_name")),
        "output_name": attribute(of=attrgetter("family.output_name")),
        "input_unit": attribute(of=attrgetter("family.input_unit")),
        "output_unit": attribute(of=attrgetter("family.output_unit")),
    }

    @property
    def operating_inputs(self) -> Array:
        """Constant inputs, in the input's unit, shape (n_points,)."""
        return self.family.operating_inputs

    @cached_property
    def operating_output(self) -> Banded:
        """Output at rest in its unit, arrays of shape (n_points,)."""
        return Banded.over_samples(self.family.operating_outputs)

    @cached_property
    def static_gain(self) -> Banded:
        """G(1), output unit per input unit, arrays of shape (n_points,)."""
        return Banded.over_samples(self.family.static_gains)

    @property
    def stable_share(self) -> Array:
        """Share of the samples with a stable equilibrium, shape (n_points,)."""
        stable = self.family.stable
        return np.asarray((stable[:, 1:] if self.family.n_samples > 1 else stable).mean(axis=1))

    @property
    def stable(self) -> NDArray[np.bool_]:
        """True where the model itself has a stable equilibrium, shape (n_points,)."""
        return np.asarray(self.family.stable[:, 0])

    @cached_property
    def slowest(self) -> Banded:
        """Time constant (n_points,) of the pole nearest to the unit circle, s; negative if this mode grows."""
        poles = self.family.poles
        times = _time_constant(np.abs(poles).max(axis=2, initial=0.0), self.family.sample_time)
        return Banded.over_samples(np.where(self.family.exists, times, np.nan))

    @cached_property
    def modes(self) -> Modes:
        """Time constants, frequencies and damping ratios of the poles, each mode followed over points and samples."""
        poles = _sorted_out(self.family.poles)
        interval = self.family.sample_time
        with np.errstate(divide="ignore", invalid="ignore"):
            continuous = np.log(poles) / interval
            size = np.abs(continuous)
            # A pole at z = 0 is a mode that decays within one sample.
            damping = np.where(np.isinf(size), 1.0, -continuous.real / size)
        return Modes(
            poles=poles[:, 0],
            time_constant=Banded.over_samples(_time_constant(np.abs(poles), interval)),
            frequency=Banded.over_samples(size / (2 * np.pi)),
            damping=Banded.over_samples(damping),
        )

    @property
    def _along(self) -> tuple[Array, str]:
        """Return operating inputs or times, shape (n_points,), and the label of their axis."""
        unit = self.family.input_unit
        return self.operating_inputs, axis_label(f"operating {self.family.input_name}", unit)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the static gain with its band over operating input or time, on `ax` or new axes."""
        axes, (along, label) = axes_or_new(ax), self._along
        factor, unit = _gain_unit(self.family)
        gain = self.static_gain
        axes.fill_between(
            along,
            factor * gain.low,
            factor * gain.high,
            color="C0",
            alpha=0.25,
            linewidth=0,
            label="95 % of the samples" if self.family.n_samples > 1 else None,
        )
        axes.plot(along, factor * gain.value, "o-", color="C0", markersize=3, linewidth=1.2, label="model")
        lost = ~self.stable & self.family.exists[:, 0]
        if lost.any():
            axes.plot(along[lost], factor * gain.value[lost], "x", color="C3", label="unstable")
        axes.set_ylabel(axis_label("static gain", unit))
        axes.set_xlabel(label)
        _legend_above(axes)
        return axes

    def plot_time_constants(self, ax: Axes | None = None) -> Axes:
        """Plot each mode's time constant with its band over operating input or time, on `ax` or new axes."""
        axes, (along, label) = axes_or_new(ax), self._along
        time_constant = self.modes.time_constant
        for number, k in enumerate(_drawn(self.modes.poles)):
            colour = f"C{number}"
            low, middle, high = (
                np.where(values[:, k] > 0.0, values[:, k], np.nan)
                for values in (time_constant.low, time_constant.value, time_constant.high)
            )
            axes.fill_between(along, low, high, color=colour, alpha=0.25, linewidth=0)
            axes.plot(along, middle, "o-", color=colour, markersize=3, linewidth=1.2, label=_mode_name(self.modes, k))
        axes.set_yscale("log")
        axes.axhline(self.family.sample_time, color="0.6", linestyle=":", linewidth=1.0, label="sampling interval")
        numbers_of_decades(axes.yaxis)
        axes.set_ylabel("time constant (s)")
        axes.set_xlabel(label)
        _legend_above(axes)
        return axes

    def plot_poles(self, ax: Axes | None = None) -> Axes:
        """Plot the poles in the z plane on `ax` or new axes, coloured by input or time, with a cloud of samples."""
        from matplotlib.patches import Circle

        axes, (along, label) = axes_or_new(ax), self._along
        poles, samples = self.family.poles, self.family.n_samples
        axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color="0.6", linewidth=1.0))
        colours = np.repeat(along, poles.shape[2])
        limits: dict[str, Any] = {"vmin": float(along.min()), "vmax": float(along.max()), "cmap": "viridis"}
        for sample in range(1, min(samples, 1 + _CLOUD)):
            cloud = poles[:, sample].ravel()
            axes.scatter(cloud.real, cloud.imag, c=colours, s=3, alpha=0.15, linewidths=0, **limits)
        own = poles[:, 0].ravel()
        drawn = axes.scatter(own.real, own.imag, c=colours, s=28, marker="x", linewidths=1.2, **limits)
        axes.figure.colorbar(drawn, ax=axes, label=label)
        axes.set_aspect("equal")
        axes.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], labels=["-1", "-0.5", "0", "0.5", "1"])
        axes.set_yticks([-1.0, -0.5, 0.0, 0.5, 1.0], labels=["-1", "-0.5", "0", "0.5", "1"])
        axes.set_xlabel("Re z")
        axes.set_ylabel("Im z")
        return axes


def _drawn(poles: Complex) -> list[int]:
    """Return the columns to draw: all but those that are everywhere the lower member of a complex pair."""
    lower = (poles.imag < -_REAL) | np.isnan(poles)
    return [k for k in range(poles.shape[1]) if not lower[:, k].all()]


def _mode_name(modes: Modes, k: int) -> str:
    swings = np.abs(modes.poles[:, k].imag) > _REAL
    if not swings.any():
        return "real pole"
    frequency = f"{np.nanmedian(modes.frequency.value[swings, k]):.2g} Hz"
    return f"pair, {frequency}" if swings.all() else f"real, or of a pair ({frequency})"


def _legend_above(ax: Axes) -> None:
    """Put the legend above the axes, where it hides nothing."""
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.01), ncols=2, fontsize="small", frameon=False, borderaxespad=0.0)


def _gain_unit(family: LinearFamily) -> tuple[float, str]:
    """Return the factor and the unit in which a gain is shown."""
    factor, output = _SHOWN.get(family.output_unit, (1.0, family.output_unit))
    unit = f"{output}/{family.input_unit}" if family.input_unit else output
    return factor, written_unit(unit)


def _time_constant(sizes: Array, interval: float) -> Array:
    """Return -T/ln|z|, s: 0 at z = 0, negative outside the unit circle."""
    with np.errstate(divide="ignore"):
        return np.asarray(-interval / np.log(sizes) + 0.0)


def _sorted_out(poles: Complex) -> Complex:
    """Permute the poles so that each column follows one mode over points and samples."""
    from scipy.optimize import linear_sum_assignment

    found = poles.copy()
    before: Complex | None = None
    for point in range(len(found)):
        own = found[point, 0]
        if np.isfinite(own).all():
            if before is None:
                own = own[np.lexsort((-own.imag, -np.abs(own).round(9)))]
            else:
                own = own[linear_sum_assignment(np.abs(before[:, None] - own))[1]]
            found[point, 0] = before = own
        for sample in range(1, found.shape[1]):
            here = found[point, sample]
            if before is not None and np.isfinite(here).all():
                found[point, sample] = here[linear_sum_assignment(np.abs(before[:, None] - here))[1]]
    return found


def _quantities(bands: FamilyBands) -> Variables:
    """Return gain, modes and stability at all operating points or times."""
    family, modes, along = bands.family, bands.modes, bands.ALONG
    each = (along, "mode")
    quantities = (
        ("operating_output", along, bands.operating_output, family.output_unit, "output at rest"),
        ("static_gain", along, bands.static_gain, gain_unit(family), "G(1)"),
        ("slowest", along, bands.slowest, "s", "time constant of the slowest mode"),
        ("time_constant", each, modes.time_constant, "s", "in which a mode decays to 1/e"),
        ("frequency", each, modes.frequency, "Hz", "natural frequency of a mode"),
        ("damping", each, modes.damping, "", "damping ratio of a mode"),
    )
    variables: dict[str, Any] = {
        "stable": (along, bands.stable, "", "whether the model has a stable equilibrium"),
        "stable_share": (along, bands.stable_share, "", "share of the samples with a stable equilibrium"),
        "pole": (each, modes.poles, "", "pole in the z plane"),
    }
    for name, dims, banded, unit, meaning in quantities:
        variables[name] = (dims, banded.value, unit, meaning)
        variables[f"{name}_low"] = (dims, banded.low, unit, "2.5 % quantile over the samples")
        variables[f"{name}_high"] = (dims, banded.high, unit, "97.5 % quantile over the samples")
    return variables
