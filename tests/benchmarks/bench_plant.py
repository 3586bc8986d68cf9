"""Speed of the plant against its peers, in one run, as ratios: ``python tests/benchmarks/bench_plant.py``.

1000 s of the thesis' excitation at 50 Hz on its rig, without effects (*base*) and with its two (*thesis*). Ratios are
of processor time, so that other work on the computer matters little; each is the best of a few runs. Slow peers
run over a short stretch, and their time is scaled. Each peer's tolerance is the loosest of a few at which its
readings keep to 0.05 µm rms over that stretch. Judge of accuracy is SciPy's Radau at a tolerance of
1e-9.
No test depends on these figures.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from peers import Peer, scipy_peer, sundials_peer
from stopwatch import timed

from deatwin.ident.parallel import run_jobs
from deatwin.plant import CoulombFriction, Plant, Reading, SensorLag
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.fleet import thesis_plant
from deatwin.plant.simulate import Simulator

SECONDS, STRETCH = 1000.0, 10.0
ACCURACY = 0.05e-6
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
METHODS = ("LSODA", "BDF", "Radau")
SOLVERS = ("idas", "cvodes")
RIGS = 64


def excitation(sample_time: float, seconds: float = SECONDS) -> np.ndarray:
    return band_limited_noise(np.random.default_rng(0), seconds, sample_time)


def settings(plant: Plant) -> dict[str, object]:
    return {"start": 0.0, "sample_time": plant.rig.sample_time, "rest_command": 0.0, "values": plant.free_values}


def own(plant: Plant, commands: np.ndarray) -> np.ndarray:
    return plant.simulator.run(commands, **settings(plant)).outputs[1:]


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def best_peer(
    candidates: Iterable[tuple[str, Callable[[], Peer]]],
    commands: np.ndarray,
    error: Callable[[np.ndarray], float],
    demanded: float,
) -> tuple[str, float, float]:
    """Fastest of peers that are accurate enough: name, seconds and error."""
    found = []
    for name, make in candidates:
        try:
            peer = make()
            readings = peer(commands)
        except RuntimeError:
            continue
        if error(readings) <= demanded:
            found.append((timed(lambda peer=peer: peer(commands), 2), name, error(readings)))
    seconds, name, reached = min(found)
    return name, seconds, reached


def against_peers(name: str, plant: Plant) -> None:
    commands = excitation(plant.rig.sample_time)
    begin = time.perf_counter()
    plant.simulator  # noqa: B018
    print(f"\n{name}: ready in {time.perf_counter() - begin:.2f} s (compiled or from the cache)")
    seconds = timed(lambda: own(plant, commands))
    print(f"  {SECONDS:.0f} s in {seconds:.3f} s: {SECONDS / seconds:.0f} times real time")

    stretch = commands[: round(STRETCH / plant.rig.sample_time)]
    exact = exact_readings(plant, stretch)
    reached = rms(own(plant, stretch) - exact)
    demanded = max(ACCURACY, reached)
    print(f"  own error {reached * 1e6:.4f} µm rms; demanded of the peers {demanded * 1e6:.3f} µm")
    groups: dict[str, list[tuple[str, Callable[[], Peer]]]] = {
        "solve_ivp": [(f"{m} {t:.0e}", lambda m=m, t=t: scipy_peer(plant, m, t)) for m in METHODS for t in TOLERANCES],
        "SUNDIALS": [
            (f"{s} {t:.0e}", lambda s=s, t=t: sundials_peer(plant, s, t, stretch.size))
            for s in SOLVERS
            for t in TOLERANCES
        ],
    }
    for group, candidates in groups.items():
        peer, time_taken, error = best_peer(candidates, stretch, lambda y, exact=exact: rms(y - exact), demanded)
        ratio = time_taken / stretch.size * commands.size / seconds
        print(f"  {group} ({peer}, {error * 1e6:.3f} µm): {ratio:.0f} times as long")


def exact_readings(plant: Plant, commands: np.ndarray) -> np.ndarray:
    """The judge of accuracy."""
    return scipy_peer(plant, "Radau", 1e-9)(commands)


def sensitivities(name: str, plant: Plant) -> None:
    commands = excitation(plant.rig.sample_time)
    plain = timed(lambda: own(plant, commands))
    exact = timed(lambda: plant.simulator.run_with_sensitivities(commands, **settings(plant)))
    print(f"  sensitivities to {plant.free_values.size} parameters ({name}): {exact / plain:.1f} plain simulations")


def second_reading(plant: Plant) -> None:
    """Print what a reading of the current costs beside the displacement; at most 1.8 times one reading is wanted."""
    both = plant.with_rig(replace(plant.rig, further=(Reading(name="current", noise=1e-9),)))
    commands = excitation(plant.rig.sample_time)
    one, two = (timed(lambda p=p: p.simulator.run_with_sensitivities(commands, **settings(p))) for p in (plant, both))
    print(f"  two readings with sensitivities: {two / one:.2f} times one (wanted: at most 1.8)")


def without_compiler(plant: Plant) -> None:
    commands = excitation(plant.rig.sample_time, 20.0)
    fast = timed(lambda: own(plant, commands))
    os.environ["DEATWIN_COMPILER"] = ""
    slow = Simulator(plant.equations)
    taken = timed(lambda: slow.run(commands, **settings(plant)), 1)
    del os.environ["DEATWIN_COMPILER"]
    print(f"  without a compiler: {taken / fast:.0f} times as long")


def cold_compile(plant: Plant) -> None:
    """Processor time of the first plant of a structure, with all that the compiler takes."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["DEATWIN_CACHE"] = folder
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        Simulator(plant.equations)
        print(f"  compiling it: {resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before:.1f} s of a processor")
        del os.environ["DEATWIN_CACHE"]


