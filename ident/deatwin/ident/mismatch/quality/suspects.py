"""Find faulty readings (stuck, lost, spikes, steps), and the stretches in which a command hides such faults."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from deatwin.ident.mismatch.thresholds import ACCURACY, LOUDER, MOST, MOVES, NEARLY_ALL, ROUNDING, SETTLING_SECONDS
from deatwin.ident.soundness import (
    RISE_SAMPLES,
    at_limit,
    neighbours_deviation,
    noise_of_bends,
    resolution,
    runs,
    samples_in,
)
from deatwin.plant.recording import Recording

SPIKE_DEVIATIONS = 12.0
"""Distance of a spike from its neighbours' cubic, in standard deviations; a normal reading is so far off once in 10^32
samples."""
SIDE = 25
"""Number of samples on each side of a spike from which the local noise is estimated; 25 give its standard deviation to
within 14 %."""
ROUNDS = 30
"""Number of iterations in which the share of usual values converges."""
NEAR_STEPS = 3
"""Largest difference between readings in coarse steps that follow one another in slow motion, in such steps."""
STEP_BENDS_LESS = 0.85
"""Limit for the deviations beside a suspected step, as a share of its own: they are two thirds beside a step, and as
large beside a spike."""
LETS_GO = 0.1
"""Time after a jump of the command, s, but at least three samples, within which inertia lets a plant held by friction
move. A faulty sensor recovers at any time."""
BY_CHANCE = 1e-9
"""Probability of a run of equal readings below which it is no coincidence, however long the recording."""
USUALLY = (0.1, 0.9)
"""Quantiles between which the range of a motion is measured, so that a peak of the current that comes a sample late
does not count."""
LOST_SAMPLES = 3
"""Number of equal readings in a row that a moving film does not give."""


def stuck(record: Recording) -> np.ndarray:
    """Mark runs of one constant reading while the command moves, longer than a second or ending in a jump."""
    # A run that ends in a jump must be longer than chance explains. Readings in coarse steps also stay constant under
    # slow commands, but then go on by a step or two. Dry friction holds a plant until the command is large enough, and
    # a counter, which has no noise, then gives a constant reading. A plant that sticks and slips stands still as often,
    # and jumps as far, elsewhere.
    reading, command = record.outputs[0], record.inputs[0]
    usual = reading[~spikes(reading)]
    ends, near = (usual.max(), usual.min()), NEAR_STEPS * resolution(usual)
    mask = np.zeros(reading.size, dtype=bool)
    shortest = samples_in(SETTLING_SECONDS, record.sample_time)
    equal, leaps = np.diff(reading) == 0.0, np.append(jumps(reading), False)
    by_chance = min(shortest, max(RISE_SAMPLES, _longest_by_chance(equal)))
    ways = np.array([np.ptp(command[run[0] : run[-1] + 2]) for run in runs(equal)])
    for number, same in enumerate(runs(equal)):
        first, last = same[0], same[-1] + 2
        if last - first < (by_chance if leaps[last] else shortest):
            continue
        # A reading at the end of its range is clipped, not stuck: that is physics, and an effect of the catalogue. But
        # nothing is clipped under high and low commands alike.
        gradual = np.ptp(reading[max(first - 1, 0) : last + 1]) <= near
        moved = np.ptp(command[first:last]) / (np.ptp(command) or 1.0)
        sound = (
            gradual
            or reading[first] in ends
            or _may_be_held(reading, command, record.sample_time, (first, last), near)
            or (_is_likely(ways, number) and _slips(reading, command, record.sample_time, (first, last)))
        )
        # Over nearly all of the command's range neither a limit nor friction explains a constant reading.
        if moved > (NEARLY_ALL if sound else MOVES):
            mask[first:last] = True
    return mask


def _longest_by_chance(equal: np.ndarray) -> float:
    """Return the longest run of equal readings that chance explains, given which neighbours are `equal`, (n - 1,)."""
    share = float(equal.mean())
    return 1 + np.log(BY_CHANCE) / np.log(share) if 0.0 < share < 1.0 else np.inf


def _is_likely(ways: np.ndarray, number: int) -> bool:
    """Return whether chance explains run `number`, by the command's range in each run of equal readings, `ways` (k,)."""
    # Any part of the command's motion may end a run, so the ranges are distributed exponentially.
    others = np.delete(ways, number)
    return bool(others.size and ways[number] < -np.log(BY_CHANCE) * others.mean())


def _slips(reading: np.ndarray, command: np.ndarray, sample_time: float, run: tuple[int, int]) -> bool:
    """Return whether a `run` of one `reading`, under a command without jumps, ends in a step such as occurs elsewhere."""
    # At least one in ten of the other steps under commands that changed no faster must be at least half as large.
    first, last = run
    speed = np.abs(np.diff(command, prepend=command[0]))
    if last == reading.size or speed[first + 1 : last + 1].max() > MOVES * np.ptp(command):
        return False
    delay = max(3, round(LETS_GO / sample_time))
    recent = np.lib.stride_tricks.sliding_window_view(np.pad(speed, (delay, 0)), delay + 1).max(axis=1)
    steps = np.abs(np.diff(reading, prepend=reading[0]))
    others = steps[(steps > 0.0) & (recent <= recent[last])]
    return bool(np.mean(others >= steps[last] / 2) > 1 - NEARLY_ALL)


