"""Make the specimen of a case: waveforms, an apparatus with mechanisms of the right strength, its records, and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from deatwin.ident.greybox.structural import StructuralScale
from deatwin.plant.errors import SimulationError
from deatwin.plant.excitation import (
    band_limited_noise,
    linear_chirp,
    random_holds,
    random_phase_multisine,
    with_alternating_polarity,
)
from deatwin.plant.integrator.rosenbrock import integrate
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.diaphragm import BALLS, Diaphragm
from deatwin.plant.simulate import RunStatus
from deatwin.scenarios.concealed_physics.generator.mechanism import Drive, Mechanism, Reading, Setting
from deatwin.scenarios.concealed_physics.generator.mechanisms import MECHANISMS

RICH = ("noise", "fast_noise", "noise_and_holds", "multisine", "chirp", "stairs_and_noise", "both_polarities")
"""Each distinguishes mechanisms by itself; holds alone say little of what is fast."""


def commands(
    name: str, rng: np.random.Generator, seconds: float, sample_time: float, lower: float, upper: float
) -> np.ndarray:
    """Draw commands between two voltages, rounded as an output of 16 bit does. Shapes: returns (n,), V."""
    wave: np.ndarray = getattr(_Waves(rng=rng, seconds=seconds, step=sample_time, lower=lower, upper=upper), name)()
    return wave.round(4)


@dataclass(frozen=True, kw_only=True)
class _Waves:
    """Range and length of the commands; each waveform is a method that returns shape (n,), V."""

    rng: np.random.Generator
    seconds: float
    step: float  # s
    lower: float  # V
    upper: float  # V

    def noise(self, band: float = 1.0) -> np.ndarray:
        """The thesis' noise: mean and variance lie in the range as they do there."""
        span = self.upper - self.lower
        return band_limited_noise(
            self.rng,
            self.seconds,
            self.step,
            mean=self.lower + 0.49 * span,
            variance=(0.226 * span) ** 2,
            band=band,
            lower=self.lower,
            upper=self.upper,
        )

    def fast_noise(self) -> np.ndarray:
        return self.noise(band=5.0)

    def holds(self, shortest: float = 2.0, longest: float = 25.0) -> np.ndarray:
        ends = {"lower": self.lower, "upper": self.upper}
        return random_holds(self.rng, self.seconds, self.step, **ends, shortest=shortest, longest=longest)

    def multisine(self) -> np.ndarray:
        """Three periods of a multisine to 5 Hz."""
        period = self.step * round(self.seconds / 3 / self.step)
        lines = np.arange(1, int(5.0 * period))
        wave = random_phase_multisine(
            self.rng,
            period,
            self.step,
            lines,
            rms=0.2 * (self.upper - self.lower),
            mean=(self.lower + self.upper) / 2,
            amplitudes=lines**-0.5,
            periods=3,
            lower=-np.inf,
            upper=np.inf,
        )
        return self._of_length(np.clip(wave, self.lower, self.upper))

    def chirp(self) -> np.ndarray:
        """A quarter of noise, a quarter of a chirp through the ball's resonance, and both again."""
        span, parts = self.upper - self.lower, []
        for _ in range(2):
            parts.append(replace(self, seconds=self.seconds / 4).noise())
            last, middle = self.rng.uniform(12.0, 20.0), self.lower + self.rng.uniform(0.4, 0.6) * span
            sweep = {"first": 2.0, "last": last, "mean": middle, "amplitude": 0.15 * span}
            parts.append(linear_chirp(self.seconds / 4, self.step, **sweep))
        return self._of_length(np.concatenate(parts))

    def noise_and_holds(self) -> np.ndarray:
        half = replace(self, seconds=self.seconds / 2)
        return self._of_length(np.concatenate([half.fast_noise(), half.holds(shortest=1.0, longest=12.0)]))

    def stairs_and_noise(self) -> np.ndarray:
        """A staircase with a little noise on every step."""
        levels = self.rng.permutation(np.linspace(self.lower, self.upper, 8)[1:-1])
        stair = self._of_length(np.repeat(levels, round(self.seconds / 6 / self.step) + 1))
        size = {"mean": 0.0, "variance": (0.1 * (self.upper - self.lower)) ** 2, "band": 3.0}
        wobble = band_limited_noise(self.rng, self.seconds, self.step, **size, lower=-np.inf, upper=np.inf)
        return np.clip(stair + wobble, self.lower, self.upper)

    def both_polarities(self) -> np.ndarray:
        return with_alternating_polarity(self.noise(), self.step, self.rng.uniform(8.0, 15.0))

    def one_level(self) -> np.ndarray:
        """A constant level with a sine of a few hundredths of the range."""
        times, span = self.step * np.arange(round(self.seconds / self.step)), self.upper - self.lower
        angle = 2 * np.pi * self.rng.uniform(0.3, 0.6) * times
        return self.lower + self.rng.uniform(0.5, 0.8) * span + 0.02 * span * np.sin(angle)

    def _of_length(self, wave: np.ndarray) -> np.ndarray:
        """Cut the wave to its length, or hold its last value."""
        n = round(self.seconds / self.step)
        return np.pad(wave[:n], (0, max(n - wave.size, 0)), mode="edge")


