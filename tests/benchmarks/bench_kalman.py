"""Speed of the Kalman filter and smoother: ``python tests/benchmarks/bench_kalman.py``.

A random walk of 15 parameters over 55,000 samples, as one of the thesis' recordings has them, in processor time (best
of a few runs): filter, gradient and smoother, compiled and in Python, and statsmodels where it is installed (over a
shorter record, scaled).
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


import numpy as np
from stopwatch import timed

from deatwin.ident.kalman import adjoint, kalman_filter, kalman_smoother
from deatwin.ident.state_space import StateSpace

STATES, SAMPLES, SHORT = 15, 55_000, 2_000


def problem(samples: int) -> tuple[StateSpace, np.ndarray]:
    rng = np.random.default_rng(0)
    model = StateSpace(
        rows=rng.normal(size=(samples, STATES)),
        noise_variance=1.0,
        start=np.zeros(STATES),
        start_cov=1e6 * np.eye(STATES),
        process_cov=1e-4 * np.eye(STATES),
    )
    return model, rng.normal(size=samples)


def own(name: str) -> None:
    model, outputs = problem(SAMPLES)
    filtered = kalman_filter(model, outputs)
    for what, work in (
        ("filter and likelihood", lambda: kalman_filter(model, outputs)),
        ("gradient", lambda: adjoint(filtered)),
        ("smoother", lambda: kalman_smoother(filtered)),
    ):
        print(f"{name:12s}{what:24s}{timed(work, 3):8.2f} s")


def statsmodels() -> None:
    try:
        from statsmodels.tsa.statespace.mlemodel import MLEModel
    except ImportError:
        print("statsmodels is not installed")
        return
    model, outputs = problem(SHORT)
    peer = MLEModel(outputs, k_states=STATES, k_posdef=STATES)
    peer["design"] = model.rows[0].T[None]
    peer["transition"] = peer["selection"] = np.eye(STATES)
    peer["state_cov"], peer["obs_cov"] = model.process_cov, np.eye(1)
    peer.initialize_known(np.zeros(STATES), model.start_cov)
    ours = kalman_smoother(kalman_filter(model, outputs))
    theirs = peer.ssm.smooth()
    print(
        f"log likelihoods differ by {abs(ours.log_likelihood - theirs.llf):.1e}, "
        f"states by {np.abs(ours.states - theirs.smoothed_state.T).max():.1e}"
    )
    share = SAMPLES / SHORT
    print(f"{'statsmodels':12s}{'filter':24s}{timed(peer.ssm.filter, 3) * share:8.2f} s (from {SHORT} samples)")
    print(f"{'statsmodels':12s}{'filter and smoother':24s}{timed(peer.ssm.smooth, 3) * share:8.2f} s")


if __name__ == "__main__":
    own("compiled")
    os.environ["DEATWIN_COMPILER"] = ""
    own("Python")
    del os.environ["DEATWIN_COMPILER"]
    statsmodels()
