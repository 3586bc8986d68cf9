"""Inputs that bring out the differences of explanations, within the limits of a rig.

Slow times are shares of the length, fast frequencies shares of the sample rate, so that the same repertoire serves a
film at 50 Hz, an oscillator at 600 Hz and a tank that is read every 4 s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.greybox.parts import Part
from deatwin.plant.excitation import (
    linear_chirp,
    logarithmic_chirp,
    odd_harmonics,
    random_holds,
    random_phase_multisine,
    staircase,
    triangles,
    with_alternating_polarity,
)
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.simulate import RunStatus

CHIRP = (5.0, 15.0)
"""Ends of the fast chirp, Hz; lower if the sample rate does not allow them."""
FASTEST = 0.6
"""Highest frequency, as a share of half the sample rate."""
HEADROOM = 1.05
"""Factor on the commands that a plant must survive for the rig to bear an input: so far the film stays clear of its
limits."""
LOWERED, LOWEST = 0.95, 0.4
"""Factor by which a range that is too large is reduced at a time, and smallest share of the range that is tried."""
ROUNDS, PROBES = 20, 6
"""Number of rounds of holds and chirp, and number of probes of a long hold."""
PROBE = 250
"""Number of samples for which each end of a range is held to test it."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The commands that an input may use, in their unit."""

    lowest: float
    highest: float
    # `bottom` and `top` are the ends of the range in which the plant works: one of them is rest if the drive can give
    # another polarity that recordings did not use.
    bottom: float
    top: float
    rest: float  # command at rest

    def at(self, share: float | np.ndarray) -> np.ndarray:
        """Return commands at shares of the working range; 0 is its bottom or, if all of it is below rest, its top."""
        begin, end = (self.top, self.bottom) if self.top <= self.rest else (self.bottom, self.top)
        return np.asarray(begin + (end - begin) * np.asarray(share))

    @property
    def farthest(self) -> float:
        """Return how far from rest the plant may be driven, to each side on which it works."""
        sides = [reach for reach in (self.top - self.rest, self.rest - self.bottom) if reach > 0]
        return min(*sides, self.highest - self.rest, self.rest - self.lowest)

    def scaled(self, share: float) -> Limits:
        """Return the limits with all distances from rest reduced to a `share`, at most 1, as far as the drive goes."""
        ends = self.rest + share * (np.array([self.lowest, self.highest]) - self.rest)
        lowest, highest = np.clip(ends, self.lowest, self.highest).tolist()  # rest may be outside of the limits
        bottom, top = np.clip([self.bottom, self.top], lowest, highest).tolist()
        return replace(self, lowest=lowest, highest=highest, bottom=bottom, top=top)


Maker = Callable[[Limits, float, float, np.random.Generator], np.ndarray]
"""Function from limits, length in s, sample time in s and a source of randomness to commands of nearly that length."""


def used_range(parts: Sequence[Part]) -> tuple[float, float]:
    """Return the lowest and the highest command of recordings."""
    inputs = [record.inputs[0] for part in parts for record in part.experiment.recordings]
    return min(float(u.min()) for u in inputs), max(float(u.max()) for u in inputs)


def limits_of(plant: Plant, parts: Sequence[Part]) -> Limits:
    """Return the commands that a rig's drive can give or, if not stated, the range of the recordings, extended to rest."""
    least, most = plant.rig.command_range if plant.rig.command_range and not parts else used_range(parts)
    rest = plant.rig.start.rest_command
    lowest, highest = plant.rig.command_range or (min(rest, least), max(rest, most))
    bottom = rest if least >= rest else lowest
    top = rest if least < rest and most <= rest else highest
    bottom, top = np.clip([bottom, top], lowest, highest).tolist()
    return Limits(lowest=lowest, highest=highest, bottom=bottom, top=top, rest=rest)


def safe_limits(plants: Sequence[Plant], limits: Limits) -> Limits | None:
    """Reduce a range until all plants bear its held ends with headroom; None if they bear not even its smallest share."""
    share = 1.0
    while share >= LOWEST:
        tried = limits.scaled(share)
        probe = np.repeat([*tried.at(np.array([0.0, 1.0])), tried.lowest, tried.highest], PROBE)
        if all(bears(plant, probe, tried.rest) for plant in plants):
            return tried
        share *= LOWERED
    return None


def bears(plant: Plant, commands: np.ndarray, rest: float, headroom: float = HEADROOM) -> bool:
    """Return whether a plant follows `headroom` times the commands, (n,), counted from rest, without failing.

    Failing means pull-in, breakdown or loss of tension.
    """
    more = rest + headroom * (commands - rest)
    record = Recording.from_arrays(more, np.zeros_like(more), plant.rig.sample_time)
    return plant.simulate(Experiment(recordings=(record,))).status is RunStatus.DONE


def waveform(
    name: str, limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator
) -> np.ndarray | None:
    """Return commands, (n,), of one waveform of `REPERTOIRE`; None if the limits do not allow it."""
    make, both_ways = REPERTOIRE[name], limits.lowest < limits.rest < limits.highest
    if limits.top <= limits.bottom or (make is _reversals and not both_ways):
        return None
    made = make(limits, seconds, sample_time, rng)
    count = max(2, round(seconds / sample_time))
    whole = np.concatenate([made[:count], np.full(max(0, count - made.size), made[-1])])
    return np.where(whole == limits.rest, whole, np.clip(whole, limits.lowest, limits.highest))