FILM_ERROR = 0.2  # By how much a film's parameter may lie beside the published one, as a share
FITTED = ("shear_modulus", "stretch_limit", "branch_modulus", "branch_time", "permittivity", "damping")
ELEMENTS = 5  # Elements of the fine film under its electrode: another mesh than the one that gives a plant's own error
BALL_TOLD, READ_AT_START = 0.6, 0.15
"""Shares of rig files that tell how the film sits on the ball, and of rigs read at the start of a hold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rigging:
    """A rig as described to the diagnosis, and as it really is."""

    nominal: Plant  # As the rig file describes it
    actual: Plant  # The film that is there, on a fine mesh
    reduced: Plant  # The same film on the diagnosis' mesh
    before: tuple[tuple[float, float], ...]  # History: commands in V, each with how long it was held in s


def drawn_rig(rng: np.random.Generator, *, usual: bool = False) -> Rigging:
    """Draw a rig; usual ones have the same ball contact and reading time, so that they share compiled equations."""
    ball = str(rng.choice(BALLS))
    told = bool(rng.random() < BALL_TOLD)
    if usual:
        ball, told = Diaphragm.ball, True
    rig = Diaphragm(
        material="VHB 4905",
        thickness=round(0.5e-3 * rng.uniform(0.9, 1.1), 6),
        prestretch=round(rng.uniform(3.3, 3.8), 2),
        frame_radius=round(40e-3 * rng.uniform(0.9, 1.1), 4),
        electrode_radius=round(17.5e-3 * rng.uniform(0.9, 1.1), 4),
        contact_radius=round(rng.uniform(1.5e-3, 3.5e-3), 4),
        mass=round(rng.uniform(2e-3, 4e-3), 5),
        start_ramp=round(rng.uniform(1.0, 3.0), 1),
        start_hold=round(rng.uniform(2.0, 4.0), 1),
        ball=ball if told else Diaphragm.ball,
        ball_is_known=told,
    )
    nominal = Plant(rig=rig)
    values = {name: nominal.parameters[name].value * (1 + FILM_ERROR * rng.uniform(-1, 1)) for name in FITTED}
    at_start = rng.random() < READ_AT_START and not usual
    there = replace(rig, ball=ball, reading=ReadingTime.START_OF_HOLD if at_start else ReadingTime.END_OF_HOLD)
    fine = replace(there, resolution="fine", elements=ELEMENTS)
    before = ((rng.uniform(0.5, 2.0), rng.uniform(5.0, 30.0)), (0.0, rng.uniform(60.0, 600.0)))
    return Rigging(
        nominal=nominal, actual=Plant(rig=fine, values=values), reduced=Plant(rig=there, values=values), before=before
    )


def with_added_mass(plant: Plant, added: float) -> Plant:
    """Return the plant of a diaphragm with a heavier ball."""
    rig = plant.rig
    if not isinstance(rig, Diaphragm):
        raise TypeError(f"a {type(rig).__name__} has no ball; the study's rigs are diaphragms")
    return plant.with_rig(replace(rig, mass=rig.mass + added))


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """White, first-order coloured noise and rounding: r = round_q(y + w + c), c_k = a c_{k-1} + sqrt(1 - a^2) n_k."""

    rms: float
    coloured: float  # Share of the variance of w + c that c has
    pole: float  # a, between 0 and 1
    step: float  # q, m

    @classmethod
    def drawn(cls, rng: np.random.Generator, rms: float) -> Self:
        """Draw noise of a given size."""
        step = rms * rng.uniform(0.1, 1.0)
        return cls(rms=rms, coloured=rng.uniform(0.1, 0.5), pole=rng.uniform(0.3, 0.85), step=step)

    def added(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Add noise and round. Shapes: `values` (n,); returns (n,)."""
        from scipy.signal import lfilter

        random = np.sqrt(self.rms**2 - self.step**2 / 12)
        white, pushes = rng.standard_normal((2, values.size))
        start = [self.pole * pushes[0]]  # stationary from the first sample on
        rest, _ = lfilter([np.sqrt(1 - self.pole**2)], [1, -self.pole], pushes[1:], zi=start)
        coloured = np.concatenate([pushes[:1], rest])
        noisy = values + random * (np.sqrt(1 - self.coloured) * white + np.sqrt(self.coloured) * coloured)
        return np.round(noisy / self.step) * self.step


