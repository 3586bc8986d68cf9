"""Goals for the fleet, the figures after 2.5 to 2.8 of the thesis, and those of the counter-evidence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from deatwin.ident.curves import linear_share, local_gain, mean_curve, straight_line
from deatwin.ident.drifts import (
    Shift,
    Window,
    at_same_input,
    fast_part,
    gain_change,
    mean_shift,
    moving_mean,
    roughness,
)
from deatwin.ident.narx.fleet import MOVES, Move
from deatwin.plant import Recording
from deatwin.plant.drawing import envelope, plain_numbers
from deatwin.scenarios.thesis_data.study import Bench, SideBands, SmallVoltages, Study
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above, panels_of, titled
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Span, Words

WORDS = Words(__package__)
Change = tuple[int, Window, Window]
SURE = 3.0  # Standard errors beyond which a change counts as one


STEADY: tuple[Window, Window] = ((46, 246), (900, 1100))  # Windows between which the sixth does not move
CHANGES: tuple[Change, ...] = (
    (1, (0, 200), (900, 1100)),
    (2, (0, 200), (900, 1100)),
    (3, (0, 200), (900, 1100)),
    (4, (90, 190), (360, 460)),
    (5, (200, 400), (900, 1100)),
    (6, (0, 45), (46, 1100)),
)
"""Comparisons of gain and nonlinearity: number of the actuator, early and late window."""
RIDGE: tuple[Window, Window] = ((10.0, 30.0), (0.4e-3, 0.5e-3))
"""Window, s, and displacements, m, in which the first recording is rough."""


def judge(study: Study) -> list[Measure]:
    """Compare the study with the observations of the thesis."""
    return [
        *_shape([bench.recording for bench in study.benches]),
        *_loops(study),
        _power(study.benches),
        *(_move(study.benches[move.number - 1].recording, move) for move in MOVES),
        _steady(study.benches[5].recording),
        _rough(study.benches[0].recording),
        *_changes(study.benches),
    ]


def _shape(recordings: Iterable[Recording]) -> list[Measure]:
    pairs = [(recording.inputs[0], recording.outputs[0]) for recording in recordings]
    misfits = [straight_line(*mean_curve(u, y)).misfit for u, y in pairs]
    ratios = [local_gain(u, y, 3.5) / local_gain(u, y, 2.0) for u, y in pairs]
    return [
        WORDS.measure("line", max(misfits) < 0.02, misfits=Span(100 * misfit for misfit in misfits)),
        WORDS.measure("steep", min(ratios) > 4, ratios=Span(ratios)),
    ]


def _loops(study: Study) -> list[Measure]:
    areas = [bench.loop.area for bench in study.benches]
    (kept, lowest), (elastic, elastic_lowest) = (
        [loops[place].area / loops[0].area for place in (1, -1)] for loops in (study.loops, study.elastic_loops)
    )
    shares = {"kept": kept, "lowest": lowest, "elastic": elastic, "elastic_lowest": elastic_lowest}
    open_, closed = min(kept, lowest) > 0.5, max(elastic, elastic_lowest) < 0.2
    return [
        WORDS.measure("loop", min(areas) > 0.01, areas=Span(100 * area for area in areas)),
        WORDS.measure("rates", open_ and closed, **shares),
    ]


def _power(benches: Iterable[Bench]) -> Measure:
    inputs, ratios, noises = [], [], []
    for bench in benches:
        r = bench.recording
        share = linear_share(r.inputs[0], r.outputs[0], r.sample_time)
        of_input, of_output, explained = share.above(1.0)
        inputs.append(100 * of_input / share.above(0.0)[0])
        ratios.append((of_output - explained) / explained)
        white = bench.actuator.plant.rig.noise**2 * (1 - 2 * r.sample_time)  # white noise's power above 1 Hz
        noises.append((of_output - explained) / white)
    passed = min(ratios) > 1 and min(noises) > 100
    return WORDS.measure("power", passed, inputs=Span(inputs), ratios=Span(ratios), noise=min(noises))


def _move(recording: Recording, move: Move) -> Measure:
    shift = _shift(recording, move.early, move.late)
    return WORDS.measure(
        "move",
        move.sign * shift.significance > SURE,
        number=move.number,
        times=_times(move.early, move.late),
        direction="rises" if move.sign > 0 else "falls",
        SURE=SURE,
        size=1e6 * shift.size,
        error=1e6 * shift.error,
    )


def _steady(recording: Recording) -> Measure:
    quick = next(move for move in MOVES if move.number == 6)
    before, after = _shift(recording, quick.early, quick.late), _shift(recording, *STEADY)
    passed = abs(after.significance) < SURE and abs(after.size) < 0.2 * abs(before.size)
    sizes = {"size": 1e6 * after.size, "error": 1e6 * after.error}
    return WORDS.measure("steady", passed, times=_times(*STEADY), SURE=SURE, **sizes)


def _rough(recording: Recording) -> Measure:
    y, step = recording.outputs[0], recording.sample_time
    window, between = RIDGE
    here = roughness(y, step, window, between)
    later = roughness(y, step, (window[1] + 5, recording.duration), between)
    return WORDS.measure("rough", here > 3 * later, here=1e6 * here, later=1e6 * later, ratio=here / later)


def _changes(benches: Sequence[Bench]) -> Iterable[Measure]:
    bent = []
    for number, early, late in CHANGES:
        r = benches[number - 1].recording
        change = gain_change(r.inputs[0], r.outputs[0], r.sample_time, early, late)
        if abs(change.bend) > SURE * change.bend_error:
            bent.append(f"DEA {number} {100 * change.bend:+.1f} ± {100 * change.bend_error:.1f} %")
        passed, sizes = abs(change.gain) > SURE * change.gain_error, (100 * change.gain, 100 * change.gain_error)
        numbers = {"number": number, "times": _times(early, late), "SURE": SURE}
        yield WORDS.measure("gain", passed, **numbers, gain=sizes[0], error=sizes[1])
    yield WORDS.measure("bend", len(bent) >= 2, SURE=SURE, bent=", ".join(bent) or "in none")


def _shift(recording: Recording, early: Window, late: Window) -> Shift:
    return mean_shift(recording.inputs[0], recording.outputs[0], recording.sample_time, early, late)


def _times(early: Window, late: Window) -> str:
    return " to ".join(f"{first:g}–{last:g} s" for first, last in (early, late))


WINDOW, SHORT = 100.0, 20.0  # Windows of the moving means, s
ZOOM = 40.0  # Length of the excitation that is drawn, s
SPECIFIED, ELASTIC = "specification", "without hysteresis"
COMMAND, DISPLACEMENT = "command (V)", "displacement (mm)"


def drawings(study: Study, rests: Mapping[str, SmallVoltages], bands: SideBands, step: float) -> list[Drawing]:
    """Draw all figures."""
    return [
        _excitation(study.benches[0]),
        _curve(study.benches[-1]),
        _recordings(study.benches),
        _drifts(study.benches),
        _ridge(study.benches[0]),
        _spectra(study.benches),
        _small(rests, step),
        _side_bands(bands),
    ]


def _excitation(bench: Bench) -> Drawing:
    record = bench.recording
    u, step = record.inputs[0], record.sample_time
    share = linear_share(u, record.outputs[0], step)
    part = slice(0, round(ZOOM / step))
    with draw((9.6, 3.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        left.step(record.timepts[part], u[part], where="post", color=Hue.AFTER)
        for limit in (1.1, 3.75):
            left.axhline(limit, color=Hue.INK, linestyle=":", linewidth=0.9)
        left.set(xlabel="time (s)", ylabel=COMMAND, ylim=(0.9, 3.95))
        right.plot(share.frequencies, share.inputs, color=Hue.AFTER)
        right.set(xlabel="frequency (Hz)", ylabel="spectral density (V²/Hz)", yscale="log", xlim=(0, 5), ylim=(1e-7, 2))
        clipped = 100 * share.above(1.0)[0] / share.above(0.0)[0]
        return WORDS.drawing(figure, "excitation", name=bench.actuator.name, ZOOM=ZOOM, share=clipped)


def _curve(bench: Bench) -> Drawing:
    u, y = bench.recording.inputs[0], 1e3 * bench.recording.outputs[0]
    levels, means = mean_curve(u, y)
    line = straight_line(levels, means)
    ends = np.array([levels[0], 2.9])
    with draw((6.4, 4.0)) as figure:
        axes = figure.add_subplot()
        axes.plot(u[::20], y[::20], ".", markersize=1.5, color=Hue.MEASURED, label="readings")
        axes.plot(levels, means, color=Hue.AFTER, linewidth=1.8, label="mean at each command")
        axes.plot(ends, line.offset + line.gain * ends, "--", color=Hue.BEFORE, linewidth=1.4, label="line below 2.5 V")
        axes.set(xlabel=COMMAND, ylabel=DISPLACEMENT)
        figure.legend(loc="outside upper left", ncols=3)
        slopes = {"low": local_gain(u, y, 2.0), "high": local_gain(u, y, 3.5)}
        return WORDS.drawing(figure, "curve", name=bench.actuator.name, misfit=100 * line.misfit, **slopes)


def _recordings(benches: Sequence[Bench]) -> Drawing:
    with draw((9.6, 7.0)) as figure:
        panels = panels_of(figure, 3, 2, "time (s)", DISPLACEMENT, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            record = bench.recording
            y, timepts = 1e3 * record.outputs[0], record.timepts[::50]
            mean = moving_mean(y, round(WINDOW / record.sample_time))[::50]
            axes.plot(*envelope(record.timepts, y), color=Hue.MEASURED, linewidth=0.4, label="readings")
            axes.plot(timepts, mean, color=Hue.BEFORE, linewidth=1.8, label=f"moving mean, {WINDOW:.0f} s")
            titled(axes, bench.actuator.name)
        legend_above(figure, panels[0, 0], 3)
        stories = " ".join(f"{b.actuator.name}: {b.actuator.story}" for b in benches)
        return WORDS.drawing(figure, "recordings", stories=stories)


def _drifts(benches: Sequence[Bench]) -> Drawing:
    styles = (
        (f"readings, over {WINDOW:.0f} s", Hue.BEFORE, 1.0),
        (f"at the same input, over {WINDOW:.0f} s", Hue.AFTER, 2.0),
        (f"and over {SHORT:.0f} s", Hue.MEASURED, 0.7),
    )
    with draw((9.6, 6.0)) as figure:
        label = "moving mean minus overall mean (µm)"
        panels = panels_of(figure, 3, 2, "time (s)", label, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            record = bench.recording
            y, timepts = 1e6 * record.outputs[0], record.timepts[::50]
            level = at_same_input(record.inputs[0], y, record.sample_time)
            samples = [round(seconds / record.sample_time) for seconds in (WINDOW, WINDOW, SHORT)]
            means = [moving_mean(v, n)[::50] for v, n in zip((y - y.mean(), level, level), samples, strict=True)]
            for mean, (label, colour, width) in zip(means, styles, strict=True):
                axes.plot(timepts, mean, color=colour, linewidth=width, label=label)
            titled(axes, bench.actuator.name)
        legend_above(figure, panels[0, 0], 3)
        return WORDS.drawing(figure, "drifts")


def _ridge(bench: Bench) -> Drawing:
    record = bench.recording
    window, between = RIDGE
    fast = fast_part(record.outputs[0], record.sample_time)
    part = slice(round((window[0] - 8) / record.sample_time), round((window[1] + 30) / record.sample_time))
    timepts, y, fast = record.timepts[part], 1e3 * record.outputs[0][part], 1e6 * fast[part]
    inside = (y > 1e3 * between[0]) & (y < 1e3 * between[1])
    with draw((9.6, 4.0)) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.plot(timepts, y, color=Hue.AFTER, linewidth=0.9)
        upper.fill_between(window, *(1e3 * np.array(between)), color=Hue.MARK, alpha=0.3, linewidth=0)
        upper.set_ylabel(DISPLACEMENT)
        lower.plot(timepts[inside], fast[inside], ".", markersize=4, color=Hue.BEFORE)
        lower.axvspan(*window, color=Hue.MARK, alpha=0.3, linewidth=0)
        lower.set(xlabel="time (s)", ylabel="above 5 Hz (µm)")
        figure.align_ylabels()
        return WORDS.drawing(figure, "ridge", name=bench.actuator.name)


def _spectra(benches: Sequence[Bench]) -> Drawing:
    with draw((9.6, 6.6)) as figure:
        panels = panels_of(figure, 3, 2, "frequency (Hz)", "spectral density (µm²/Hz)", sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            record = bench.recording
            share = linear_share(record.inputs[0], 1e6 * record.outputs[0], record.sample_time)
            axes.plot(share.frequencies, share.outputs, color=Hue.MEASURED, linewidth=1.6, label="output")
            axes.plot(share.frequencies, share.explained, color=Hue.AFTER, linewidth=0.9, label="best linear model")
            noise = 2 * record.sample_time * (1e6 * bench.actuator.plant.rig.noise) ** 2
            axes.axhline(noise, color=Hue.INK, linestyle=":", linewidth=0.9, label="sensor noise")
            axes.axvline(1.0, color=Hue.MARK, linewidth=0.9)
            titled(axes, bench.actuator.name)
        panels[0, 0].set(xscale="log", yscale="log", xlim=(0.02, 25), ylim=(1e-3, 1e5))
        legend_above(figure, panels[0, 0], 3)
        return WORDS.drawing(figure, "spectra")


def _small(rests: Mapping[str, SmallVoltages], step: float) -> Drawing:
    with draw((6.4, 3.6)) as figure:
        axes = figure.add_subplot()
        for (label, rest), marker in zip(rests.items(), "os", strict=True):
            volts, shown = rest.voltages, 1e6 * rest.displacements
            points = axes.plot(volts, shown, marker, markersize=5, label=label)
            axes.plot(volts, shown[0] * (volts / volts[0]) ** 2, "--", color=points[0].get_color(), linewidth=0.9)
        axes.axhline(1e6 * step, color=Hue.INK, linestyle=":", label="one step of the reading")
        axes.set(xlabel="film voltage (V)", ylabel="displacement (µm)", xscale="log", yscale="log")
        plain_numbers(axes.xaxis, 1.0, 2.0, 5.0)
        plain_numbers(axes.yaxis, 1.0)
        figure.legend(loc="outside upper left", ncols=3, markerscale=1)
        return WORDS.drawing(figure, "small", visible=rests[SPECIFIED].visible, step=1e6 * step)


def _side_bands(bands: SideBands) -> Drawing:
    near = (bands.frequencies > 0.3) & (bands.frequencies < 0.7)
    beside = 0.002  # Hz, so that input and output are seen side by side
    with draw((6.4, 3.6)) as figure:
        axes = figure.add_subplot()
        for heights, shift, colour, label in (
            (bands.inputs, -beside, Hue.MEASURED, "input"),
            (bands.outputs, beside, Hue.AFTER, "output of a linear plant with a drifting gain"),
        ):
            seen = near & (heights > 1e-3)
            axes.vlines(bands.frequencies[seen] + shift, 1e-4, heights[seen], color=colour, linewidth=2.5, label=label)
        sides = beside + bands.line + bands.drift * np.array([-1, 1])
        axes.plot(sides, bands.expected, "x", color=Hue.BEFORE, label="closed form")
        axes.set(xlabel="frequency (Hz)", ylabel="amplitude", yscale="log", ylim=(1e-3, 2))
        figure.legend(loc="outside upper left", ncols=3, markerscale=1)
        found = {"line": bands.line, "drift": bands.drift, "superposition": bands.superposition}
        return WORDS.drawing(figure, "side_bands", **found)
