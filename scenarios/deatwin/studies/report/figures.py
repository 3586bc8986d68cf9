"""Draw the figures of a diagnosis, and return their data as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.mismatch import Diagnosis, LocationSummary
from deatwin.ident.mismatch.layout import Stretch, laid_out, stretches_of_true
from deatwin.ident.mismatch.located import Window
from deatwin.ident.mismatch.quality.quality import OF_READING
from deatwin.ident.mismatch.result import Fault
from deatwin.plant.amplitudes import axis_label, reported_size, written_unit
from deatwin.plant.drawing import Axes, envelope, numbers_of_decades
from deatwin.plant.prefixes import prefixed
from deatwin.plant.words import spaced
from deatwin.studies.report.drawing import COLOURS, Drawing, draw, inline

Array = np.ndarray
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
PER_DECADE = 20  # Points per decade of a smoothed spectrum
ZOOM_SHARE, ZOOM_SAMPLES = 1 / 30, 250
ROOM = 0.14  # Share of the residual's range that is left above it for the shares of the mismatch
WRITTEN = 0.06  # Share of the time axis from which on there is room for the share of a stretch
LEAST_SHARE = 0.05  # Share of the mismatch below which a stretch of time is not listed


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """Data from which all figures are drawn."""

    tracks: tuple[Stretch, ...]
    amendment: str
    unit: str
    reading: str
    command: str
    time: str
    noise: float
    located: LocationSummary | None

    @property
    def models(self) -> list[tuple[str, str, str]]:
        """For each simulation: attribute of a track, label and colour."""
        base = ("base", "calibrated model", BEFORE)
        return [base, ("amended", f"with {self.amendment}", AFTER)] if self.amendment else [base]


def drawings(diagnosis: Diagnosis) -> tuple[list[Drawing], dict[str, dict[str, Array]]]:
    """Draw the figures of a diagnosis."""
    if diagnosis.readings is None:
        return [], {}
    name, unit = diagnosis.output.name, diagnosis.output.unit
    record = diagnosis.readings.experiments[0].recordings[0]
    size = reported_size(unit, record.output_units[0])
    tracks = laid_out(diagnosis.readings, size)
    shown = written_unit(unit)
    input_unit = f" ({record.input_units[0]})" if record.input_units[0] not in ("", "1") else ""
    view = _View(
        tracks=tracks,
        amendment=_amendment(diagnosis) if tracks[0].amended is not None else "",
        unit=shown,
        reading=f"{name} ({shown})" if shown else name,
        command=f"{spaced(record.input_names[0])}{input_unit}",
        time="time (s)" if tracks[-1].experiment == 1 else "time, experiments one after another (s)",
        noise=diagnosis.noise,
        located=diagnosis.location,
    )
    suffix = f"_{unit}" if unit else ""
    spectrum = _spectrum(view, suffix)
    files = {"figures/time.csv": _time_columns(view, suffix), "figures/frequency.csv": spectrum}
    others = _further(diagnosis, view)
    files |= {f"figures/time_{name}.csv": _time_columns(one, f"_{one.unit}") for name, one in others.items()}
    faults = diagnosis.faults if diagnosis.verdict.value == "data_fault" else ()
    drawn = [_residual(view), _frequency(view, list(spectrum.values())), _zoom(view, faults), _whole(view)]
    return [*drawn, *(_residual(one, name) for name, one in others.items())], files


def _further(diagnosis: Diagnosis, view: _View) -> dict[str, _View]:
    """Return the data for the figure of each further reading, in a unit with a suitable prefix."""
    known = {reading.reading: reading for reading in diagnosis.taught or ()}
    found = {}
    for one in diagnosis.further:
        size, unit = prefixed(known[one.reading].noise, known[one.reading].unit)
        found[one.reading] = replace(view, tracks=laid_out(one, size), unit=unit, located=None)
    return found


def _amendment(diagnosis: Diagnosis) -> str:
    """Describe the added effects briefly, for a legend."""
    names = [spaced(cause.effect) for cause in diagnosis.causes]
    if not names and diagnosis.free_form is not None:
        return "the fitted formula"
    return " and ".join(names) if 0 < len(names) < 3 else "the amendments"


def _residual(view: _View, further: str = "") -> Drawing:
    """Draw the residual over time with and without the effects, on one scale, for the first or a further reading."""
    rows = len(view.models)
    with draw((6.4, 2.0 + 1.2 * rows)) as figure:
        panels = figure.subplots(rows, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, (name, label, colour) in zip(panels, view.models, strict=True):
            for track in view.tracks:
                axes.plot(*envelope(track.axis, track.measured - getattr(track, name)), color=colour, linewidth=0.7)
            axes.set_title(label, loc="left", fontsize="medium", color=colour)
            axes.axhline(0, color=INK, linewidth=0.6)
            axes.margins(y=ROOM)
            _shade(axes, view)
        _mark(panels[0], view)
        figure.supylabel(axis_label("measured − simulated", view.unit), fontsize="medium")
        panels[-1].set_xlabel(view.time)
        handles = panels[0].get_legend_handles_labels()
        if handles[0]:
            legend = figure.legend(*handles, loc="outside upper left", ncols=2)
            for patch in legend.get_patches():  # patches as pale as on the axes could not be seen on a dark page
                patch.set_alpha(0.5)
        name, which = f"residual_{further}" if further else "residual", spaced(further) or "reading"
        title = f"Residual of the {which} over time" if further else "Residual over time"
        svg = inline(figure, name, title)
    caption = f"Measured minus simulated {which}. Grey marks held-out data, to which no parameter was fitted."
    if any("mismatch" in text for text in handles[1]):
        caption += (
            " Ochre marks the intervals in which the residual exceeds sensor noise and model error. Numbers are shares of the "
            "mismatch, and an interval with a larger share is darker."
        )
    data = f"figures/time_{further}.csv" if further else "figures/time.csv"
    return Drawing(name=name, title=title, caption=caption, svg=svg, data=data)


def _shade(axes: Axes, view: _View) -> None:
    label = "held out"
    for track in view.tracks:
        for first, last in stretches_of_true(track.unseen):
            end = track.axis[last - 1] + track.sample_time
            axes.axvspan(track.axis[first], end, color=MEASURED, alpha=0.14, linewidth=0, label=label)
            label = "_held out"
    label = "where the mismatch lies"
    for window in _windows(view):
        strength = 0.32 * min(1.0, max(0.1, window.score))
        axes.axvspan(window.from_s, window.to_s, color=MARK, alpha=strength, linewidth=0, label=label)
        label = "_mismatch"


def _mark(axes: Axes, view: _View) -> None:
    """Draw a bar over each stretch with a mismatch, and write its share, so that colours alone need not tell them."""
    edge, whole = axes.get_xaxis_transform(), view.tracks[-1].axis[-1] - view.tracks[0].axis[0]
    for window in _windows(view):
        if window.score < LEAST_SHARE:
            continue
        ends = np.array([window.from_s, window.to_s])
        axes.plot(ends, [1, 1], color=MARK, marker="|", markersize=8, linewidth=2.5, clip_on=False, transform=edge)
        if np.ptp(ends) >= WRITTEN * whole:
            share = f"{100 * window.score:.0f} %"
            axes.text(ends.mean(), 0.97, share, ha="center", va="top", fontsize="small", transform=edge)


def _windows(view: _View) -> tuple[Window, ...]:
    """Return the stretches of time with a mismatch, if their clock tells the experiment."""
    several = view.tracks[-1].experiment > 1
    return () if several or view.located is None else view.located.time


def _frequency(view: _View, columns: Sequence[Array]) -> Drawing:
    frequency, *densities = columns
    with draw((6.4, 3.6)) as figure:
        axes = figure.add_subplot()
        for (_, label, colour), density in zip(view.models, densities, strict=False):
            axes.plot(frequency, density, color=colour, label=label, linewidth=1.4)
        floor = view.noise * np.sqrt(2 * view.tracks[0].sample_time)
        axes.axhline(floor, color=INK, linestyle=":", label="sensor noise")
        low, high = frequency[0], frequency[-1]
        for band in () if view.located is None else view.located.frequency:
            if band.to_Hz > low:
                axes.axvspan(max(band.from_Hz, low), min(band.to_Hz, high), color=MARK, alpha=0.18, linewidth=0)
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="frequency (Hz)",
            ylabel=axis_label("residual", f"{view.unit}/√Hz" if view.unit else "1/√Hz"),
            xlim=(low, high),
        )
        for axis in (axes.xaxis, axes.yaxis):
            numbers_of_decades(axis, 300.0)
        figure.legend(loc="outside upper left", ncols=3)
        caption = (
            "Amplitude spectral density of the residual (measured minus simulated). In the ochre bands, the residual exceeds "
            "the sensor noise."
        )
        return Drawing.of(figure, "frequency", "Residual over frequency", caption)


def _spectrum(view: _View, suffix: str) -> dict[str, Array]:
    """Return Welch's estimate over all long records, averaged in logarithmic frequency bins."""
    from scipy.signal import welch

    longest = max(track.measured.size for track in view.tracks)
    segment = min(4096, longest // 2)
    used = [track for track in view.tracks if track.measured.size >= segment]
    columns: dict[str, Array] = {}
    for name, _, _ in view.models:
        total: Array | float = 0.0
        for track in used:
            frequency, density = welch(
                track.measured - getattr(track, name), 1 / track.sample_time, nperseg=segment, detrend=False
            )
            total = total + density * track.measured.size
        weight = sum(track.measured.size for track in used)
        columns["frequency_Hz"], smooth = _smooth(frequency[1:], np.asarray(total)[1:] / weight)
        columns[f"{name}{suffix}_per_sqrtHz"] = np.sqrt(smooth)
    return columns


def _smooth(frequency: Array, density: Array) -> tuple[Array, Array]:
    bins = np.round(PER_DECADE * np.log10(frequency)).astype(int)
    _, place, counts = np.unique(bins, return_inverse=True, return_counts=True)
    return np.bincount(place, frequency) / counts, np.bincount(place, density) / counts


def _zoom(view: _View, faults: Sequence[Fault] = ()) -> Drawing:
    """Draw a stretch with its residual and the command: around the largest fault, or with the largest residual."""
    faulty = _faulty(view.tracks, faults)
    track, first, last = faulty or _worst(view.tracks)
    part = slice(first, last)
    with draw((6.4, 4.6)) as figure:
        upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1.3))
        upper.plot(track.clock[part], track.measured[part], ".", markersize=2.5, color=MEASURED, label="measured")
        for name, label, colour in view.models:
            simulated = getattr(track, name)[part]
            upper.plot(track.clock[part], simulated, color=colour, label=label, linewidth=1.4)
            middle.plot(track.clock[part], track.measured[part] - simulated, color=colour, linewidth=0.9)
        middle.axhline(0, color=INK, linewidth=0.6)
        upper.set_ylabel(view.reading)
        middle.set_ylabel(axis_label("residual", view.unit))
        lower.step(track.clock[part], track.command[part], where="post", color=INK)
        lower.set(xlabel="time (s)", ylabel=view.command)
        figure.align_ylabels()
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        svg = inline(figure, "zoom", "Part of the recording, with the simulations")
    which = "held-out" if track.unseen[part].any() else "fitted"
    caption = f"The part of the {which} data in which the calibrated model has its largest error."
    if faulty:
        caption = "The part of the recording with the largest number of faulty samples."
    if view.tracks[-1].experiment > 1:
        caption += f" Experiment {track.experiment}."
    return Drawing(name="zoom", title="A closer look", caption=caption, svg=svg, data="figures/time.csv")