@dataclass(frozen=True, kw_only=True, eq=False)
class Apparatus:
    """A film with concealed mechanisms, a history and a sensor: it takes commands and gives readings."""

    plant: Plant  # The film that is there, without mechanisms
    mechanisms: tuple[Mechanism, ...]
    before: tuple[tuple[float, float], ...]  # History: commands in V, each with how long it was held in s
    noise: SensorNoise
    seed: int

    def readings(self, experiment: Experiment, run: int = 0) -> tuple[np.ndarray, ...]:
        """Read each recording without the sensor's noise. Shapes: returns (n,)."""
        timeline = self.plant.timeline(experiment)
        step = timeline.sample_time
        before = np.array([seconds for _, seconds in self.before])
        times = np.concatenate(
            [timeline.start - np.cumsum(before[::-1])[::-1], timeline.start + step * np.arange(timeline.commands.size)]
        )
        wished = np.concatenate([[command for command, _ in self.before], timeline.commands])
        rows = [timeline.start + step * (r + 1) for r in timeline.readings]
        reads = np.concatenate([[timeline.start], *rows])
        drive, rng = Drive(times=times, commands=wished), np.random.default_rng([self.seed, run])
        for mechanism in self.mechanisms:
            drive = mechanism.commanded(drive, rng)
        values = self._integrated(drive, reads)
        commands = np.concatenate([wished[before.size :][:1], *(r.inputs[0] for r in experiment.recordings)])
        for mechanism in self.mechanisms:
            values = mechanism.read(Reading(times=reads, values=values, commands=commands), rng)
        ends = 1 + np.cumsum([r.n_samples for r in experiment.recordings])
        return tuple(np.split(values[1:] - values[0], ends[:-1] - 1))

    def noisy(self, experiment: Experiment, readings: Sequence[np.ndarray], rng: np.random.Generator) -> Experiment:
        """Add the sensor's noise to readings; an advised record has commands only and learns here what is read."""
        rig, pairs = self.plant.rig, zip(experiment.recordings, readings, strict=True)
        return Experiment(
            recordings=tuple(
                replace(
                    record,
                    outputs=self.noise.added(reading, rng)[None],
                    output_names=(rig.output_name,),
                    output_units=(rig.output_unit,),
                )
                for record, reading in pairs
            )
        )

    def _integrated(self, drive: Drive, reads: np.ndarray) -> np.ndarray:
        plant = self.plant.with_effects(*(e for m in self.mechanisms for e in m.effects))
        equations = plant.equations
        inputs = equations.inputs(drive.commands, drive.rest_command, drive.times, drive.channels)
        return integrate(
            equations, plant.free_values, drive.times, inputs, reads, rest_command=drive.rest_command
        ).outputs


