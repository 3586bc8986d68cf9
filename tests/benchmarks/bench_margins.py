"""Speed and memory of `margins` beside python-control: ``python tests/benchmarks/bench_margins.py``.

A NARX model is identified from a minute of the simulated rig; 2000 draws of its posterior are linearised at 20
operating inputs, and a PI controller closes the loop: 40 000 loops. `margins` takes them all at once and gives gain,
phase, delay and disk margin. python-control is called once a loop, for a random hundred of them, as its users would:
`stability_margins` (all crossings) for gain, phase and delay, `disk_margins` on 1000 frequencies for the disk. The
hundred must agree: gain, phase and delay to 1e-9, the disk margin to 1e-9 from below and from above as closely as 1000
frequencies allow. Times are of processor time on one core (best of a few runs of ours); those of python-control are
those of the hundred, times 400. No test depends on these figures.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import tracemalloc
import warnings

import control
import numpy as np
from stopwatch import best

from deatwin.control.linear.family import draw, linearise_many
from deatwin.control.linear.narx import linearise
from deatwin.control.stability.margins import Margins, margins
from deatwin.control.stability.polynomials import in_series
from deatwin.ident.narx import Frols, NarxModel
from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.excitation import band_limited_noise

SAMPLE_TIME = 0.02
LOW_V, HIGH_V = 2.0, 2.8  # of the operating inputs
CROSSOVER_HZ = 0.3
Array = np.ndarray


def identified() -> tuple[Plant, NarxModel]:
    """A minute of noise up to 1 Hz about 2.4 V, and the model identified from it."""
    rng = np.random.default_rng(20)
    plant = Plant(rig=Diaphragm())
    command = band_limited_noise(rng, 60.0, SAMPLE_TIME)
    bare = Recording.from_arrays(command, np.zeros_like(command), SAMPLE_TIME, start=5.0)
    recording = plant.record(Experiment(recordings=(bare,)), rng).recordings[0]
    return plant, Frols(output_lags=2, input_lags=(0, 1, 2), degree=2, max_terms=10).fit(recording).model_


def family(points: int, draws: int) -> tuple[Array, Array]:
    """Polynomials of the loops, shapes (points, draws, m) each."""
    plant, model = identified()
    reading = plant.rig.reading
    middle = linearise(model, 0.5 * (LOW_V + HIGH_V)).in_loop(reading)
    integral = 2 * np.pi * CROSSOVER_HZ / middle.static_gain  # of a plant that is nearly static there
    proportional = 0.02 / middle.static_gain
    thetas = draw(model, np.random.default_rng(1), draws)
    samples = linearise_many(model, np.linspace(LOW_V, HIGH_V, points), thetas).in_loop(reading)
    if not samples.exists.all():
        raise SystemExit("some draws have no equilibrium")
    numerators, denominators = samples.numerators, samples.denominators
    return (
        in_series(numerators, [proportional + integral * SAMPLE_TIME, -proportional]),
        in_series(denominators, [1.0, -1.0]),
    )


def crossings(top: Array, bottom: Array) -> tuple[Array, ...]:
    """Gain and phase margins at all crossings, with their frequencies, by python-control."""
    loop = control.tf(top, bottom, SAMPLE_TIME)
    gains, phases, _, _, omegas, _ = control.stability_margins(loop, returnall=True, method="poly")
    # It leaves out half the sampling rate, where every loop is real.
    half = loop(-1.0).real
    return (np.append(gains, -1.0 / half) if half < 0.0 else gains), phases, omegas


def disk(top: Array, bottom: Array, omega: Array) -> float:
    """The disk margin on a grid, by python-control."""
    return float(control.disk_margins(control.tf(top, bottom, SAMPLE_TIME), omega)[0])


def require(text: str, difference: float, limit: float) -> None:
    """Print a difference.

    Raises
    ------
    SystemExit
        If it is too large.
    """
    print(f"  {text}: {difference:.1e} (limit {limit:g})")
    if not difference <= limit:
        raise SystemExit(f"{text} differ by {difference:.2e}")


def compare(found: Margins, top: Array, bottom: Array, chosen: Array) -> tuple[float, float]:
    """Compare the chosen loops with python-control; returns its time a loop in s, of all and of `margin` alone."""
    omega = np.geomspace(1e-2, np.pi / SAMPLE_TIME, 1000)
    seconds, theirs = best(lambda: [crossings(top[i], bottom[i]) for i in chosen], 1)
    disk_seconds, disks = best(lambda: np.array([disk(top[i], bottom[i], omega) for i in chosen]), 1)
    whole_seconds, _ = best(lambda: [control.margin(control.tf(top[i], bottom[i], SAMPLE_TIME)) for i in chosen], 1)
    differences = np.zeros((len(chosen), 3))
    for row, i, (gains, phases, omegas) in zip(differences, chosen, theirs, strict=True):
        real = omegas > 1e-6 / SAMPLE_TIME  # python-control counts the integrator itself as a crossing
        phases, omegas = phases[real], omegas[real]
        ahead = np.mod(np.radians(phases), 2 * np.pi) / omegas
        gains = gains[np.isfinite(gains) & (gains > 0)]
        expected = np.maximum(gains, 1 / gains).min(), abs(phases).min(), ahead.min()
        row[:] = abs(np.array([found.gain[i], found.phase_deg[i], found.delay[i]]) / expected - 1)
    for name, column in zip(("gain", "phase", "delay"), differences.T, strict=True):
        require(f"{name} margins of both", float(column.max()), 1e-9)
    require("disk margin on 1000 frequencies above ours", float((disks / found.disk[chosen] - 1).max()), 1e-3)
    require("disk margin on 1000 frequencies below ours", float((1 - disks / found.disk[chosen]).max()), 1e-9)
    count = len(chosen)
    print(
        f"python-control {control.__version__}, a loop: stability_margins {1e3 * seconds / count:.2f} ms, "
        f"disk_margins {1e3 * disk_seconds / count:.2f} ms (margin alone {1e3 * whole_seconds / count:.2f} ms)"
    )
    return (seconds + disk_seconds) / count, whole_seconds / count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=2000, help="draws of the posterior")
    parser.add_argument("--points", type=int, default=20, help="operating inputs")
    parser.add_argument("--loops", type=int, default=100, help="loops that python-control is given")
    arguments = parser.parse_args()
    seconds, (tops, bottoms) = best(lambda: family(arguments.points, arguments.draws), 1)
    count = arguments.points * arguments.draws
    print(f"{arguments.points} operating inputs x {arguments.draws} draws = {count} loops, laid out in {seconds:.0f} s")
    ours, found = best(lambda: margins(tops, bottoms, SAMPLE_TIME), 3)
    tracemalloc.start()
    margins(tops, bottoms, SAMPLE_TIME)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"margins: {ours:.2f} s, {1e6 * ours / count:.1f} µs a loop, peak {peak / 1e6:.0f} MB")
    print(f"{100 * found.stable.mean():.1f} % of the loops are stable; least disk margin {found.disk.min():.3g}")
    flat = Margins(**{name: values.reshape(-1) for name, values in vars(found).items()})
    sound = np.flatnonzero(flat.stable & np.isfinite(flat.gain) & np.isfinite(flat.phase_deg))
    chosen = np.random.default_rng(2).choice(sound, min(arguments.loops, sound.size), replace=False)
    top, bottom = tops.reshape(count, -1), bottoms.reshape(count, -1)
    size = max(top.shape[1], bottom.shape[1])  # python-control counts powers of z
    top, bottom = (np.pad(c, ((0, 0), (0, size - c.shape[1]))) for c in (top, bottom))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs, alone = compare(flat, top, bottom, chosen)
    print(f"python-control for all: {theirs * count:.0f} s; {theirs * count / ours:.0f} times ours")
    print(f"its gain and phase margin alone: {alone * count:.0f} s; {alone * count / ours:.0f} times ours with all")


if __name__ == "__main__":
    main()
