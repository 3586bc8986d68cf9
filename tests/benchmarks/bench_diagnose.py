"""Time and memory of a diagnosis: ``python tests/benchmarks/bench_diagnose.py``.

One open recording of an independent rig (``tests/recordings``): 420 s at 50 Hz, from which the diagnosis has to find a
creep. Times are of the clock, with compiled code in the cache: on a new computer the second run counts. The base fit is
the plain calibration of the plant as described to all samples, in this process. Peak memory is the kernel's for this
process and for the largest of its children (on Linux no less than this process had when it started them); all together
have at most this process and as many of the largest as there are jobs. No test depends on these figures.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import gzip
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from joblib.externals.loky import get_reusable_executor

from deatwin.ident.greybox.fit import Calibration, calibrate
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch import Diagnosis, diagnose
from deatwin.plant import Experiment, Plant, Recording
from deatwin.plant.files import read_recording
from deatwin.plant.sources import load_plant

FOLDER = Path(__file__).parents[1] / "recordings"
CASE, JOBS = "open_creep", 2
SECONDS, BASE_FITS, GIGABYTES = 180.0, 8.0, 2.0
"""Goals: of the clock, of base fits that a diagnosis takes as long as, and of memory."""
CALIBRATING = "calibrating the model"


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Peak memory in GB."""

    own: float
    child: float

    @classmethod
    def now(cls) -> Memory:
        """Of this process and of the largest child that has ended."""
        unit = 1.0 if sys.platform == "darwin" else 1024.0
        own, child = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        return cls(own=own * unit / 1e9, child=child * unit / 1e9)

    def together(self, jobs: int) -> float:
        """What this process and its workers have at most."""
        return self.own + (jobs * self.child if jobs > 1 else 0.0)


def experiment(case: str = CASE) -> Experiment:
    """What a case gives to diagnose."""
    with tempfile.TemporaryDirectory() as folder:
        return Experiment(recordings=tuple(_recording(case, part, Path(folder)) for part in ("noise", "steps")))


def _recording(case: str, part: str, folder: Path) -> Recording:
    path = folder / f"{part}.csv"
    path.write_bytes(gzip.decompress((FOLDER / case / f"{part}.csv.gz").read_bytes()))
    return read_recording(path)


def opening(whole: Experiment, seconds: float) -> Experiment:
    """The first seconds of an experiment."""
    left, kept = round(seconds / whole.sample_time), []
    for record in whole.recordings:
        if left > 0:
            kept.append(record.section(0, min(left, record.n_samples)))
            left -= record.n_samples
    return Experiment(recordings=tuple(kept))


def base_fit(plant: Plant, given: Experiment) -> tuple[float, Calibration]:
    """Seconds of the clock, and the plain calibration that they went into."""
    begin = time.perf_counter()
    found = calibrate(plant, [Part.whole(given)], starts=1)
    return time.perf_counter() - begin, found


def diagnosis(plant: Plant, given: Experiment, jobs: int) -> tuple[dict[str, float], Diagnosis]:
    """Seconds of the clock by step, and the diagnosis; its workers have ended when it returns."""
    begun: list[tuple[float, str]] = []
    found = diagnose(plant, given, jobs=jobs, progress=lambda share, text: begun.append((time.perf_counter(), text)))
    taken: dict[str, float] = {}
    for (begin, text), (end, _) in pairwise(begun):
        taken[text] = taken.get(text, 0.0) + end - begin
    get_reusable_executor().shutdown(wait=True)
    return taken, found


def beside(what: str, reached: float, goal: float, unit: str) -> str:
    """A measure beside its goal."""
    return f"{what:44s}{reached:8.2f} {unit:2s} (goal: at most {goal:g} {unit}) {'yes' if reached <= goal else 'NO'}"


def measure(plant: Plant, given: Experiment, jobs: int) -> None:
    """Print times and memory beside the goals."""
    print(f"{given.n_samples} samples, {sum(r.duration for r in given.recordings):.0f} s, {jobs} jobs")
    plant.simulator  # noqa: B018  compiled, or from the cache
    alone, fit = base_fit(plant, given)
    print(f"base fit alone: {alone:.2f} s, {fit.evaluations} simulations, {fit.status.value}")
    taken, found = diagnosis(plant, given, jobs)
    seconds = sum(taken.values())
    for step, length in taken.items():
        print(f"  {step:42s}{length:8.2f} s ({length / seconds:.0%})")
    print(f"verdict: {found.verdict.value} {', '.join(cause.effect for cause in found.causes)}")
    print(beside("diagnosis", seconds, SECONDS, "s"))
    print(beside("diagnosis over the base fit alone", seconds / alone, BASE_FITS, "x"))
    print(f"{'diagnosis over its own base calibration':44s}{seconds / taken[CALIBRATING]:8.2f} x")
    memory = Memory.now()
    print(f"peak memory: {memory.own:.2f} GB, largest child {memory.child:.2f} GB")
    print(beside("peak memory together, at most", memory.together(jobs), GIGABYTES, "GB"))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", default=CASE, help="folder in tests/recordings")
    parser.add_argument("--jobs", type=int, default=JOBS, help="worker processes")
    parser.add_argument("--seconds", type=float, help="of the recordings; all by default")
    options = parser.parse_args(arguments)
    given = experiment(options.case)
    print(options.case, end=": ")
    plant = load_plant(FOLDER / options.case / "rig.toml").plant
    measure(plant, given if options.seconds is None else opening(given, options.seconds), options.jobs)


if __name__ == "__main__":
    main()
