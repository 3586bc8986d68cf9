"""Speed of the free run and of Semp on S3, in processor time: ``python tests/benchmarks/bench_semp.py``.

Each time is the best of a few runs. No test depends on these figures.
"""

from __future__ import annotations

import os

import numpy as np
from stopwatch import timed

from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.plant.recording import Recording

SAMPLES = 100_000
SMALLER_INPUT = 0.7
"""S3 is stable only locally: with inputs up to 1, long runs of it diverge."""


def free_run() -> None:
    u = SMALLER_INPUT * np.random.default_rng(0).uniform(-1, 1, SAMPLES)
    model, recording = SYSTEMS["S3"].model, Recording.from_arrays(u, np.zeros(SAMPLES), 1.0)
    fast = timed(lambda: model.simulate(recording), 20)
    os.environ["DEATWIN_COMPILER"] = ""
    slow = timed(lambda: model.simulate(recording), 3)
    del os.environ["DEATWIN_COMPILER"]
    print(f"free run of {SAMPLES} samples: {fast * 1e3:.2f} ms; without a compiler {slow / fast:.0f} times as long")


def search() -> None:
    system = SYSTEMS["S3"]
    recording = system.draw(np.random.default_rng(0)).recording
    semp = Semp(output_lags=system.output_lags, input_lags=system.input_lags, degree=system.degree)
    seconds = timed(lambda: semp.fit(recording), 20)
    print(f"Semp, {recording.n_samples} samples: {seconds * 1e3:.1f} ms for {len(semp.path_)} steps")


if __name__ == "__main__":
    free_run()
    search()
