"""The six recordings of the thesis' actuators, and what speaks against them."""

from __future__ import annotations

from dataclasses import dataclass
from operator import call
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.curves import loop_area
from deatwin.plant import Actuator, Experiment, Plant, Recording, fleet, specification
from deatwin.plant.excitation import triangles
from deatwin.studies.parallel import run_told
from deatwin.studies.voice import Progress

LOOP_RATE = 0.01  # Rate of the actuators' loops, Hz
RATES = (0.1, 0.01, 0.001)  # Rates of the loops of the specification, Hz


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """One cycle of a triangle."""

    commands: NDArray[np.float64]  # shape (n,): V
    displacements: NDArray[np.float64]  # shape (n,): m

    @property
    def area(self) -> float:
        """Area of the loop over the rectangle around it."""
        return loop_area(self.commands, self.displacements)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """An actuator, its recording and its loop."""

    actuator: Actuator
    recording: Recording
    loop: Loop  # At `LOOP_RATE`, from another experiment that begins at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Results of all experiments."""

    benches: tuple[Bench, ...]
    loops: tuple[Loop, ...]
    elastic_loops: tuple[Loop, ...]


def carry_out(seed: int, *, jobs: int, progress: Progress) -> Study:
    """Run all experiments."""
    wished = specification()
    tasks: list[tuple[Any, ...]] = [(_record, actuator) for actuator in fleet(seed)]
    tasks += [(loops_of, plant, RATES) for plant in (wished, wished.without_effects())]
    *benches, loops, elastic = run_told(call, tasks, jobs, progress, "recording six actuators")
    return Study(benches=tuple(benches), loops=loops, elastic_loops=elastic)


def cycle(rate: float, sample_time: float) -> Experiment:
    """Triangles over the thesis' range of commands: two that let the film forget its start, and one at `rate`, Hz."""
    pieces = [triangles(sample_time, lower=1.1, upper=3.75, rates=(r,), cycles=1) for r in (0.1, 0.1, rate)]
    starts = np.cumsum([0, *(p.size for p in pieces[:-1])]) * sample_time
    return Experiment(
        recordings=tuple(
            Recording.from_arrays(piece, np.zeros_like(piece), sample_time, start=start)
            for piece, start in zip(pieces, starts, strict=True)
        )
    )


def loops_of(plant: Plant, rates: tuple[float, ...]) -> tuple[Loop, ...]:
    """Loops of a plant without the sensor, at `rates`, Hz."""
    experiments = [cycle(rate, plant.rig.sample_time) for rate in rates]
    readings = [plant.simulate(experiment).require().outputs[-1][0] for experiment in experiments]
    commands = [experiment.recordings[-1].inputs[0] for experiment in experiments]
    return tuple(Loop(commands=u, displacements=y) for u, y in zip(commands, readings, strict=True))


def _record(actuator: Actuator) -> Bench:
    recording = actuator.record().recordings[0]
    last = actuator.record(cycle(LOOP_RATE, recording.sample_time)).recordings[-1]
    loop = Loop(commands=last.inputs[0], displacements=last.outputs[0])
    return Bench(actuator=actuator, recording=recording, loop=loop)


Array = np.ndarray
LEVELS = 0.05 * 2.0 ** np.arange(5)  # Commands from far below the smallest of the excitation up to near it, V
HOLD = 12.0  # Time at each of them, s: twenty times the film's relaxation time, so that the ball is at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class SmallVoltages:
    """Displacements at such small voltages that nothing seems to move."""

    voltages: Array  # shape (n,): At the film, V
    displacements: Array  # shape (n,): Where the ball comes to rest, without the sensor's noise and rounding, m
    visible: float  # Voltage at which the displacement is one step of the sensor's reading, V

    @property
    def exponents(self) -> Array:
        """Slope of ln y over ln V from each voltage to the next, shape (n - 1,)."""
        slopes: Array = np.diff(np.log(self.displacements)) / np.diff(np.log(self.voltages))
        return slopes


@dataclass(frozen=True, kw_only=True, eq=False)
class SideBands:
    """The line spectrum of a linear plant whose gain drifts."""

    frequencies: Array  # shape (n,): Hz
    inputs: Array  # shape (n,): Amplitudes of the input
    outputs: Array  # shape (n,): Amplitudes of the output
    line: float  # Frequency of the only line of the input, Hz
    drift: float  # Frequency of the drift of the gain, Hz
    expected: tuple[float, float]  # Amplitudes of the two side bands in closed form
    superposition: float

    @property
    def reached(self) -> tuple[float, float]:
        """Amplitudes of the output at the line's frequency plus and minus that of the drift."""
        sides = np.interp((self.line - self.drift, self.line + self.drift), self.frequencies, self.outputs)
        return float(sides[0]), float(sides[1])


def small_voltages(plant: Plant, step: float) -> SmallVoltages:
    """Compute the displacement of an actuator at several small voltages."""
    rig = plant.rig
    commands = np.repeat(LEVELS, round(HOLD / rig.sample_time))
    record = Recording.from_arrays(commands, np.zeros_like(commands), rig.sample_time)
    run = plant.simulate(Experiment(recordings=(record,))).require()
    at_rest = run.outputs[0][0].reshape(LEVELS.size, -1)[:, -1]
    voltages = plant.parameters["gain"].value * LEVELS
    visible = float(np.exp(np.interp(np.log(step), np.log(at_rest), np.log(voltages))))
    return SmallVoltages(voltages=voltages, displacements=at_rest, visible=visible)


def side_bands(
    line: float = 0.5, drift: float = 0.05, depth: float = 0.2, time: float = 0.5, sample_time: float = 0.02
) -> SideBands:
    """Drive a lag c = exp(-h/T) of gain g_k = 1 + d cos 2 pi f_d t_k with a line: y_k = c y_{k-1} + (1 - c) g_k u_k."""
    from scipy.signal import lfilter

    period = round(1 / (drift * sample_time)) * 2
    timepts = sample_time * np.arange(2 * period)
    pole = np.exp(-sample_time / time)

    def respond(u: Array) -> Array:
        gained = (1 - pole) * (1 + depth * np.cos(2 * np.pi * drift * timepts)) * u
        return np.asarray(lfilter([1.0], [1.0, -pole], gained))

    wave, other = np.cos(2 * np.pi * line * timepts), np.cos(2 * np.pi * 2.3 * line * timepts)
    response, of_other, of_sum = respond(wave), respond(other), respond(wave + other)
    sides = np.array([line - drift, line + drift])
    gain = np.abs((1 - pole) / (1 - pole * np.exp(-2j * np.pi * sides * sample_time))).tolist()
    return SideBands(
        frequencies=np.fft.rfftfreq(period, sample_time),
        inputs=_amplitudes(wave[period:]),
        outputs=_amplitudes(response[period:]),
        line=line,
        drift=drift,
        expected=(depth / 2 * gain[0], depth / 2 * gain[1]),
        superposition=float(np.abs(of_sum - response - of_other).max() / np.abs(of_sum).max()),
    )


def _amplitudes(values: Array) -> Array:
    amplitudes: Array = 2 * np.abs(np.fft.rfft(values)) / values.size
    return amplitudes