SECONDS, CHECK_SECONDS = 120.0, 48.0
LOWEST, HIGHEST = 1.1, 3.75  # Range of the thesis' commands, V
LEAST_NOISE = 1e-6  # Rms noise of a laser sensor, m: it shows where the motion is very small
CLEAR = 1.04  # The film bears this many times the highest command
LOWER, RETRIES = 0.93, 12  # Factor on the highest command if the film does not bear it, and number of attempts
NEAR, CORRECTIONS = 0.1, 4  # Tolerance of a ratio to first order, and corrections that are made to reach it
WITHIN, REFITS = 0.2, 4  # Tolerance of the ratio after a full refit, and number of refits
LEAST = 1e-3  # Share of a mechanism's largest size below which a film that does not bear it calls for lower voltages


@dataclass(frozen=True, kw_only=True)
class CaseSpec:
    """A case: what is concealed, how strongly, and in what kind of recording."""

    name: str  # Unique in its study; fit for a file name
    kind: str  # Purpose: clean, dirt, effect, outside, pair or tie
    effects: tuple[str, ...]  # Concealed mechanisms
    truth: tuple[str, ...]  # A catalogue name for each of them; empty where the catalogue has none
    rivals: tuple[str, ...] = ()  # Names that the input of a tie cannot distinguish, the truth among them
    target_ratio: float
    seed: int
    excitation: str  # A waveform, or one for each record, joined by ``+``
    records: int = 1  # Records of the experiment
    noise_share: float = 0.02  # Rms of the sensor's noise over the standard deviation of the motion
    rich: bool = True  # True if the input distinguishes mechanisms
    form: str = "drawn"  # Form of the rig (ball, reading time): ``drawn``, or ``usual`` as in most rigs
    library: tuple[str, ...] = ()  # Effects that the diagnosis knows; empty for the whole catalogue


@dataclass(frozen=True, kw_only=True, eq=False)
class Specimen:
    """A case in the form that the diagnosis gets, together with the truth, which only the score uses."""

    plant: Plant
    experiments: tuple[Experiment, ...]  # Records for the diagnosis, with readings, m
    check: Experiment  # A further record on the same clock, of another waveform; its readings are for judging only
    truth: tuple[str, ...]  # A catalogue name for each mechanism
    ratio: float  # Structural residual of all mechanisms together over the noise; 0 where there are none
    ratios: Mapping[str, float]  # The same for each mechanism alone
    noise: float  # Rms of the sensor's noise, m
    apparatus: Apparatus

    @property
    def whole(self) -> Experiment:
        """Records and check as one experiment, the check last."""
        return Experiment(recordings=(*self.experiments[0].recordings, *self.check.recordings))

    @property
    def parameters(self) -> dict[str, float]:
        """True values, SI, of the film and of mechanisms that the catalogue has too, by name in the diagnosis."""
        film = {name: self.apparatus.plant.parameters[name].value for name in FITTED}
        return film | {k: v for m in self.apparatus.mechanisms for k, v in m.catalogue_values().items()}

    def record(self, experiment: Experiment, seed: int) -> Experiment:
        """Record other commands on the same apparatus, from rest."""
        rng = np.random.default_rng([self.apparatus.seed, seed, 7])
        return self.apparatus.noisy(experiment, self.apparatus.readings(experiment, run=1 + seed), rng)

    def heavier(self, added: float) -> Self:
        """Add a mass to the load; the experimenter knows it."""
        apparatus = replace(self.apparatus, plant=with_added_mass(self.apparatus.plant, added))
        return replace(self, plant=with_added_mass(self.plant, added), apparatus=apparatus)


