"""All computations of the scenario: systems whose parameters are known at every instant, and the six actuators."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident import spawn_generators
from deatwin.ident.frequency import (
    SlidingStatistics,
    design_excitation,
    hold_equilibrium,
    sliding_mean_and_gain,
    tv_gfrf,
    tv_nofrf,
)
from deatwin.ident.frequency.varying.response import Map
from deatwin.ident.frequency.varying.short_time import ShortTime, compare_windows, series_error, windows_of
from deatwin.ident.narx import FitStatus, NarxModel, ThetaSmoother, ThetaTrajectory, generate_terms
from deatwin.ident.narx.fleet import OPERATING_INPUT, linear_in_output, thinned
from deatwin.ident.narx.recursive import Structure
from deatwin.ident.narx.varying_systems import (
    CONSTANT,
    DURATION,
    MOVING_DC,
    NOISE,
    STEP,
    SYSTEMS,
    VARYING,
    KnownSystem,
    Track,
    drawn_walk,
    follow_actuator,
    recorded,
)
from deatwin.plant import Actuator, Recording, fleet
from deatwin.plant.arrays import Array, Complex, root_mean_square
from deatwin.studies.parallel import between, run_told
from deatwin.studies.voice import Progress

H1, H2_SUM, H2_DIFFERENCE = "H1", "H2, f2 = f1", "H2, f2 = -f1"
LINES: Mapping[str, tuple[float, ...]] = {H1: (1.0,), H2_SUM: (1.0, 1.0), H2_DIFFERENCE: (1.0, -1.0)}
"""Lines along which responses are drawn: each tone's frequency over the first's."""
ORDERS = (1, 2, 3)
TIMES = 100  # Times of a map
SPEEDS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""How often the parameters go there and back in `DURATION`, where the frozen-time error is measured."""
PROBE = 3e-3  # Amplitude of the tones that measure responses: orders above the second are then 1e-5 of the first two
PROBED = (0.3, 0.8, 1.5)  # Frequencies of these tones, Hz
SETTLED = 30.0  # Time after which the start is forgotten, s: 0.92 to the power 600
WALK = {"1": 0.1, "y(k-1)": 0.6, "u(k-1)": 0.5, "y(k-1)u(k-1)": 0.15}  # Start of the random walks of the coverage
WANDER = (0.05, 0.08, 0.08, 0.05)  # Standard deviations of the walks at their end
WALK_SAMPLES = 600
CHI_SQUARE = 5.991464547107979  # 95 % of the squared distances of complex normal numbers from their mean lie below


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A known system, its recording, and the parameters and responses found."""

    name: str
    truth: ThetaTrajectory  # Parameters of the system
    trajectory: ThetaTrajectory  # Parameters that the smoother finds
    true: Mapping[str, Map]  # TV-GFRFs along `LINES` and TV-NOFRFs "G1" to "G3" of the system
    found: Mapping[str, Map]  # Those of the parameters found

    @property
    def covered(self) -> Array:
        """Share of the instants at which the 95 % band of each parameter holds the truth, shape (n_terms,)."""
        places = self.truth.timepts.size - self.trajectory.timepts.size
        error = np.abs(self.trajectory.theta - self.truth.theta[:, places:])
        return np.asarray(np.mean(error <= 1.96 * self.trajectory.std, axis=1))

    def error(self, name: str) -> float:
        """Root mean square error of a response over its map, over the root mean square of the true one."""
        true = self.true[name].values
        return root_mean_square(self.found[name].values - true) / root_mean_square(true)


@dataclass(frozen=True, kw_only=True)
class FrozenRun:
    """How far the frozen-time response is from the true one, at one rate of variation."""

    system: str
    response: str  # One of `LINES`
    speed: float  # One of `SPEEDS`
    error: float  # Over the response, rms
    estimate: float  # Its estimate from the rate of variation
    corrected: float  # Error that is left after the correction to first order


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """All known systems."""

    followed: tuple[Followed, ...]
    solved: Mapping[int, Map]  # H_n of the moving DC by order, its equilibrium solved for at each time
    held: Mapping[int, Map]  # The same with the equilibrium held
    frozen: tuple[FrozenRun, ...]  # Both systems, all speeds
    coverage: Mapping[int, NDArray[np.bool_]]  # By order, shape (n_realisations, n_times, n), as `COVERAGE_TIMES`


def smoothed(structure: Structure, recording: Recording) -> ThetaTrajectory:
    """Estimate theta(t), with drift variances from the posterior mode."""
    smoother = ThetaSmoother(terms=structure, variances="posterior").fit(recording)
    if smoother.status_ is FitStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return smoother.trajectory_


def lines(frequencies: Array, name: str) -> Array:
    """Angular frequencies along one of `LINES`. Shapes: `frequencies` (n,); returns (n,), rad/s."""
    tones = 2 * np.pi * np.outer(frequencies, LINES[name])
    return tones[:, 0] if len(LINES[name]) == 1 else tones


def follow(system: KnownSystem, rng: np.random.Generator) -> Followed:
    """Record a known system, estimate its parameters along time, and compute both sides' responses."""
    truth, inputs = system.truth(), system.excitation(rng)
    recording = recorded(truth, inputs, NOISE * rng.standard_normal(inputs.size))
    trajectory = smoothed(system.structure, recording)
    return Followed(
        name=system.name,
        truth=truth,
        trajectory=trajectory,
        true=_responses(system, truth),
        found=_responses(system, trajectory),
    )


