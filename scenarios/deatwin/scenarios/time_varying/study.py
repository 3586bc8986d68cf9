"""All computations of the scenario: the benchmark systems, and the six actuators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident import spawn_generators
from deatwin.ident.drifts import root_mean_square
from deatwin.ident.frequency import SlidingStatistics, design_excitation, sliding_mean_and_gain, tv_gfrf, tv_nofrf
from deatwin.ident.frequency.varying.maps import Map
from deatwin.ident.frequency.varying.short_time import ShortTime, compare_windows, series_error, windows_of
from deatwin.ident.narx import NarxModel, ThetaTrajectory, generate_terms
from deatwin.ident.narx.fleet.alike import OPERATING_INPUT, linear_in_output
from deatwin.ident.narx.fleet.records import thinned
from deatwin.ident.narx.varying_systems import SYSTEMS
from deatwin.ident.narx.wander import CONSTANT, VARYING, Track, follow_actuator
from deatwin.plant import Actuator, Recording, fleet
from deatwin.scenarios.time_varying.known import (
    LINES,
    SPEEDS,
    Followed,
    FrozenRun,
    Known,
    covered,
    follow,
    frozen_run,
    known_systems,
    lines,
)
from deatwin.studies.parallel import between, run_told
from deatwin.studies.voice import Progress

Array = NDArray[np.float64]
FACTOR = 6  # Every so many samples are kept: 0.12 s, as the story `semp-fleet` chooses for seed 0
DEGREE = 5
WINDOW = 100.0
"""Window of the sliding mean and gain, s: the mean of 100 s of the thesis' noise wanders by a few per cent of the stroke."""
SPECTRUM_WINDOW = 20.0
"""Window of the short-time spectra, s: 0.05 Hz from line to line, and a hundredth of what the slowest histories take."""
BAND = (0.05, 1.0)  # Band of the thesis' noise, Hz; the test signal for NOFRFs has lines there
LEVEL = 0.6  # Largest magnitude of the test signal, V: the thesis' standard deviation
SHOWN = (1, 2)  # Numbers of the actuators whose maps are drawn: the mean of the first falls, that of the second rises
MAP_TIMES = 90
REALISATIONS = 100  # Random walks whose maps are to cover the truth
COVERAGE_TIMES = np.linspace(1.0, 29.0, 8)
COVERAGE_HZ = np.array([0.2, 0.5, 1.0, 2.0, 4.0, 8.0])
STRUCTURE = tuple(generate_terms(1, (0, 1), DEGREE, rule=linear_in_output))
"""Terms of all actuators: y(k-1), and all products of u(k) and u(k-1) up to the fifth degree. Orders above the fifth vanish,
so that sums of G_n U_n are whole; and an operating point shifts parameters without making new terms."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """An actuator before and after its parameters were followed."""

    track: Track  # Its parameters along time, and what they are worth
    sliding: SlidingStatistics
    equilibrium: Map  # H_1 at the lowest frequency, for its equilibria along time
    judged: ShortTime  # Spectra of the blocks that the parameters were not fitted to
    whole: ShortTime | None  # Spectra of the whole recording, where they are drawn
    maps: Mapping[str, Map]  # TV-GFRFs along `LINES` and TV-NOFRFs "G1" to "G3", where they are drawn
    frozen: Mapping[str, float]  # Estimated frozen-time error of the TV-GFRFs, over their rms
    series_error: float  # Sum of the orders against the steady free run, over it

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.track.name

    @property
    def chance(self) -> float:
        """Smaller probability that a constant actuator shows as much change of mean or gain."""
        return min(self.sliding.p_mean, self.sliding.p_gain)


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All results of the study."""

    known: Known
    driven: tuple[Driven, ...]  # The six
    stories: tuple[str, ...]  # History of each, in one sentence

    @property
    def shown(self) -> tuple[Driven, ...]:
        """Actuators whose maps are drawn."""
        return tuple(one for one in self.driven if one.maps)


