"""What a sweep costs besides its cases: ``python tests/benchmarks/bench_sweep.py [FOLDER]``.

Four times 2500 empty cases through the store and the runner: the time of each, in this process, in two, and on a dask
cluster of two; the bytes that a case takes, as it is long and as the disk holds it; how long it takes to list what is
through, for cases side by side and spread, and to read them back; a study's case from its file to the table; and what
a worker holds in memory. FOLDER says on which disk; by default one for temporary files. Times are of the wall clock,
the shortest of four: nothing else should run.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed, parallel_config

from deatwin.plant import Experiment, Recording, thesis_plant
from deatwin.studies.sweep import run_study
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal
from deatwin.studies.sweep.store import CaseStore

COUNT, REPEATS, STUDY = 2500, 4, 1000
SEAL = SweepSeal(schema="deatwin/bench-case/1", parts={"seed": 0})


def empty(number: int) -> dict[str, Any]:
    """The cheapest case."""
    return {"number": number}


def small(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Three numbers and a short array."""
    return {"first": rng.random(), "second": rng.random(), "third": case["number"], "track": rng.random(10)}


def memory_MB(_: int) -> float:
    """What a worker holds that has simulated a plant; unique to it, where the system tells."""
    plant = thesis_plant()
    command = np.full(500, 2.0)
    silent = Recording.from_arrays(command, np.zeros(500), plant.rig.sample_time)
    plant.record(Experiment(recordings=(silent,)), np.random.default_rng(0))
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


def timed(work: Callable[[], object]) -> float:
    """Seconds of the wall clock."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def shortest(work: Callable[[], object], count: int) -> float:
    """Microseconds of the wall clock for each of some cases, the shortest of a few runs."""
    return 1e6 * min(timed(work) for _ in range(REPEATS)) / count


def write(store: CaseStore) -> None:
    """All cases, without a runner."""
    for number in range(COUNT):
        store.put(f"{number:07d}", empty(number))


def swept(folder: Path, jobs: int | None) -> float:
    """Sweeps of empty cases, and the microseconds that each case of the shortest took, of the wall clock."""
    cases = {f"{number:07d}": number for number in range(COUNT)}
    stores = [CaseStore(folder / str(again), SEAL, expected=COUNT) for again in range(REPEATS)]
    times = [timed(lambda store=store: run_sweep(empty, cases, store, jobs=jobs)) for store in stores]
    return 1e6 * min(times) / COUNT


def main(folder: Path) -> None:
    """Measure and print."""
    stores = [CaseStore(folder / f"direct-{again}", SEAL, expected=COUNT) for again in range(REPEATS)]
    waiting = iter(stores)
    each = shortest(lambda: write(next(waiting)), COUNT)
    print(f"the store alone: {each:.0f} µs a case")
    print(f"one process: {swept(folder / 'one', 1):.0f} µs a case")
    Parallel(n_jobs=2)(delayed(abs)(k) for k in range(8))  # starts the workers
    print(f"two processes (loky): {swept(folder / 'two', 2):.0f} µs a case")
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        print("dask: not installed")
    else:
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster):
            with parallel_config(backend="dask"):
                print(f"dask, two workers: {swept(folder / 'dask', None):.0f} µs a case")
    spread, flat = stores[0], CaseStore(folder / "flat", SEAL)
    write(flat)
    stats = [path.stat() for path in spread.cases.rglob("*.nc")]
    on_disk = np.mean([getattr(stat, "st_blocks", 0) for stat in stats]) * 512
    print(f"bytes a case: {np.mean([stat.st_size for stat in stats]):.0f}, on the disk {on_disk:.0f}")
    for name, store in (("spread", spread), ("side by side", flat)):
        print(f"listing, {name}: {shortest(store.names, COUNT):.1f} µs a case")
    names = sorted(spread.names())
    print(f"reading back: {shortest(lambda: [spread.get(name) for name in names], COUNT):.0f} µs a case")
    run_study([{"number": 0}], small, folder / "warm").to_xarray()  # loads xarray
    study = run_study(({"number": k} for k in range(STUDY)), small, folder / "study", jobs=1)
    length = np.mean([path.stat().st_size for path in study.store.cases.rglob("*.nc")])
    print(f"a study's case of 3 numbers and an array of 10: {length:.0f} bytes")
    print(f"to_xarray: {shortest(study.to_xarray, STUDY):.0f} µs a case")
    study.to_netcdf(folder / "study.nc")
    print(f"in one NetCDF file: {(folder / 'study.nc').stat().st_size / STUDY:.0f} bytes a case")
    held = Parallel(n_jobs=2)(delayed(memory_MB)(k) for k in range(4))
    print(f"memory of a worker that simulates: {max(held):.0f} MB")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as made:
            main(Path(made))
