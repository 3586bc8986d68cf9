"""The figures of the story, after figures 2.5 to 2.8 of the thesis, and of the counter-evidence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.curves import linear_share, local_gain, mean_curve, straight_line
from deatwin.ident.drifts import at_same_input, fast_part, moving_mean
from deatwin.scenarios.thesis_data.counterevidence import SideBands, SmallVoltages
from deatwin.scenarios.thesis_data.study import LOOP_RATE, Bench, Study
from deatwin.scenarios.thesis_data.verdicts import RIDGE
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw
from deatwin.studies.report.tracks import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
WINDOW, SHORT = 100.0, 20.0
"""Of the moving means, s."""
ZOOM = 40.0
"""Of the excitation that is drawn, s."""
SPECIFIED, ELASTIC = "specification", "without hysteresis"
COMMAND, DISPLACEMENT = "command (V)", "displacement (mm)"


def drawings(
    study: Study, rests: Mapping[str, SmallVoltages], bands: SideBands, step: float
) -> tuple[list[Drawing], dict[str, Columns]]:
    """Draw all figures."""
    made = [
        _excitation(study.benches[0]),
        _curve(study.benches[-1]),
        _recordings(study.benches),
        _drifts(study.benches),
        _ridge(study.benches[0]),
        _spectra(study.benches),
        _loops(study.benches),
        _areas(study),
        _small(rests, step),
        _side_bands(bands),
    ]
    return [drawing for drawing, _ in made], {drawing.data: columns for drawing, columns in made}


def _excitation(bench: Bench) -> tuple[Drawing, Columns]:
    record = bench.recording
    u, step = record.inputs[0], record.sample_time
    share = linear_share(u, record.outputs[0], step)
    part = slice(0, round(ZOOM / step))
    with draw((9.6, 3.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        left.step(record.timepts[part], u[part], where="post", color=AFTER)
        for limit in (1.1, 3.75):
            left.axhline(limit, color=INK, linestyle=":", linewidth=0.9)
        left.set(xlabel="time (s)", ylabel=COMMAND, ylim=(0.9, 3.95))
        right.plot(share.frequencies, share.inputs, color=AFTER)
        right.set(xlabel="frequency (Hz)", ylabel="spectral density (V²/Hz)", yscale="log", xlim=(0, 5), ylim=(1e-7, 2))
        drawing = Drawing.of(
            figure,
            "excitation",
            "Excitation and its spectrum (thesis figure 2.5)",
            f"{bench.actuator.name}, the first {ZOOM:.0f} s. Dotted: the limits. Clipping at them, and nothing else, "
            f"puts {100 * share.above(1.0)[0] / share.above(0.0)[0]:.2f} % of the power above 1 Hz.",
        )
    return drawing, {"frequency_Hz": share.frequencies, "density_V2_per_Hz": share.inputs}


def _curve(bench: Bench) -> tuple[Drawing, Columns]:
    u, y = bench.recording.inputs[0], 1e3 * bench.recording.outputs[0]
    levels, means = mean_curve(u, y)
    line = straight_line(levels, means)
    ends = np.array([levels[0], 2.9])
    with draw((6.4, 4.0)) as figure:
        axes = figure.add_subplot()
        axes.plot(u[::20], y[::20], ".", markersize=1.5, color=MEASURED, label="readings")
        axes.plot(levels, means, color=AFTER, linewidth=1.8, label="mean at each command")
        axes.plot(ends, line.offset + line.gain * ends, "--", color=BEFORE, linewidth=1.4, label="line below 2.5 V")
        axes.set(xlabel=COMMAND, ylabel=DISPLACEMENT)
        figure.legend(loc="outside upper left", ncols=3)
        drawing = Drawing.of(
            figure,
            "curve",
            "Displacement over voltage (thesis figure 2.6)",
            f"{bench.actuator.name}. The mean curve leaves the line by at most {100 * line.misfit:.2f} % of the full "
            f"stroke below 2.5 V; its slope is {local_gain(u, y, 2.0):.3f} mm/V at 2 V and "
            f"{local_gain(u, y, 3.5):.2f} mm/V at 3.5 V.",
        )
    return drawing, {"command_V": levels, "displacement_mm": means}


def _recordings(benches: tuple[Bench, ...]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 7.0)) as figure:
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            record = bench.recording
            y = 1e3 * record.outputs[0]
            mean = moving_mean(y, round(WINDOW / record.sample_time))
            axes.plot(*envelope(record.timepts, y), color=MEASURED, linewidth=0.4, label="readings")
            label = f"moving mean, {WINDOW:.0f} s"
            axes.plot(record.timepts[::50], mean[::50], color=BEFORE, linewidth=1.8, label=label)
            axes.set_title(bench.actuator.name, loc="left", fontsize="medium")
            columns |= {"time_s": record.timepts[::50], f"{_key(bench)}_mean_mm": mean[::50]}
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.supylabel(DISPLACEMENT, fontsize="medium")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        stories = " ".join(f"{b.actuator.name}: {b.actuator.story}" for b in benches)
        drawing = Drawing.of(figure, "recordings", "The six recordings (thesis figure 2.7)", stories)
    return drawing, _complete(columns)


def _drifts(benches: tuple[Bench, ...]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.0)) as figure:
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            record = bench.recording
            y, timepts = 1e6 * record.outputs[0], record.timepts[::50]
            level = at_same_input(record.inputs[0], y, record.sample_time)
            samples = [round(seconds / record.sample_time) for seconds in (WINDOW, WINDOW, SHORT)]
            means = [moving_mean(v, n)[::50] for v, n in zip((y - y.mean(), level, level), samples, strict=True)]
            styles = (
                (f"readings, over {WINDOW:.0f} s", BEFORE, 1.0),
                (f"at the same input, over {WINDOW:.0f} s", AFTER, 2.0),
                (f"and over {SHORT:.0f} s", MEASURED, 0.7),
            )
            for mean, (label, colour, width) in zip(means, styles, strict=True):
                axes.plot(timepts, mean, color=colour, linewidth=width, label=label)
            axes.set_title(bench.actuator.name, loc="left", fontsize="medium")
            columns |= {"time_s": timepts, f"{_key(bench)}_um": means[0], f"{_key(bench)}_same_input_um": means[1]}
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.supylabel("moving mean less the mean of all (µm)", fontsize="medium")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        drawing = Drawing.of(
            figure,
            "drifts",
            "The drifts of the means, enlarged",
            "The mean of 100 s of noise wanders of itself. At the same input: what the command and its rate explain "
            "over the whole record is taken off.",
        )
    return drawing, _complete(columns)


def _ridge(bench: Bench) -> tuple[Drawing, Columns]:
    record = bench.recording
    window, between = RIDGE
    fast = fast_part(record.outputs[0], record.sample_time)
    part = slice(round((window[0] - 8) / record.sample_time), round((window[1] + 30) / record.sample_time))
    timepts, y, fast = record.timepts[part], 1e3 * record.outputs[0][part], 1e6 * fast[part]
    inside = (y > 1e3 * between[0]) & (y < 1e3 * between[1])
    with draw((9.6, 4.0)) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.plot(timepts, y, color=AFTER, linewidth=0.9)
        upper.fill_between(window, *(1e3 * np.array(between)), color=MARK, alpha=0.3, linewidth=0)
        upper.set_ylabel(DISPLACEMENT)
        lower.plot(timepts[inside], fast[inside], ".", markersize=4, color=BEFORE)
        lower.axvspan(*window, color=MARK, alpha=0.3, linewidth=0)
        lower.set(xlabel="time (s)", ylabel="above 5 Hz (µm)")
        figure.align_ylabels()
        drawing = Drawing.of(
            figure,
            "ridge",
            "Where the first recording is rough",
            f"{bench.actuator.name}. Below: the fast part of the reading, while it lies between 0.4 and 0.5 mm. "
            "From 10 to 30 s (ochre) the ball snaps there from lump to lump of dried grease.",
        )
    return drawing, {"time_s": timepts, "displacement_mm": y, "fast_um": fast}


def _spectra(benches: tuple[Bench, ...]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.6)) as figure:
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            record, name = bench.recording, bench.actuator.name
            share = linear_share(record.inputs[0], 1e6 * record.outputs[0], record.sample_time)
            axes.plot(share.frequencies, share.outputs, color=MEASURED, linewidth=1.6, label="output")
            axes.plot(share.frequencies, share.explained, color=AFTER, linewidth=0.9, label="best linear model")
            noise = 2 * record.sample_time * (1e6 * bench.actuator.plant.rig.noise) ** 2
            axes.axhline(noise, color=INK, linestyle=":", linewidth=0.9, label="sensor noise")
            axes.axvline(1.0, color=MARK, linewidth=0.9)
            axes.set_title(name, loc="left", fontsize="medium")
            key = _key(bench)
            columns |= {
                "frequency_Hz": share.frequencies,
                f"{key}_output_um2_per_Hz": share.outputs,
                f"{key}_linear_um2_per_Hz": share.explained,
            }
        panels[0, 0].set(xscale="log", yscale="log", xlim=(0.02, 25), ylim=(1e-3, 1e5))
        for axes in panels[-1]:
            axes.set_xlabel("frequency (Hz)")
        figure.supylabel("spectral density (µm²/Hz)", fontsize="medium")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        drawing = Drawing.of(
            figure,
            "spectra",
            "Output spectra beside the best linear model (thesis figure 2.8)",
            "In each band of 25 mHz the linear response that makes most of the input as it really is, clipped. Ochre: "
            "1 Hz, where the noise ends.",
        )
    return drawing, columns


def _loops(benches: tuple[Bench, ...]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 5.2)) as figure:
        panels = figure.subplots(2, 3, sharex=True, sharey=True)
        for axes, bench in zip(panels.ravel(), benches, strict=True):
            loop = bench.loop
            axes.plot(loop.commands, 1e3 * loop.displacements, linewidth=1.1)
            axes.set_title(f"{bench.actuator.name}: {100 * loop.area:.1f} %", loc="left", fontsize="medium")
            columns |= {"command_V": loop.commands, f"{_key(bench)}_mm": 1e3 * loop.displacements}
        for axes in panels[-1]:
            axes.set_xlabel(COMMAND)
        figure.supylabel(DISPLACEMENT, fontsize="medium")
        drawing = Drawing.of(
            figure,
            "loops",
            "Loops at 10 mHz",
            "Triangles of 1.1 to 3.75 V, and the area of each loop over the rectangle around it.",
        )
    return drawing, columns


def _areas(study: Study) -> tuple[Drawing, Columns]:
    rates = np.array([1e3 * loop.rate for loop in study.loops])
    columns: dict[str, Array] = {"rate_mHz": rates}
    with draw((6.4, 3.6)) as figure:
        axes = figure.add_subplot()
        for loops, label, style in ((study.loops, SPECIFIED, "o-"), (study.elastic_loops, ELASTIC, "s--")):
            columns[f"{label.replace(' ', '_')}_percent"] = np.array([100 * loop.area for loop in loops])
            axes.plot(rates, [100 * loop.area for loop in loops], style, markersize=5, label=label)
        six = [100 * bench.loop.area for bench in study.benches]
        axes.plot(np.full(len(six), 1e3 * LOOP_RATE), six, "_", color=INK, markersize=12, label="the six")
        axes.set(xlabel="rate (mHz)", ylabel="area over rectangle (%)", xscale="log", yscale="log")
        _plain_numbers(axes)
        figure.legend(loc="outside upper left", ncols=3, markerscale=1)
        drawing = Drawing.of(
            figure,
            "areas",
            "How the area of a loop depends on the rate",
            "A film that only relaxes closes its loop as it is driven more slowly; one with hysteresis does not.",
        )
    return drawing, columns


def _small(rests: Mapping[str, SmallVoltages], step: float) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((6.4, 3.6)) as figure:
        axes = figure.add_subplot()
        for (label, rest), marker in zip(rests.items(), "os", strict=True):
            volts, shown = rest.voltages, 1e6 * rest.displacements
            points = axes.plot(volts, shown, marker, markersize=5, label=label)
            axes.plot(volts, shown[0] * (volts / volts[0]) ** 2, "--", color=points[0].get_color(), linewidth=0.9)
            columns |= {"film_voltage_V": volts, f"{label.replace(' ', '_')}_um": shown}
        axes.axhline(1e6 * step, color=INK, linestyle=":", label="one step of the reading")
        axes.set(xlabel="film voltage (V)", ylabel="displacement (µm)", xscale="log", yscale="log")
        _plain_numbers(axes)
        figure.legend(loc="outside upper left", ncols=3, markerscale=1)
        drawing = Drawing.of(
            figure,
            "small",
            "There is no smallest voltage",
            "The ball moves at any voltage, as its square (dashed). What there is, is a voltage below which the sensor "
            f"does not see it: {rests[SPECIFIED].visible:.0f} V for one step of {1e6 * step:.2f} µm.",
        )
    return drawing, columns


def _side_bands(bands: SideBands) -> tuple[Drawing, Columns]:
    near = (bands.frequencies > 0.3) & (bands.frequencies < 0.7)
    frequencies = bands.frequencies[near]
    with draw((6.4, 3.6)) as figure:
        axes = figure.add_subplot()
        beside = 0.002  # so that input and output are seen side by side
        _stems(axes, frequencies - beside, bands.inputs[near], MEASURED, "input")
        _stems(axes, frequencies + beside, bands.outputs[near], AFTER, "output of a linear plant of drifting gain")
        sides = beside + bands.line + bands.drift * np.array([-1, 1])
        axes.plot(sides, bands.expected, "x", color=BEFORE, label="closed form")
        axes.set(xlabel="frequency (Hz)", ylabel="amplitude", yscale="log", ylim=(1e-3, 2))
        figure.legend(loc="outside upper left", ncols=3, markerscale=1)
        drawing = Drawing.of(
            figure,
            "side_bands",
            "A linear plant that varies in time moves energy to other frequencies",
            f"A line at {bands.line:g} Hz goes in; as the gain drifts by ±20 % at {bands.drift:g} Hz, three come out. "
            f"The response to a sum of inputs is the sum of the responses to {bands.superposition:.0e} of it.",
        )
    return drawing, {"frequency_Hz": frequencies, "input": bands.inputs[near], "output": bands.outputs[near]}


def _stems(axes: Axes, places: Array, heights: Array, colour: str, label: str) -> None:
    seen = heights > 1e-3
    axes.vlines(places[seen], 1e-4, heights[seen], color=colour, linewidth=2.5, label=label)


def _plain_numbers(axes: Axes) -> None:
    """1, 2, 5 and 10 instead of powers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if axis is axes.xaxis else (1.0,)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def _key(bench: Bench) -> str:
    return bench.actuator.name.replace(" ", "")


def _complete(columns: Columns) -> Columns:
    """The rows without a gap."""
    complete = np.all([np.isfinite(c) for c in columns.values()], axis=0)
    return {name: column[complete] for name, column in columns.items()}
