"""The stated measures: what is demanded of the fleet, what it reaches."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from deatwin.ident.curves import linear_share, local_gain, mean_curve, straight_line
from deatwin.ident.drifts import Shift, Window, gain_change, mean_shift, roughness
from deatwin.ident.narx.fleet.records import MOVES, Move
from deatwin.plant.recording import Recording
from deatwin.scenarios.thesis_data.study import Bench, Study
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Span, Words

WORDS = Words(__package__)
Change = tuple[int, Window, Window]
SURE = 3.0
"""Standard errors beyond which a change counts as one."""


STEADY: tuple[Window, Window] = ((46, 246), (900, 1100))
"""Windows between which the sixth does not move."""
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