def _may_be_held(
    reading: np.ndarray, command: np.ndarray, sample_time: float, run: tuple[int, int], near: float
) -> bool:
    """Return whether friction may hold the plant in a `run`, first and last-plus-one sample, of one `reading`."""
    # The plant moves again when the command jumps, or not within the record. At other times under the commands of the
    # run, which are too small to overcome friction, it must also be held, within `near`, after a second to come to
    # rest.
    first, last = run
    delay, settling = max(3, round(LETS_GO / sample_time)), samples_in(SETTLING_SECONDS, sample_time)
    step = np.abs(np.diff(command[max(last - delay - 1, 0) : last + 1]))
    leapt = np.flatnonzero(step > MOVES * np.ptp(command))
    if last < reading.size and leapt.size == 0:
        return False
    held = command[first : last - delay]
    if held.size == 0:
        return False
    within = (command >= held.min()) & (command <= held.max())
    within[first:last] = False
    others = [reading[rows[settling:]] for rows in runs(within) if rows.size > settling]
    stands = [np.abs(values - np.median(values)) <= near for values in others]
    return not stands or bool(np.concatenate(stands).mean() > NEARLY_ALL)  # the plant may come to rest late


def held(
    reading: np.ndarray, simulated: np.ndarray, command: np.ndarray, sample_time: float, noise: float
) -> np.ndarray:
    """Mark runs in which a `reading`, NaN where unknown, shows only noise while the plant moves. Shapes: (n,) all."""
    # A converter that holds its last value still has its noise. It recovers within a sample, to where the plant is by
    # then, or never. A jump that is larger than any motion of plant and reading within a sample is no motion. A smaller
    # one may be: the plant's motion of the last second may come late, or friction may have held it.
    mask, known = np.zeros(reading.size, dtype=bool), np.flatnonzero(np.isfinite(reading))
    shortest = samples_in(SETTLING_SECONDS, sample_time)
    if known.size < shortest:
        return mask
    filled = np.interp(np.arange(reading.size), known, reading[known])
    residual = filled - simulated
    alive = max(noise, min(map(noise_of_bends, (filled, residual))), resolution(reading[known]) / 2)
    far, ends = SPIKE_DEVIATIONS * alive, (filled.max(), filled.min())
    returns = np.flatnonzero(jumps(filled) & jumps(residual))
    steps = np.delete(np.abs(np.diff(filled, prepend=filled[0])), returns)
    fastest = max(steps.max(), np.abs(np.diff(simulated)).max())
    for back in (*returns, reading.size):
        value = float(np.median(filled[max(back - RISE_SAMPLES, 0) : back]))
        away = np.flatnonzero(~(np.abs(reading[:back] - value) <= far / 2))
        first = int(away[-1]) + 1 if away.size else 0
        is_fault = back < reading.size and abs(filled[back] - value) > fastest + far
        missed = slice(first, back if is_fault else max(back - shortest, first))
        if missed.stop - first < RISE_SAMPLES or np.ptp(np.quantile(simulated[missed], USUALLY)) <= 2 * far:
            continue
        if back < reading.size and abs(residual[back]) >= abs(value - simulated[back]):
            continue
        # A strip that goes slack, a stop or a saturation holds a reading at the end of its range, as in `stuck`; it gets
        # there without a jump.
        jumped = np.isin((first - 1, first), returns).any()
        at_end = not jumped and any(abs(value - end) <= far for end in ends)
        if is_fault or (
            np.ptp(command[missed]) > (NEARLY_ALL if at_end else MOVES) * np.ptp(command)
            and not _may_be_held(filled, command, sample_time, (first, int(back)), far / 2)
        ):
            mask[first:back] = True
    return mask


def lost(record: Recording) -> np.ndarray:
    """Mark runs of one constant reading far from those before and after, as when the sensor loses sight of the film."""
    # No film jumps away and back by itself, each time within a sample, and stands still in between.
    reading = record.outputs[0]
    mask, still = np.zeros(reading.size, dtype=bool), quiet(record)
    far = SPIKE_DEVIATIONS * _typical(np.abs(neighbours_deviation(reading)), reading)
    for same in runs(np.diff(reading) == 0.0):
        first, last = same[0], same[-1] + 2
        if last - first < LOST_SAMPLES or first == 0 or last == reading.size or not (still[first] and still[last]):
            continue
        before, after = reading[first - 1] - reading[first], reading[last] - reading[first]
        if before * after > 0.0 and min(abs(before), abs(after)) > far:
            mask[first:last] = True
    return mask


