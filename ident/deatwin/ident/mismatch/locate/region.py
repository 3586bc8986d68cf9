"""Location of the mismatch in the operating region."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from operator import attrgetter
from types import MappingProxyType

import numpy as np
from scipy.special import ndtr

from deatwin.ident.mismatch.locate.track import Track
from deatwin.ident.mismatch.located import Region
from deatwin.ident.mismatch.thresholds import CHANCE, DEVIATIONS, SETTLING_SECONDS, TINY
from deatwin.ident.soundness import samples_in
from deatwin.plant.datasets import Described, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.words import spaced

BINS = 12
BRANCH, SINCE_REST = "branch", "time_since_rest"
"""Signals that are derived from others: 1 where the reading rises and -1 where it falls; and the time since the command
last rested, s."""
RATE = "_rate"


@dataclass(frozen=True, kw_only=True, eq=False)
class Bin:
    """Mean residual in one bin of a signal."""

    signal: str
    number: int
    low: float  # like `high`, in the unit of the signal
    high: float
    mean: float = field(metadata=variable(unit=attrgetter("unit"), about="mean residual"))
    deviation: float = field(metadata=variable(unit=attrgetter("unit"), about="standard error of the mean"))
    count: int = field(metadata=variable(unit="samples"))
    p_value: float  # of the hypothesis that the mean is zero


@dataclass(frozen=True, kw_only=True, eq=False)
class Regions(Described):
    """The ranges of the operating signals that hold the mismatch; it iterates over them."""

    regions: tuple[Region, ...] = field(metadata=table_along("region"))  # the largest mean residual first
    bins: tuple[Bin, ...] = field(metadata=table_along("bin"))  # all that were tested, signal by signal
    unit: str = ""  # unit of the residual, as axes show it

    def __iter__(self) -> Iterator[Region]:
        return iter(self.regions)

    def __len__(self) -> int:
        return len(self.regions)

    def plot(self, ax: Axes | None = None, units: Mapping[str, str] = MappingProxyType({})) -> Axes:
        """Draw the mean residual over each signal, from its lowest to its highest value, with two standard errors."""
        ax = axes_or_new(ax)
        for name, marker in zip(dict.fromkeys(one.signal for one in self.bins), cycle("osD^vP"), strict=False):
            bins = [one for one in self.bins if one.signal == name]
            low, span = bins[0].low, bins[-1].high - bins[0].low
            at = [((one.low + one.high) / 2 - low) / span for one in bins]
            ax.errorbar(
                at,
                [one.mean for one in bins],
                [DEVIATIONS * one.deviation for one in bins],
                marker=marker,
                markersize=3,
                linewidth=1,
                capsize=2,
                label=_legend(name, low, low + span, "s" if name == SINCE_REST else units.get(name, "")),
            )
        ax.axhline(0.0, color="0.4", linewidth=0.8, linestyle="--")
        ax.set_xlim(-0.05, 1.05)
        ax.set_xlabel("signal, scaled from 0 (lowest value) to 1 (highest value)")
        ax.set_ylabel(f"mean residual ({self.unit})" if self.unit else "mean residual")
        ax.legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        return ax


def _legend(name: str, low: float, high: float, unit: str) -> str:
    """Return the name of a signal with its range."""
    if name == BRANCH:
        return "reading: falling (left) or rising (right)"
    lowest, highest = (f"{float(f'{end:.3g}'):g}" for end in (low, high))
    said = "time since the command was constant" if name == SINCE_REST else spaced(name)
    return f"{said}: {lowest} to {highest} {unit}".rstrip()


def locate_region(tracks: Sequence[Track], unit: float) -> Regions:
    """Return ranges of operating signals in which the mean residual, over `unit`, SI, is not 0, the largest first."""
    # Each signal is cut into bins of equal counts; their means are tested with one independent value a second and a
    # false-discovery rate of 5 % over all bins of all signals (Benjamini & Hochberg, J. R. Stat. Soc. B 57 (1995) 289,
    # doi:10.1111/j.2517-6161.1995.tb02031.x). Neighbours of one sign are joined.
    from scipy.stats import false_discovery_control

    residual = np.concatenate([t.residual for t in tracks]) / unit
    # The clocks of several experiments overlap, so seconds of different records are kept apart.
    seconds = np.concatenate([np.floor(t.timepts) + 1e9 * k for k, t in enumerate(tracks)])
    operating = [_signals(track) for track in tracks]
    bins = [
        one
        for name in operating[0]
        for one in _bins(name, np.concatenate([signals[name] for signals in operating]), residual, seconds)
    ]
    passed = false_discovery_control([one.p_value for one in bins]) <= CHANCE
    regions: list[Region] = []
    last, weight = ("", -2), 0
    for one, good in zip(bins, passed, strict=True):
        if not good:
            continue
        mean, low, count = one.mean, one.low, one.count
        if last == (one.signal, one.number - 1) and regions[-1].mean_residual * mean > 0:
            merged = regions.pop()
            mean = (weight * merged.mean_residual + count * mean) / (weight + count)
            low = merged.low
            count += weight
        regions.append(Region(signal=one.signal, low=low, high=one.high, mean_residual=mean))
        last, weight = (one.signal, one.number), count
    # A mean residual of one sign over the whole range of a signal does not depend on that signal.
    ends = {one.signal: one.high for one in bins}
    starts = {one.signal: one.low for one in reversed(bins)}
    found = [r for r in regions if (r.low, r.high) != (starts[r.signal], ends[r.signal])]
    return Regions(regions=tuple(sorted(found, key=lambda r: -abs(r.mean_residual))), bins=tuple(bins))


def _signals(track: Track) -> Mapping[str, np.ndarray]:
    """Return the track's signals, the branch of the motion, and the time since the command last rested."""
    made = {}
    rate = next((values for name, values in track.signals.items() if name.endswith(RATE)), None)
    if rate is not None:
        made[BRANCH] = np.where(rate > 0, 1.0, -1.0)
    command = next(iter(track.signals.values()), None)
    if command is not None and len(track.signals) > 1:
        made[SINCE_REST] = _since_rest(command, track.sample_time)
    return {**track.signals, **made}