def make(spec: CaseSpec, *, seconds: float = SECONDS, check_seconds: float = CHECK_SECONDS) -> Specimen:
    """Make the specimen of a case: the same bytes for the same case on the same computer."""
    rng = np.random.default_rng(spec.seed)
    rigging = drawn_rig(rng, usual=spec.form == "usual")
    waves = int(rng.integers(2**32))
    shapes = int(rng.integers(2**32))
    highest, last = HIGHEST, ""
    for _ in range(RETRIES):
        whole = _commands(spec, rigging, np.random.default_rng(waves), seconds, check_seconds, highest)
        raised = Experiment(recordings=tuple(replace(r, inputs=CLEAR * r.inputs) for r in whole.recordings))
        try:
            if rigging.reduced.simulate(raised).status is RunStatus.DONE:
                return _made(spec, rigging, whole, np.random.default_rng(shapes))
        except SimulationError as error:
            last = f": {error}"
        highest = LOWEST + LOWER * (highest - LOWEST)
    raise SimulationError(f"case {spec.name}: the film tolerates none of the command ranges that were tried{last}")


def _commands(
    spec: CaseSpec, rigging: Rigging, rng: np.random.Generator, seconds: float, check_seconds: float, highest: float
) -> Experiment:
    """Draw the commands of records and check on one clock."""
    step, start, records = rigging.nominal.rig.sample_time, 0.0, []
    names = spec.excitation.split("+")
    for k in range(spec.records):
        wave = commands(names[k % len(names)], rng, seconds / spec.records, step, LOWEST, highest)
        records.append(_silent(wave, step, start))
        start = records[-1].end
    other = str(rng.choice([name for name in RICH if name not in (*names, "both_polarities")]))
    # A little inside the range: a check is to interpolate.
    wave = commands(other, rng, check_seconds, step, LOWEST, LOWEST + 0.95 * (highest - LOWEST))
    return Experiment(recordings=(*records, _silent(wave, step, start)))


def _silent(wave: np.ndarray, step: float, start: float) -> Recording:
    return Recording(inputs=wave[None], outputs=np.zeros((1, wave.size)), sample_time=step, start=start)


def _made(spec: CaseSpec, rigging: Rigging, whole: Experiment, rng: np.random.Generator) -> Specimen:
    count = len(whole.recordings) - 1
    silent = SensorNoise(rms=0.0, coloured=0.0, pole=0.0, step=0.0)
    bare = Apparatus(plant=rigging.actual, mechanisms=(), before=rigging.before, noise=silent, seed=spec.seed)
    readings = bare.readings(whole)
    rms = max(spec.noise_share * float(np.std(np.concatenate(readings[:count]))), LEAST_NOISE)
    noise = SensorNoise.drawn(rng, float(f"{rms:.2g}"))
    nominal = rigging.nominal.with_rig(replace(rigging.nominal.rig, noise=noise.rms))
    apparatus, ratio = replace(bare, noise=noise), 0.0
    ratios: dict[str, float] = {}
    if spec.kind == "dirt":  # as large as it is
        setting = _setting(whole, readings)
        dirt = tuple(MECHANISMS[name].drawn(rng, setting) for name in spec.effects)
        apparatus = replace(apparatus, mechanisms=dirt)
        readings = apparatus.readings(whole)
    elif spec.effects:
        sizing = _Sizing.of(rigging, apparatus, whole, readings)
        apparatus, readings, ratios = sizing.concealed(spec, rng)
        ratio = next(iter(ratios.values())) if len(ratios) == 1 else sizing.scale.ratio(readings[:count])
    recorded = apparatus.noisy(whole, readings, rng).recordings
    return Specimen(
        plant=nominal,
        experiments=(Experiment(recordings=recorded[:count]),),
        check=Experiment(recordings=recorded[count:]),
        truth=spec.truth,
        ratio=ratio,
        ratios=ratios,
        noise=noise.rms,
        apparatus=apparatus,
    )