def _responses(system: KnownSystem, trajectory: ThetaTrajectory) -> dict[str, Map]:
    timepts = np.linspace(1.0, DURATION - 1.0, TIMES)
    frequencies = np.linspace(0.05, 0.8 * system.band, 60)
    about: dict[str, Any] = {"timepts": timepts, "operating_input": 0.0}
    names = [H1] if system.is_linear else list(LINES)
    responses = {name: tv_gfrf(trajectory, len(LINES[name]), lines(frequencies, name), **about) for name in names}
    found = {name: Map.of(response) for name, response in responses.items()}
    if not system.is_linear:
        signal = design_excitation((0.1, system.band / 3), STEP, amplitude=2 * system.amplitude, period=20.0)
        for order in ORDERS:
            response = tv_nofrf(trajectory, signal.values, order, timepts=timepts[::2], operating_input=0.0)
            found[f"G{order}"] = Map.of(response)
    return found


def _dc_effect() -> tuple[dict[int, Map], dict[int, Map]]:
    """H_n of the moving DC by order, with the equilibrium solved for at each time, and held where it was at first."""
    truth, timepts = MOVING_DC.truth(), np.linspace(0.0, DURATION - STEP, TIMES)
    tones = {n: np.full((1, n) if n > 1 else 1, 2 * np.pi * 0.1) for n in ORDERS}
    solved, held = (
        {n: Map.of(tv_gfrf(trajectory, n, tones[n], timepts=timepts, operating_input=0.0)) for n in ORDERS}
        for trajectory in (truth, hold_equilibrium(truth, 0.0, 0.0))
    )
    return solved, held


def frozen_run(system: KnownSystem, speed: float) -> list[FrozenRun]:
    """Measure the frozen-time error of H_1, and of H_2(f, f) of the nonlinear system, by tones."""
    truth = system.truth(speed)
    cycle = DURATION / speed
    first = max(SETTLED, DURATION - cycle)
    places = np.unique(np.linspace(first / STEP, truth.timepts.size - 1, TIMES).round().astype(int))
    timepts = truth.timepts[places]
    found = []
    for name in (H1,) if system.is_linear else (H1, H2_SUM):
        frozen = tv_gfrf(truth, len(LINES[name]), lines(np.array(PROBED), name), timepts=timepts, operating_input=0.0)
        measured = np.stack([_probed(truth, 2 * np.pi * f, len(LINES[name]))[places] for f in PROBED], axis=1)
        inner = slice(1, -1)  # at the ends the rate of variation is one-sided
        error = (measured - frozen.values)[inner]
        size = root_mean_square(measured)
        found.append(
            FrozenRun(
                system=system.name,
                response=name,
                speed=speed,
                error=root_mean_square(error) / size,
                estimate=root_mean_square(frozen.frozen_error[inner]) / size,
                corrected=root_mean_square(error - frozen.frozen_correction[inner]) / size,
            )
        )
    return found


