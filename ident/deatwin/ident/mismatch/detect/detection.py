"""Result of the test whether anything is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from operator import attrgetter
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.detect.origin import Origin
from deatwin.ident.mismatch.quality.noise import NoiseFloor
from deatwin.ident.mismatch.result import DetectionSummary, OriginSummary, Repeatability, Statistic
from deatwin.ident.mismatch.thresholds import SIGNIFICANCE
from deatwin.plant.amplitudes import amount, amplitude_unit, written_amplitude
from deatwin.plant.datasets import (
    Described,
    Metadata,
    Variables,
    attribute,
    columns,
    coordinate,
    several,
    squared,
    table_along,
    variable,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.mismatch.naming.screen import LinearisedResponse


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Curves that a plot of a detection shows."""

    frequency: np.ndarray  # (f,), Hz
    spectrum: np.ndarray  # (f,), of the residual, SI squared over Hz
    noise: float  # power density of the sensor noise, as white noise, SI squared over Hz
    lines: np.ndarray  # (l,), frequencies of the periodogram, Hz
    cumulated: np.ndarray  # (l,), cumulative periodogram
    expected: np.ndarray  # (l,), mean cumulative periodogram if nothing is missing
    distance: float  # half width of the 99 % band about `expected`
    regressors: tuple[str, ...]  # names of the signals with which the residual is correlated
    correlations: np.ndarray  # (r,), each divided by its standard deviation under chance
    bound: float  # half width of the 99 % band of all correlations together


def _detectable(found: Detection) -> Variables:
    listed = [{"size": size, "effect": name} for name, size in found.smallest.items()]
    return columns("detectable", listed, {"size": found.output_unit})


def _density(found: Detection) -> str:
    return f"{squared(found.output_unit)}/Hz" if found.output_unit else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection(Described):
    """Result of the test whether physics is missing from a calibrated plant, and the smallest detectable effects.

    Parameters
    ----------
    p_value : float
        p-value of all statistics together, for the hypothesis that nothing is missing. A bootstrap computes this value,
        so it is at least 1 / (number of draws + 1).
    statistics : tuple of Statistic
        One result for each group of statistics of the residual: variance ratio, cumulative periodogram, correlation
        with the command, and correlation of the squared residual with the command.
    size : float
        Rms residual beyond the sensor noise, SI: the larger of the values on fitted and on held-out data.
    practical : float
        Smallest `size` that counts as missing physics, SI.
    noise, model_error : float
        Sensor noise and model error, rms, SI.
    certain : bool
        True if the residual on fitted or on held-out data is so large that it proves a mismatch, whatever the p-value.
    taken_up : Calibration or None
        Fit of the plant to all data, if this fit leaves no mismatch; else None.
    sensor : NoiseFloor
        Sensor noise, with the estimate from each source, such as the data sheet or repeated commands.
    repeatability : Repeatability or None
        Similarity of the residual between repeats of a command; None if no command is repeated.
    evidence : OriginSummary
        Evidence on whether the residual comes from the plant or from a disturbance.
    moved : float
        Rms response of the simulated readings to the changes of the command, SI.
    visible : bool
        True if at least one effect could be detected at a strength within its range, or if this was not computed.
    seen : callable or None
        Function that computes `smallest` and `visible` from the linearised responses of effects; None once they are
        computed.
    smallest : mapping of str to float or None
        For each effect, the rms change of the readings at which it is detected with a probability of 90 %, SI. None if
        a refit of the parameters absorbs the effect completely.
    output_unit : str
        SI unit of the readings.
    curves : Curves
        Curves for the plots.
    """

    p_value: float = field(metadata=attribute())
    statistics: tuple[Statistic, ...] = field(metadata=table_along("statistic"))
    size: float = field(metadata=attribute())
    practical: float = field(metadata=attribute())
    noise: float = field(metadata=attribute())
    model_error: float = field(metadata=attribute())
    certain: bool
    sensor: NoiseFloor
    repeatability: Repeatability | None
    evidence: OriginSummary
    moved: float = field(metadata=attribute())
    visible: bool = True
    seen: Callable[[Sequence[LinearisedResponse]], tuple[dict[str, float | None], bool]] | None = None
    smallest: Mapping[str, float | None] = field(default_factory=dict)
    output_unit: str = "m"
    curves: Curves
    taken_up: Calibration | None = None

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "detectable": several(_detectable),
        "spectrum": variable("frequency", of=attrgetter("curves.spectrum"), unit=_density),
        "cumulated": variable("line", of=attrgetter("curves.cumulated")),
        "expected": variable("line", of=attrgetter("curves.expected")),
        "correlation": variable("regressor", of=attrgetter("curves.correlations")),
        "frequency": coordinate("frequency", of=attrgetter("curves.frequency"), unit="Hz"),
        "line": coordinate("line", of=attrgetter("curves.lines"), unit="Hz"),
        "regressor": coordinate("regressor", of=lambda found: np.array(found.curves.regressors, dtype=str)),
        "units": attribute(of=attrgetter("output_unit")),
    }

    def beside(self, known: Sequence[LinearisedResponse]) -> Detection:
        """Return the same result, with ``smallest`` and ``visible`` computed.

        Parameters
        ----------
        known : sequence of LinearisedResponse
            Linearised response of each effect on the fitted data.

        Returns
        -------
        Detection
        """
        if self.seen is None:
            return self
        smallest, visible = self.seen(known)
        return replace(self, smallest=smallest, visible=visible, seen=None)

    @property
    def mismatch(self) -> bool:
        """True if the plant lacks physics.

        The mismatch is then either significant and large enough to count, or certain by its size alone. In both cases
        it remains when the plant is fitted to all data.
        """
        return counts(self.p_value, self.size, self.practical, self.certain) and self.taken_up is None

    @property
    def testable(self) -> bool:
        """True if these recordings can show a mismatch at all.

        The changes of the command must change the readings by more than noise and model error, and at least one effect
        must be detectable.
        """
        return self.moved > float(np.hypot(self.noise, self.model_error)) and self.visible

    @property
    def origin(self) -> Origin:
        """Conclusion from ``evidence``: the residual comes from the plant, or from a disturbance, or is undecided."""
        return Origin(self.evidence.conclusion)

    @property
    def disturbance(self) -> bool:
        """True if there is a mismatch that does not come from the plant: ``origin`` is ``DISTURBANCE``."""
        return self.mismatch and self.origin is Origin.DISTURBANCE

    @property
    def summary(self) -> DetectionSummary:
        """Summarise the result for a diagnosis, with amplitudes in the unit of `Diagnosis.output`."""
        size = amplitude_unit(self.output_unit)[1]
        return DetectionSummary(
            p_value=self.p_value,
            excess=self.size / size,
            practical=self.practical / size,
            taken_up=self.taken_up is not None,
            moved=self.moved / size,
            smallest_detectable={k: None if v is None else v / size for k, v in self.smallest.items()},
            statistics=self.statistics,
            noise_source=self.sensor.source.name.lower(),
            repeatability=self.repeatability,
            origin=replace(self.evidence, left=self.evidence.left / size),
        )

    def plot(self, ax: Sequence[Axes] | None = None) -> Sequence[Axes]:
        """Draw spectrum, cumulative periodogram and correlations of the residual, with the 99 % ranges of noise alone.

        Parameters
        ----------
        ax : sequence of three matplotlib Axes, optional
            Axes to draw on; a new figure by default.

        Returns
        -------
        sequence of three matplotlib Axes
        """
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.subplots(1, 3, figsize=(13, 3.8), layout="constrained")[1]
        _spectrum(self, ax[0])
        _cumulated(self, ax[1])
        _correlations(self, ax[2])
        return ax