def _setting(whole: Experiment, clean: tuple[np.ndarray, ...]) -> Setting:
    """Describe the clean records that are diagnosed, which are all but the last."""
    fitted = Experiment(recordings=whole.recordings[:-1])
    return Setting(
        seconds=fitted.end,
        commands=np.concatenate([r.inputs[0] for r in fitted.recordings]),
        displacement=np.concatenate(clean[:-1]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sizing:
    """Finds the strength of a mechanism for a given mismatch-to-noise ratio."""

    bare: Apparatus
    whole: Experiment
    scale: StructuralScale
    setting: Setting

    @classmethod
    def of(cls, rigging: Rigging, bare: Apparatus, whole: Experiment, clean: tuple[np.ndarray, ...]) -> Self:
        fitted = Experiment(recordings=whole.recordings[:-1])
        scale = StructuralScale.of(rigging.reduced, fitted, clean[:-1], bare.noise.rms)
        return cls(bare=bare, whole=whole, scale=scale, setting=_setting(whole, clean))

    def concealed(
        self, spec: CaseSpec, rng: np.random.Generator
    ) -> tuple[Apparatus, tuple[np.ndarray, ...], dict[str, float]]:
        """Conceal all mechanisms of a case; return apparatus, readings, and the ratio of each mechanism alone."""
        mechanisms: list[Mechanism] = []
        ratios: dict[str, float] = {}
        readings: tuple[np.ndarray, ...] = ()
        for name in spec.effects:
            drawn = MECHANISMS[name].drawn(rng, self.setting)
            mechanism, readings, ratios[name] = self.sized(drawn, spec.target_ratio)
            mechanisms.append(mechanism)
        apparatus = replace(self.bare, mechanisms=tuple(mechanisms))
        return apparatus, apparatus.readings(self.whole) if len(mechanisms) > 1 else readings, ratios

    def sized(self, mechanism: Mechanism, target: float) -> tuple[Mechanism, tuple[np.ndarray, ...], float]:
        """Give a mechanism the strength that a ratio needs, or its largest; return it with its readings and ratio."""
        aim, last = target, np.inf
        for _ in range(REFITS):
            mechanism, readings, guess = self._guessed(mechanism, aim)
            ratio = self.scale.ratio(readings[:-1])
            if abs(ratio / target - 1) < WITHIN or (ratio < target and mechanism.size == last):
                break
            # A base plant that is moved far gives way more than to first order.
            aim, last = guess * float(np.clip(target / max(ratio, 1e-6), 0.2, 8.0)), mechanism.size
            if ratio < target and mechanism.size >= mechanism.largest:
                break
        return mechanism, readings, ratio

    def _guessed(self, mechanism: Mechanism, aim: float) -> tuple[Mechanism, tuple[np.ndarray, ...], float]:
        """Size a mechanism to first order of the refit; return it with its readings and ratio."""
        tried: list[tuple[float, float]] = []
        most = mechanism.largest
        while True:
            try:
                readings = replace(self.bare, mechanisms=(mechanism,)).readings(self.whole)
            except SimulationError:  # more than the film bears
                most = 0.6 * mechanism.size
                if most < LEAST * mechanism.largest:
                    raise
                mechanism = mechanism.sized(most)
                continue
            guess = self.scale.guess(readings[:-1])
            tried.append((mechanism.size, guess))
            at_end = mechanism.size >= most and guess <= aim
            if abs(guess / aim - 1) < NEAR or at_end or len(tried) > CORRECTIONS:
                return mechanism, readings, guess
            mechanism = mechanism.sized(min(_next_size(tried, aim), most))


def _next_size(tried: list[tuple[float, float]], target: float) -> float:
    """Return the size at which the ratio should meet its target, from a power law through the last two trials."""
    (size, ratio), power = tried[-1], 1.0
    for (first, low), (second, high) in pairwise(tried[-2:]):
        if low > 0 and high > 0 and first != second:
            power = float(np.clip(np.log(high / low) / np.log(second / first), 0.4, 3.0))
    factor = (target / max(ratio, 1e-3 * target)) ** (1 / power)
    return size * float(np.clip(factor, 0.02, 20.0))