def simulated(plant: Plant, commands: np.ndarray) -> float:
    return float(own(plant, commands)[-1])


def sweep(plant: Plant) -> None:
    """Rigs of different stiffness, ready workers, wall clock."""
    commands = excitation(plant.rig.sample_time)
    moduli = np.linspace(0.8, 1.2, RIGS) * plant.parameters["shear_modulus"].value
    jobs = [(plant.with_values({"shear_modulus": float(value)}), commands) for value in moduli]
    taken = {}
    for workers in (1, 2):
        run_jobs(simulated, jobs[:4], workers=workers)  # starts them, and loads the plant
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            run_jobs(simulated, jobs, workers=workers)
            times.append(time.perf_counter() - begin)
        taken[workers] = min(times)
    gain = taken[1] / taken[2]
    print(f"  {RIGS} rigs, 1000 s each: {taken[2]:.1f} s on two workers, {gain:.2f} times faster than one")


def memory() -> None:
    """Growth of a fresh process over an hour at 50 Hz (Linux: the peak that getrusage gives is its parent's too)."""
    code = (
        "import numpy as np\n"
        "from deatwin.plant import Experiment, Recording\n"
        "from deatwin.plant.excitation import band_limited_noise\n"
        "from deatwin.plant.fleet import thesis_plant\n"
        "def peak():\n"
        "    lines = open('/proc/self/status').read().splitlines()\n"
        "    return next(float(l.split()[1]) / 1024 for l in lines if l.startswith('VmHWM'))\n"
        "before = peak()\n"
        "u = band_limited_noise(np.random.default_rng(0), 3600.0, 0.02)\n"
        "thesis_plant().simulate(Experiment(recordings=(Recording.from_arrays(u, 0 * u, 0.02),))).require()\n"
        "print(before, peak())"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    before, after = (float(number) for number in done.split())
    print(f"\nan hour at 50 Hz: peak memory grows by {after - before:.0f} MB, to {after:.0f} MB")


def warm_start() -> None:
    """From a fresh process to the first simulated samples, with compiled code in the cache."""
    code = (
        "import time; t = time.perf_counter()\n"
        "import numpy as np; from deatwin.plant.fleet import thesis_plant; a = time.perf_counter()\n"
        "plant = thesis_plant(); plant.simulator.run(np.ones(10), start=0.0, sample_time=0.02, rest_command=0.0,"
        " values=plant.free_values)\n"
        "print(a - t, time.perf_counter() - a)"
    )
    runs = [subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True) for _ in range(3)]
    imported, ready = min(tuple(float(v) for v in run.stdout.split()) for run in runs)
    print(f"fresh process: import {imported:.2f} s, from plant to first sample {ready:.2f} s (warm cache)")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--without-peers", action="store_true", help="leave out the slow solvers")
    options = parser.parse_args(arguments)
    thesis = thesis_plant()
    base = Plant(rig=thesis.rig, values=thesis.values)
    for name, plant in {"base": base, "thesis": thesis}.items():
        if options.without_peers:
            print(f"\n{name}: {SECONDS / timed(lambda plant=plant: own(plant, excitation(0.02))):.0f} times real time")
        else:
            against_peers(name, plant)
        cold_compile(plant)
    print("\nbase:")
    sensitivities("base", base)
    sensitivities("base with a dry friction", base.with_effects(CoulombFriction()))
    sensitivities("base with a lag of the sensor", base.with_effects(SensorLag()))
    sensitivities("thesis", thesis)
    second_reading(base)
    without_compiler(base)
    sweep(base)
    memory()
    warm_start()


if __name__ == "__main__":
    main()
