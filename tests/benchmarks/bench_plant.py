"""Speed of the plant against its peers, in one run, as ratios: ``python tests/benchmarks/bench_plant.py``.

The peer is CasADi's SUNDIALS integrator on the same equations; CasADi's virtual machine stands for a computer
without a compiler. No test depends on these figures.
"""

import os
import time
from collections.abc import Callable

import numpy as np

from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.compiled import compiler
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.model import _simulator
from deatwin.plant.reference import reference_outputs

SECONDS = 60.0


def timed(work: Callable[[], object], repeats: int = 3) -> float:
    """Shortest of a few runs, s."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    plant = Plant(rig=Diaphragm())
    command = band_limited_noise(np.random.default_rng(0), SECONDS, plant.rig.sample_time)
    experiment = Experiment(recordings=(Recording.from_arrays(command, np.zeros_like(command), plant.rig.sample_time),))

    begin = time.perf_counter()
    plant.simulator  # noqa: B018
    print(f"ready in {time.perf_counter() - begin:.2f} s (compiled or from the cache)")
    timeline = plant.timeline(experiment)

    def sensitivities() -> object:
        return plant.simulator.run_with_sensitivities(
            timeline.commands, start=timeline.start, sample_time=timeline.sample_time, rest_command=0.0,
            values=plant.free_values,
        )

    compiled = timed(lambda: plant.simulate(experiment))
    exact = timed(sensitivities)
    tight = timed(lambda: reference_outputs(plant, experiment, relative_tolerance=1e-9), 1)
    loose = timed(lambda: reference_outputs(plant, experiment, relative_tolerance=1e-6), 1)

    os.environ["DEATWIN_COMPILER"] = ""
    compiler.cache_clear()
    _simulator.cache_clear()
    virtual = timed(lambda: plant.simulate(experiment), 1)

    print(f"{SECONDS:.0f} s of noise at 50 Hz: {compiled:.3f} s, {SECONDS / compiled:.0f} times real time")
    print(f"with sensitivities to {plant.free_values.size} parameters: {exact / compiled:.1f} times a plain simulation")
    print(f"SUNDIALS (IDAS) at a relative tolerance of 1e-9: {tight / compiled:.0f} times as long")
    print(f"SUNDIALS (IDAS) at a relative tolerance of 1e-6: {loose / compiled:.0f} times as long")
    print(f"virtual machine: {virtual / compiled:.1f} times as long")


if __name__ == "__main__":
    main()