def _probed(truth: ThetaTrajectory, omega: float, order: int) -> Complex:
    """H_1(t, w) or H_2(t, w, w) of the system that varies, by simulation, shape (n,)."""

    def run(phase: float, sign: float) -> Array:
        tone = sign * PROBE * np.cos(omega * truth.timepts + phase)
        return recorded(truth, tone, np.zeros(tone.size)).outputs[0]

    def part(phase: float) -> Array:
        plus, minus = run(phase, 1.0), run(phase, -1.0)
        return (plus - minus) / 2 if order == 1 else (plus + minus) / 2

    turn = np.exp(-1j * order * omega * truth.timepts)
    if order == 1:
        return np.asarray((part(0.0) + 1j * part(-np.pi / 2)) * turn / PROBE)
    real, imaginary = part(0.0) - part(np.pi / 2), part(-np.pi / 4) - part(np.pi / 4)
    return np.asarray((real + 1j * imaginary) * turn / PROBE**2)


def covered(rng: np.random.Generator, timepts: Array, frequencies: Array) -> dict[int, NDArray[np.bool_]]:
    """Draw a random walk, record, estimate, and test whether the ellipses hold the truth, (n_times, n)."""
    truth = drawn_walk(WALK, WANDER, WALK_SAMPLES, rng)
    inputs = 0.5 * rng.standard_normal(WALK_SAMPLES)
    recording = recorded(truth, inputs, 5 * NOISE * rng.standard_normal(WALK_SAMPLES))
    trajectory = smoothed(truth.terms, recording)
    held = {}
    for name in (H1, H2_SUM):
        order, omega = len(LINES[name]), lines(frequencies, name)
        true, found = (tv_gfrf(t, order, omega, timepts=timepts, operating_input=0.0) for t in (truth, trajectory))
        error = found.values - true.values
        parts = np.stack([error.real, error.imag], axis=-1)[..., None]
        distance = (parts.swapaxes(-1, -2) @ np.linalg.solve(found.covariance, parts))[..., 0, 0]
        held[order] = distance <= CHI_SQUARE
    return held


def known_systems(
    followed: tuple[Followed, ...], frozen: tuple[FrozenRun, ...], held: list[dict[int, NDArray[np.bool_]]]
) -> Known:
    """Put the parts together."""
    solved, standing = _dc_effect()
    coverage = {order: np.stack([one[order] for one in held]) for order in (1, 2)}
    return Known(followed=followed, solved=solved, held=standing, frozen=frozen, coverage=coverage)


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

    def told(work: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], first: float, last: float, text: str) -> Any:
        return run_told(work, tasks, jobs, between(progress, first, last), text)

    drives = [(actuator, number in SHOWN) for number, actuator in enumerate(actuators, start=1)]
    driven = told(_drive, drives, 0.0, 0.55, "following six actuators")
    systems = [(place, np.random.default_rng(child)) for place, child in zip(places, of_systems, strict=True)]
    followed = told(_follow, systems, 0.55, 0.7, "following systems whose parameters are known")
    runs = [(place, speed) for place in places for speed in SPEEDS]
    frozen = told(_frozen_run, runs, 0.7, 0.8, "frozen time against the rate of variation")
    held = told(covered, [(rng, COVERAGE_TIMES, COVERAGE_HZ) for rng in walks], 0.8, 0.92, "coverage of the truth")
    known = known_systems(tuple(followed), tuple(run for each in frozen for run in each), held)
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