def _faulty(tracks: Sequence[Stretch], faults: Sequence[Fault]) -> tuple[Stretch, int, int] | None:
    """Return the stretch around the reading's fault with the most samples, by first and last-plus-one sample."""
    # Only the first reading is drawn, and only its faults decide the verdict.
    fault = max((one for one in faults if one.fault in OF_READING), key=lambda one: one.samples, default=None)
    if fault is None:
        return None
    own = [track for track in tracks if track.experiment == fault.experiment]
    if fault.recording > len(own):
        return None
    track = own[fault.recording - 1]
    first, last = np.searchsorted(track.clock, [fault.from_s, fault.to_s])
    beside = max(ZOOM_SAMPLES - (last - first), last - first) // 2
    return track, max(int(first - beside), 0), min(int(last + beside) + 1, track.clock.size)


def _worst(candidates: Sequence[Stretch]) -> tuple[Stretch, int, int]:
    """Return the stretch, by first and last-plus-one sample, with the largest residual in the held-out data."""
    found = []
    has_unseen = any(track.unseen.any() for track in candidates)
    for track in candidates:
        n = track.measured.size
        width = min(n, max(ZOOM_SAMPLES, round(n * ZOOM_SHARE)))
        square = np.where(track.unseen | (not has_unseen), (track.measured - track.base) ** 2, 0)
        sums = np.concatenate([[0.0], np.cumsum(square)])
        means = (sums[width:] - sums[:-width]) / width
        first = int(np.argmax(means))
        found.append((means[first], (track, first, first + width)))
    return max(found, key=lambda one: one[0])[1]