def counts(p_value: float, size: float, practical: float, certain: bool) -> bool:
    """Return whether an excess is beyond chance and of `practical` size, or `certain` by its size alone."""
    return (p_value < SIGNIFICANCE and size >= practical) or certain


def _spectrum(detection: Detection, axes: Axes) -> None:
    curves, (unit, size) = detection.curves, written_amplitude(detection.output_unit)
    axes.loglog(curves.frequency, curves.spectrum / size**2, color="C0", linewidth=1.2, label="residual")
    axes.axhline(curves.noise / size**2, color="0.4", linestyle="--", linewidth=1, label="sensor noise")
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel(f"power density ({f'{unit}²' if unit else 1}/Hz)")
    axes.set_title(
        f"error beyond sensor noise: {amount(f'{detection.size / size:.3g}', unit)} rms (counts as a mismatch from "
        f"{amount(f'{detection.practical / size:.3g}', unit)})",
        fontsize="small",
        loc="left",
    )
    axes.legend(fontsize="small")


def _cumulated(detection: Detection, axes: Axes) -> None:
    curves = detection.curves
    low, high = (np.clip(curves.expected + s * curves.distance, 0.0, 1.0) for s in (-1, 1))
    axes.fill_between(curves.lines, low, high, color="0.88", label="99 % range of noise alone")
    axes.plot(curves.lines, curves.expected, color="0.5", linewidth=0.8)
    axes.plot(curves.lines, curves.cumulated, color="C0", linewidth=1.2, label="residual")
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("cumulative periodogram")
    axes.set_title(f"all statistics together: p = {detection.p_value:.2g}", fontsize="small", loc="left")
    axes.legend(fontsize="small", loc="lower right")


def _correlations(detection: Detection, axes: Axes) -> None:
    curves = detection.curves
    groups = [name if " ago" not in name else name.rsplit(" ", 3)[0] for name in curves.regressors]
    places = np.arange(len(groups))
    outside = np.abs(curves.correlations) > curves.bound
    axes.axhspan(-curves.bound, curves.bound, color="0.88", zorder=0, label="99 % range of noise alone")
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    for chosen, colour in ((~outside, "C0"), (outside, "C3")):
        axes.vlines(places[chosen], 0.0, curves.correlations[chosen], color=colour, linewidth=1.5)
    edges = [0, *(k for k in places[1:] if groups[k] != groups[k - 1]), len(groups)]
    middles = [(a + b - 1) / 2 for a, b in pairwise(edges)]
    written = [groups[k].replace("time", "t").replace("^2", "²").replace("^3", "³") for k in edges[:-1]]
    axes.set_xticks(middles, written)
    axes.tick_params(axis="x", length=0)
    for k in edges[1:-1]:
        axes.axvline(k - 0.5, color="0.8", linewidth=0.6)
    reach = 1.15 * max(1.3 * curves.bound, float(np.abs(curves.correlations).max()))
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("time t, command u, and its rate of change u'")
    axes.set_ylabel("correlation / standard deviation")
    axes.legend(fontsize="small", loc="upper right")