def carry_out(seed: int, *, jobs: int, progress: Progress) -> Study:
    """Run the whole study."""
    *of_systems, of_walks = np.random.SeedSequence(seed).spawn(len(SYSTEMS) + 1)
    walks = spawn_generators(int(of_walks.generate_state(1)[0]), REALISATIONS)
    places, actuators = range(len(SYSTEMS)), fleet(seed)
    driven = run_told(
        _drive,
        [(actuator, number in SHOWN) for number, actuator in enumerate(actuators, start=1)],
        jobs,
        between(progress, 0.0, 0.55),
        "following six actuators",
    )
    followed = run_told(
        _follow,
        [(place, np.random.default_rng(child)) for place, child in zip(places, of_systems, strict=True)],
        jobs,
        between(progress, 0.55, 0.7),
        "following systems whose parameters are known",
    )
    frozen = run_told(
        _frozen_run,
        [(place, speed) for place in places for speed in SPEEDS],
        jobs,
        between(progress, 0.7, 0.8),
        "frozen time against the rate of variation",
    )
    held = run_told(
        covered,
        [(rng, COVERAGE_TIMES, COVERAGE_HZ) for rng in walks],
        jobs,
        between(progress, 0.8, 0.92),
        "coverage of the truth",
    )
    runs = tuple(run for each in frozen for run in each)
    known = known_systems(tuple(followed), runs, held, COVERAGE_TIMES, COVERAGE_HZ)
    return Study(known=known, driven=tuple(driven), stories=tuple(actuator.story for actuator in actuators))


def _drive(actuator: Actuator, drawn: bool) -> Driven:
    record = actuator.record().recordings[0]
    return analyse(actuator.name, record, thinned(record, FACTOR), drawn=drawn)


def _follow(place: int, rng: np.random.Generator) -> Followed:
    return follow(SYSTEMS[place], rng)  # its functions of time are not sent to workers


def _frozen_run(place: int, speed: float) -> list[FrozenRun]:
    return frozen_run(SYSTEMS[place], speed)


def analyse(name: str, record: Recording, kept: Recording, *, drawn: bool) -> Driven:
    """Follow an actuator's parameters, and compute what is said and drawn of them."""
    track = follow_actuator(name, kept, STRUCTURE)
    sources: dict[str, NarxModel | ThetaTrajectory] = {CONSTANT: track.held_constant, VARYING: track.held}
    windows = windows_of(kept, SPECTRUM_WINDOW) if drawn else []
    timepts = np.linspace(track.trajectory.timepts[0], track.trajectory.timepts[-1], MAP_TIMES)
    about: dict[str, Any] = {"timepts": timepts, "operating_input": OPERATING_INPUT}
    maps, frozen = _maps(track, about) if drawn else ({}, {})
    return Driven(
        track=track,
        sliding=sliding_mean_and_gain(record, WINDOW),
        equilibrium=Map.of(tv_gfrf(track.trajectory, 1, [2 * np.pi * BAND[0]], **about)),
        judged=compare_windows(track.judged, sources, OPERATING_INPUT),
        whole=compare_windows(windows, {VARYING: track.trajectory}, OPERATING_INPUT) if windows else None,
        maps=maps,
        frozen=frozen,
        series_error=series_error(track.held, track.judged[0], OPERATING_INPUT),
    )


def _maps(track: Track, about: Mapping[str, Any]) -> tuple[dict[str, Map], dict[str, float]]:
    """TV-GFRFs and TV-NOFRFs, and the estimated frozen-time error of the former."""
    frequencies = np.linspace(BAND[0], 2.0, 40)
    of_lines = {name: tv_gfrf(track.trajectory, len(LINES[name]), lines(frequencies, name), **about) for name in LINES}
    signal = design_excitation(BAND, track.recording.sample_time, amplitude=LEVEL, period=20.4)
    of_signal = {f"G{n}": tv_nofrf(track.trajectory, signal.values, n, **about) for n in (1, 2, 3)}
    frozen = {
        name: root_mean_square(response.frozen_error) / root_mean_square(response.values)
        for name, response in of_lines.items()
    }
    return {name: Map.of(response) for name, response in (of_lines | of_signal).items()}, frozen