def _whole(view: _View) -> Drawing:
    with draw((6.4, 4.0)) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        for place, track in enumerate(view.tracks):
            hidden = "_" * bool(place)  # from the legend, which names each curve once
            label = f"{hidden}measured"
            upper.plot(*envelope(track.axis, track.measured), color=MEASURED, label=label, linewidth=2.2)
            for name, text, colour in view.models:
                label = f"{hidden}{text}"
                upper.plot(*envelope(track.axis, getattr(track, name)), color=colour, label=label, linewidth=0.7)
            lower.plot(*envelope(track.axis, track.command), color=INK, linewidth=0.7)
        upper.set_ylabel(view.reading)
        lower.set(xlabel=view.time, ylabel=view.command)
        figure.align_ylabels()
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        svg = inline(figure, "whole", "All recordings and the simulations")
    caption = (
        "All recordings and their simulations. The simulations receive only the command. Where curves agree, the one drawn "
        "last hides the others."
    )
    return Drawing(name="whole", title="All recordings", caption=caption, svg=svg, data="figures/time.csv")


def _time_columns(view: _View, suffix: str) -> dict[str, Array]:
    """Return every sample of every record, with readings rounded to the resolution of a sensor."""
    scale = max(float(np.nanmax(t.measured) - np.nanmin(t.measured)) for t in view.tracks) or 1.0
    digits = max(0, 6 - int(np.floor(np.log10(scale))))
    columns = {
        "experiment": np.concatenate([np.full(t.clock.size, t.experiment) for t in view.tracks]),
        "time_s": np.concatenate([t.clock for t in view.tracks]).round(9),
        "command": np.concatenate([t.command for t in view.tracks]).round(9),
        "unseen": np.concatenate([t.unseen for t in view.tracks]).astype(int),
    }
    for name in ("measured", *(name for name, _, _ in view.models)):
        columns[f"{name}{suffix}"] = np.concatenate([getattr(t, name) for t in view.tracks]).round(digits)
    return columns
