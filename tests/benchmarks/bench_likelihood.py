"""Speed of the likelihood: ``python tests/benchmarks/bench_likelihood.py``.

A reading of 21,000 samples in two recordings with 40 columns, its rms error and its noise unknown, in processor time on
one core (best of a few runs): products at 24 ratios of error and noise, and the whole evidence.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time
from collections.abc import Callable

import numpy as np

from deatwin.ident.mismatch.likelihood.model import LogNormal, Prior, Process, Reading
from deatwin.ident.mismatch.likelihood.scales import evidence
from deatwin.ident.mismatch.likelihood.whitening import grams

SAMPLES, COLUMNS, RATIOS = 21_000, 40, 24


def timed(work: Callable[[], object], repeats: int = 5) -> float:
    """Shortest processor time of a few runs, s."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def main() -> None:
    rng, times = np.random.default_rng(0), 0.02 * np.arange(SAMPLES)
    reading = Reading(
        times=times,
        records=(times >= 240.0).astype(int),
        residual=2e-6 * rng.standard_normal(SAMPLES),
        columns=1e-6 * rng.standard_normal((SAMPLES, COLUMNS)),
        process=Process(weights=(0.5, 0.5), times=(0.1, 1.0)),
        kappa=LogNormal(median=0.4e-6, spread=0.7),
        sigma=LogNormal(median=2e-6, spread=0.05),
    )
    prior, clock = Prior.of((COLUMNS, None)), (reading.times, reading.records)
    ratios = np.geomspace(0.02, 2.0, RATIOS)
    for what, work in (
        (f"products at {RATIOS} ratios", lambda: grams(reading.process, ratios, clock, reading.rows)),
        ("evidence", lambda: evidence([reading], prior)),
    ):
        print(f"{what:28s}{timed(work):8.3f} s")


if __name__ == "__main__":
    main()
