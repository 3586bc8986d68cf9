"""Speed of the Kalman filter and smoother: ``python tests/benchmarks/bench_kalman.py``.

A random walk of 15 parameters over 55,000 samples, as one of the thesis' recordings has them, in processor time (best
of a few runs): filter, gradient and smoother, compiled and in Python.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


import numpy as np
from stopwatch import timed

from deatwin.ident.kalman import StateSpace, adjoint, kalman_filter, kalman_smoother

STATES, SAMPLES = 15, 55_000


def problem() -> tuple[StateSpace, np.ndarray]:
    rng = np.random.default_rng(0)
    model = StateSpace(
        rows=rng.normal(size=(SAMPLES, STATES)),
        noise_variance=1.0,
        start=np.zeros(STATES),
        start_cov=1e6 * np.eye(STATES),
        process_cov=1e-4 * np.eye(STATES),
    )
    return model, rng.normal(size=SAMPLES)


def own(name: str) -> None:
    model, outputs = problem()
    filtered = kalman_filter(model, outputs)
    for what, work in (
        ("filter and likelihood", lambda: kalman_filter(model, outputs)),
        ("gradient", lambda: adjoint(filtered)),
        ("smoother", lambda: kalman_smoother(filtered)),
    ):
        print(f"{name:12s}{what:24s}{timed(work, 3):8.2f} s")


if __name__ == "__main__":
    own("compiled")
    os.environ["DEATWIN_COMPILER"] = ""
    own("Python")
    del os.environ["DEATWIN_COMPILER"]