def spikes(signal: np.ndarray) -> np.ndarray:
    """Find single values of a `signal` far from the cubic through their four neighbours."""
    bend = _bends(signal)
    deviation = np.abs(bend)
    # A spike raises its neighbours' deviations as well, by two thirds of its size: only the peak is the outlier.
    around = np.pad(deviation, 1)
    peak = (deviation >= around[:-2]) & (deviation >= around[2:])
    typical = _typical(deviation, signal)
    # A ringing film leaves more at the neighbours.
    found = peak & (deviation > SPIKE_DEVIATIONS * typical) & (_beside(bend) < MOST * deviation)
    others = np.flatnonzero(~found)
    return _isolated(found, _bends(np.interp(np.arange(signal.size), others, signal[others])), typical)


def _bends(signal: np.ndarray) -> np.ndarray:
    """Return each value's deviation from the cubic through its four neighbours, the signal being continued at its ends."""
    return neighbours_deviation(np.pad(signal, 2, mode="edge"))[2:-2]


def _isolated(far: np.ndarray, bend: np.ndarray, typical: float) -> np.ndarray:
    """Return which values marked `far`, (n,), have usual ones on both sides; `bend`, (n,), is computed without them."""
    alone, squares = far.copy(), bend**2 / typical**2
    for place in np.flatnonzero(far):
        sides = squares[max(place - SIDE, 0) : place], squares[place + 1 : place + 1 + SIDE]
        alone[place] = all(_usual_share(side) > MOST for side in sides if side.size)
    return alone


def _usual_share(squares: np.ndarray) -> float:
    """Return the share of values, with `squares` (k,), that are standard normal if the others have a larger deviation."""
    # Share and larger deviation are maximum-likelihood estimates, by expectation-maximisation.
    share, larger = 0.5, max(float(squares.mean()), LOUDER**2)
    for _ in range(ROUNDS):
        usual = expit(np.log(np.sqrt(larger) * share / (1 - share)) - (1 - 1 / larger) * squares / 2)
        share = float(np.clip(usual.mean(), ACCURACY, 1 - ACCURACY))
        larger = max(float((1 - usual) @ squares / (1 - usual).sum()), LOUDER**2)
    return share


def _beside(bend: np.ndarray) -> np.ndarray:
    """Return the largest deviation among each value's neighbours after the value is moved onto its own cubic, (n,)."""
    padded = np.pad(bend, 2, constant_values=np.nan)
    shares = {1: 2 / 3, 3: 2 / 3, 0: -1 / 6, 4: -1 / 6}
    off = [np.abs(padded[k : k + bend.size] + share * bend) for k, share in shares.items()]
    return np.nan_to_num(np.fmax.reduce(off))  # values near an end lack neighbours


def jumps(signal: np.ndarray) -> np.ndarray:
    """Mark the first values of a `signal` after steps that take no longer than a sample."""
    # The deviation changes by the step's size at the step, and by two thirds of it, in the other direction, on either
    # side.
    step = np.abs(np.diff(neighbours_deviation(signal), prepend=0.0))
    beside = np.pad(step, 1)
    lone = np.maximum(beside[:-2], beside[2:]) < STEP_BENDS_LESS * step
    return lone & (step > SPIKE_DEVIATIONS * _typical(step, signal))


def _typical(deviation: np.ndarray, signal: np.ndarray) -> float:
    """Return the standard deviation implied by the median absolute deviation, at least half a step of coarse readings."""
    # Constant readings contain no information about the noise.
    moves = np.ones(deviation.size, dtype=bool)
    for still in runs(deviation <= ROUNDING * np.ptp(signal)):
        moves[still] = still.size < RISE_SAMPLES
    median = float(np.median(deviation[moves])) if moves.any() else 0.0
    return max(1.4826 * median, resolution(signal) / 2) + 1e-15


def clipped(record: Recording) -> np.ndarray:
    """Mark readings of a `record` that pile up at a limit."""
    mask = np.zeros(record.n_samples, dtype=bool)
    for rows in at_limit(record.outputs[0]).values():
        mask[np.concatenate(rows)] = True
    return mask


def quiet(record: Recording) -> np.ndarray:
    """Mark samples of a `record` away from jumps and corners of the command, after which the film rings."""
    command = record.inputs[0]
    step = np.diff(command, prepend=command[0])
    bend = np.diff(step, prepend=0.0)
    quiet = np.ones(command.size, dtype=bool)
    ring = samples_in(SETTLING_SECONDS, record.sample_time)
    for change in (np.abs(step), np.abs(bend)):
        # Jumps between holds may be smaller than the changes of a noise-like command within a sample or two, so the
        # limit is relative to the usual change.
        for sudden in np.flatnonzero(change > max(0.005 * np.ptp(command), 5 * float(np.median(change)))):
            quiet[max(0, sudden - 2) : sudden + ring] = False
    quiet[:ring] = quiet[-2:] = False  # the record before this one may have ended at another command
    return quiet
