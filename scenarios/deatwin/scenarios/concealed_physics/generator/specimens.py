"""Make the specimen of a case: an apparatus with mechanisms of the right strength, its records, and the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from deatwin.ident.greybox.structural import StructuralScale
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.records import plain
from deatwin.plant.simulate import RunStatus
from deatwin.scenarios.concealed_physics.generator import MECHANISMS
from deatwin.scenarios.concealed_physics.generator.apparatus import (
    Apparatus,
    Rigging,
    SensorNoise,
    drawn_rig,
    with_added_mass,
)
from deatwin.scenarios.concealed_physics.generator.mechanism import Mechanism, Setting
from deatwin.scenarios.concealed_physics.generator.waves import RICH, commands

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
    kind: str  # Purpose: clean, effect, outside, pair or tie
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
    noise_free: tuple[np.ndarray, ...]  # Readings without noise of the records, then of the check, m
    apparatus: Apparatus

    @property
    def whole(self) -> Experiment:
        """Records and check as one experiment, the check last."""
        return Experiment(recordings=(*self.experiments[0].recordings, *self.check.recordings))

    @property
    def parameters(self) -> dict[str, float]:
        """True values, SI, by the name of the catalogue's parameter, if a mechanism has the same one."""
        return {k: v for m in self.apparatus.mechanisms for k, v in m.catalogue_values().items()}

    @property
    def concealed(self) -> dict[str, dict[str, float]]:
        """Parameters of each concealed mechanism, SI."""
        return {m.name: plain(m) for m in self.apparatus.mechanisms}

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
        try:
            if _is_borne(rigging, whole):
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


def _is_borne(rigging: Rigging, experiment: Experiment) -> bool:
    """Return whether the reduced film tolerates slightly higher commands."""
    raised = tuple(replace(r, inputs=CLEAR * r.inputs) for r in experiment.recordings)
    return rigging.reduced.simulate(Experiment(recordings=raised)).status is RunStatus.DONE


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
    if spec.effects:
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
        noise_free=readings,
        apparatus=apparatus,
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
        setting = Setting(
            seconds=fitted.end,
            commands=np.concatenate([r.inputs[0] for r in fitted.recordings]),
            displacement=np.concatenate(clean[:-1]),
        )
        scale = StructuralScale.of(rigging.reduced, fitted, clean[:-1], bare.noise.rms)
        return cls(bare=bare, whole=whole, scale=scale, setting=setting)

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