def _since_rest(command: np.ndarray, sample_time: float) -> np.ndarray:
    """Return the time since a command last rested or, before its first rest, since the record began, s."""
    samples = np.arange(command.size)
    moved = np.concatenate([[True], np.diff(command) != 0])
    still = samples - np.maximum.accumulate(np.where(moved, samples, 0))
    resting = still >= samples_in(SETTLING_SECONDS, sample_time)
    return sample_time * (samples - np.maximum.accumulate(np.where(resting, samples, 0)))


def _bins(name: str, values: np.ndarray, residual: np.ndarray, seconds: np.ndarray) -> list[Bin]:
    """Return bins of equal counts, or one bin per value if a signal has few values."""
    distinct = np.unique(values)
    if 1 < distinct.size <= BINS:
        between = (distinct[1:] + distinct[:-1]) / 2
        edges = np.concatenate([distinct[:1], between, distinct[-1:]])
    else:
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
    if edges.size < 3:
        return []
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    found = []
    for number in range(edges.size - 1):
        inside = index == number
        mean, deviation, p_value = _mean_test(residual[inside], seconds[inside])
        found.append(
            Bin(
                signal=name,
                number=number,
                low=float(edges[number]),
                high=float(edges[number + 1]),
                mean=mean,
                deviation=deviation,
                count=int(inside.sum()),
                p_value=p_value,
            )
        )
    return found


def _mean_test(values: np.ndarray, seconds: np.ndarray) -> tuple[float, float, float]:
    """Return the mean, its standard error and two-sided p-value, from the scatter of the means of whole seconds."""
    _, inverse = np.unique(seconds, return_inverse=True)
    means = np.bincount(inverse, weights=values) / np.bincount(inverse)
    if means.size < 3:
        return float(values.mean()) if values.size else 0.0, 0.0, 1.0
    deviation = means.std(ddof=1) / np.sqrt(means.size) + TINY
    return float(values.mean()), float(deviation), float(2 * ndtr(-abs(means.mean()) / deviation))