def _middle(seconds: float, sample_time: float) -> float:
    """Return the logarithmic mean of the slowest and the fastest frequency, Hz: 0.6 for a minute."""
    return float(np.sqrt(0.5 / sample_time / seconds))


def _fast(sample_time: float) -> float:
    return FASTEST * 0.5 / sample_time


def _multisine(seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    """Return one period of odd harmonics up to a tenth of the sample rate, between -1 and 1, slow ones largest."""
    period = max(20, round(seconds / sample_time)) * sample_time
    lines = odd_harmonics(period, max(0.1 / sample_time, 1.01 / period))
    wave = random_phase_multisine(
        rng, period, sample_time, lines, 1.0, mean=0.0, amplitudes=lines**-0.5, lower=-np.inf, upper=np.inf
    )
    return np.asarray(wave / np.abs(wave).max())


def _stepped_multisine(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    sections = ((0.5, 0.5), (0.2, 0.2), (0.8, 0.2), (0.5, 0.25))
    wave = _multisine(seconds / len(sections), sample_time, rng)
    return np.concatenate([limits.at(mean + size * wave) for mean, size in sections])


def _repeats(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    return np.tile(limits.at(0.5 + 0.5 * _multisine(seconds / 4, sample_time, rng)), 4)


def _holds(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    levels = np.concatenate([rng.permutation([0.0, 0.6, 0.9]), rng.permutation([0.3, 0.75, 1.0])])
    return np.repeat(limits.at(levels), max(1, round(seconds / 6 / sample_time)))


def _random_steps(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    shortest, longest = seconds / 80, seconds / 8
    return random_holds(rng, seconds, sample_time, limits.bottom, limits.top, shortest, longest)


def _sweeps(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    middle = _middle(seconds, sample_time)
    pairs = ((4 / seconds, middle), (middle, _fast(sample_time)))
    unit = [logarithmic_chirp(seconds / 2, sample_time, *pair, mean=0.5, amplitude=0.5) for pair in pairs]
    return limits.at(np.concatenate(unit))


def _two_sines(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    half = np.arange(max(1, round(seconds / 2 / sample_time))) * sample_time
    wave = np.sin(2 * np.pi * _middle(seconds, sample_time) * half)
    return limits.at(np.concatenate([0.5 + 0.5 * wave, 0.5 + 0.2 * wave]))


def _rests(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    count = max(1, round(seconds / 6 / sample_time))
    levels = limits.at(np.array([0.7, 1.0, 0.85]))
    return np.concatenate([np.repeat([level, limits.rest], count) for level in levels])


def _chirp(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    return _fast_chirp(limits, seconds, sample_time, mean=0.6, amplitude=0.4)


def _fast_chirp(limits: Limits, seconds: float, sample_time: float, mean: float, amplitude: float) -> np.ndarray:
    share = min(1.0, _fast(sample_time) / CHIRP[1])
    ends = (share * CHIRP[0], share * CHIRP[1])
    return limits.at(linear_chirp(seconds, sample_time, *ends, mean=mean, amplitude=amplitude))


def _held(limits: Limits, seconds: float, sample_time: float, level: float) -> np.ndarray:
    return np.repeat(limits.at(level), max(1, round(seconds / sample_time)))


def _rounds(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    length = seconds / ROUNDS
    holds = [_held(limits, 0.2 * length, sample_time, level) for level in (0.0, 0.5, 1.0)]
    return np.tile(np.concatenate([*holds, _chirp(limits, 0.4 * length, sample_time, rng)]), ROUNDS)


def _probed_holds(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    length, pieces = seconds / (4 * PROBES), []
    for level in (0.85, 0.2, 0.85, 0.2):
        hold = _held(limits, 0.55 * length, sample_time, level)
        chirp = _fast_chirp(limits, 0.3 * length, sample_time, mean=level, amplitude=0.15)
        low = _held(limits, 0.15 * length, sample_time, 0.0)
        pieces += [np.tile(np.concatenate([hold, chirp, low]), PROBES)]
    return np.concatenate(pieces)


def _staircase(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    return staircase(sample_time, limits.bottom, limits.top, levels=6, hold=seconds / 11)


def _triangles(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    rates = (2 / seconds, 8 / seconds, 8 / seconds, 8 / seconds, 8 / seconds)
    return triangles(sample_time, limits.bottom, limits.top, rates=rates)


def _long_hold(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    counts = [max(1, round(share * seconds / sample_time)) for share in (0.1, 0.6, 0.3)]
    return np.repeat(limits.at(np.array([0.0, 1.0, 0.3])), counts)


def _reversals(limits: Limits, seconds: float, sample_time: float, rng: np.random.Generator) -> np.ndarray:
    count = max(8, round(seconds / sample_time))
    held = limits.farthest * np.repeat([0.8, 1.0], -(-count // 2))[:count]
    return limits.rest + with_alternating_polarity(held, sample_time, seconds / 8)


REPERTOIRE: Mapping[str, Maker] = {
    "multisine of stepped amplitude and mean": _stepped_multisine,
    "the same multisine four times": _repeats,
    "steps with long holds": _holds,
    "random steps": _random_steps,
    "a slow sweep and a fast one": _sweeps,
    "a sine at two amplitudes": _two_sines,
    "holds with rests between them": _rests,
    "fast linear sweep": _chirp,
    "staircase up and down": _staircase,
    "triangles at two rates": _triangles,
    "long hold": _long_hold,
    "three holds and a fast linear sweep in turn": _rounds,
    "long holds, each followed by a fast sweep and a low hold": _probed_holds,
    "holds of alternating polarity": _reversals,
}
"""Waveforms of inputs, by name."""
