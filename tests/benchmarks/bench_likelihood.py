"""Speed of the likelihood: ``python tests/benchmarks/bench_likelihood.py``.

A reading of 21,000 samples in two recordings with 40 columns, its rms error and its noise unknown, in processor time on
one core (best of a few runs): products at 24 ratios of error and noise, and the whole evidence.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


import numpy as np
from stopwatch import timed

from deatwin.ident.mismatch.likelihood.model import LogNormal, Prior, Process, Reading
from deatwin.ident.mismatch.likelihood.scales import evidence
from deatwin.ident.mismatch.likelihood.whitening import grams

SAMPLES, COLUMNS, RATIOS = 21_000, 40, 24


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
