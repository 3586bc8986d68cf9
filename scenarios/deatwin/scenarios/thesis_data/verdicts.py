"""The stated measures: what is demanded of the fleet, what it reaches."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from deatwin.ident.curves import linear_share, local_gain, mean_curve, straight_line
from deatwin.ident.drifts import gain_change, mean_shift, roughness
from deatwin.plant.recording import Recording
from deatwin.scenarios.thesis_data.study import Bench, Study
from deatwin.studies.report.story import Row

Window = tuple[float, float]
Change = tuple[int, Window, Window]
SURE = 3.0
"""Standard errors beyond which a change counts as one."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """What the mean of an actuator does from one time to another."""

    number: int
    early: Window  # The two times, each from and to, s
    late: Window
    sign: int  # 1 where it rises, -1 where it falls


MOVES = (
    Move(number=1, early=(0, 100), late=(1000, 1100), sign=-1),
    Move(number=2, early=(0, 100), late=(1000, 1100), sign=1),
    Move(number=3, early=(0, 100), late=(1000, 1100), sign=1),
    Move(number=4, early=(90, 190), late=(360, 460), sign=-1),
    Move(number=4, early=(360, 460), late=(640, 740), sign=1),
    Move(number=5, early=(0, 60), late=(200, 300), sign=-1),
    Move(number=5, early=(200, 300), late=(1000, 1100), sign=1),
    Move(number=6, early=(0, 45), late=(46, 146), sign=-1),
)
"""As the thesis tells of 1, 2, 3 and 6, and as the histories of 4 and 5 have it."""
STEADY: tuple[Window, Window] = ((46, 246), (900, 1100))
"""Of the sixth: no move between these."""
CHANGES: tuple[Change, ...] = (
    (1, (0, 200), (900, 1100)),
    (2, (0, 200), (900, 1100)),
    (3, (0, 200), (900, 1100)),
    (4, (90, 190), (360, 460)),
    (5, (200, 400), (900, 1100)),
    (6, (0, 45), (46, 1100)),
)
"""Where gain and nonlinearity are compared: actuator, early and late."""
RIDGE: tuple[Window, Window] = ((10.0, 30.0), (0.4e-3, 0.5e-3))
"""When, in s, and between which displacements, in m, the first recording is rough."""


def judge(study: Study) -> list[Row]:
    """Hold the study against what the thesis saw."""
    return [
        *_shape([bench.recording for bench in study.benches]),
        *_loops(study),
        _power(study.benches),
        *(_move(study.benches[m.number - 1].recording, m) for m in MOVES),
        _steady(study.benches[5].recording),
        _rough(study.benches[0].recording),
        *_changes(study.benches),
    ]


def _shape(recordings: Iterable[Recording]) -> list[Row]:
    misfits, ratios = [], []
    for recording in recordings:
        u, y = recording.inputs[0], recording.outputs[0]
        misfits.append(straight_line(*mean_curve(u, y)).misfit)
        ratios.append(local_gain(u, y, 3.5) / local_gain(u, y, 2.0))
    return [
        Row(
            measure="mean reading at each command: largest misfit of a straight line below 2.5 V, over the full stroke",
            demanded="below 2 %",
            reached=f"{100 * min(misfits):.2f} to {100 * max(misfits):.2f} %",
            passed=max(misfits) < 0.02,
        ),
        Row(
            measure="gain at 3.5 V over gain at 2 V",
            demanded="above 4",
            reached=f"{min(ratios):.1f} to {max(ratios):.1f}",
            passed=min(ratios) > 4,
        ),
    ]


def _loops(study: Study) -> list[Row]:
    areas = [bench.loop.area for bench in study.benches]
    kept, elastic = (loops[1].area / loops[0].area for loops in (study.loops, study.elastic_loops))
    lowest, lowest_elastic = (loops[-1].area / loops[0].area for loops in (study.loops, study.elastic_loops))
    return [
        Row(
            measure="area of the loop at 10 mHz, over its rectangle",
            demanded="above 1 %",
            reached=f"{100 * min(areas):.1f} to {100 * max(areas):.1f} %",
            passed=min(areas) > 0.01,
        ),
        Row(
            measure="that of the specification at 10 mHz and at 1 mHz, over that at 100 mHz",
            demanded="above 0.5 with the hysteresis, below 0.2 without",
            reached=f"{kept:.2f} and {lowest:.2f} with, {elastic:.3f} and {lowest_elastic:.4f} without",
            passed=min(kept, lowest) > 0.5 and max(elastic, lowest_elastic) < 0.2,
        ),
    ]


def _power(benches: Iterable[Bench]) -> Row:
    inputs, ratios, noises = [], [], []
    for bench in benches:
        r = bench.recording
        share = linear_share(r.inputs[0], r.outputs[0], r.sample_time)
        of_input, of_output, explained = share.above(1.0)
        inputs.append(of_input / share.above(0.0)[0])
        ratios.append((of_output - explained) / explained)
        white = bench.actuator.plant.rig.noise**2 * (1 - 2 * r.sample_time)
        noises.append((of_output - explained) / white)
    return Row(
        measure=f"output power above 1 Hz that the best linear model does not make of the input, which has "
        f"{100 * min(inputs):.2f} to {100 * max(inputs):.2f} % of its own there",
        demanded="more than what the model makes, and more than 100 times the sensor's noise",
        reached=f"{min(ratios):.1f} to {max(ratios):.1f} times that, at least {min(noises):.0f} times the noise",
        passed=min(ratios) > 1 and min(noises) > 100,
    )


def _move(recording: Recording, move: Move) -> Row:
    shift = mean_shift(recording.inputs[0], recording.outputs[0], recording.sample_time, move.early, move.late)
    return Row(
        measure=f"DEA {move.number}: mean at the same input, {_times(move.early)} to {_times(move.late)}",
        demanded=f"{'rises' if move.sign > 0 else 'falls'}, beyond {SURE:.0f} standard errors",
        reached=f"{1e6 * shift.size:+.1f} ± {1e6 * shift.error:.1f} µm",
        passed=move.sign * shift.significance > SURE,
    )


def _steady(recording: Recording) -> Row:
    u, y, step = recording.inputs[0], recording.outputs[0], recording.sample_time
    quick = next(m for m in MOVES if m.number == 6)
    before, after = mean_shift(u, y, step, quick.early, quick.late), mean_shift(u, y, step, *STEADY)
    return Row(
        measure=f"DEA 6: the same, {_times(STEADY[0])} to {_times(STEADY[1])}",
        demanded=f"steady: within {SURE:.0f} standard errors, and below a fifth of the quick shift",
        reached=f"{1e6 * after.size:+.1f} ± {1e6 * after.error:.1f} µm",
        passed=abs(after.significance) < SURE and abs(after.size) < 0.2 * abs(before.size),
    )


def _rough(recording: Recording) -> Row:
    y, step = recording.outputs[0], recording.sample_time
    window, between = RIDGE
    here = roughness(y, step, window, between)
    later = roughness(y, step, (window[1] + 5, recording.duration), between)
    return Row(
        measure="DEA 1: rms above 5 Hz while the ball is 0.4 to 0.5 mm down, 10 to 30 s over 35 s to the end",
        demanded="rough: above 3",
        reached=f"{1e6 * here:.1f} over {1e6 * later:.1f} µm, {here / later:.1f}",
        passed=here > 3 * later,
    )


def _changes(benches: tuple[Bench, ...]) -> list[Row]:
    rows, bent = [], []
    for number, early, late in CHANGES:
        r = benches[number - 1].recording
        change = gain_change(r.inputs[0], r.outputs[0], r.sample_time, early, late)
        if abs(change.bend) > SURE * change.bend_error:
            bent.append(f"DEA {number} {100 * change.bend:+.1f} ± {100 * change.bend_error:.1f} %")
        rows.append(
            Row(
                measure=f"DEA {number}: gain, {_times(early)} to {_times(late)}",
                demanded=f"changes, beyond {SURE:.0f} standard errors",
                reached=f"{100 * change.gain:+.1f} ± {100 * change.gain_error:.1f} %",
                passed=abs(change.gain) > SURE * change.gain_error,
            )
        )
    rows.append(
        Row(
            measure="gain at 3 V over gain at 2 V, between the same times",
            demanded=f"changes in at least two of the six, beyond {SURE:.0f} standard errors",
            reached=", ".join(bent) or "in none",
            passed=len(bent) >= 2,
        )
    )
    return rows


def _times(window: Window) -> str:
    return f"{window[0]:g}–{window[1]:g} s"
