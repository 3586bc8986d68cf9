"""Speed of `SvbNarx` against the published updates written out plainly: ``python tests/benchmarks/bench_svb.py``.

The system is E1 of the thesis: 1000 samples, lags 4, degree 4, 495 candidates. Both run the whole pruning loop, each
step from the prior to convergence; every step's terms must be the same and its bound equal to 1e-6 of itself. The plain
one computes what vb_linear_fit_ard computes (arXiv:1310.5438), in its order: inverse and determinant from a Cholesky
factor, and for the trace a product of samples, candidates and candidates. Times include the regressors and all that
`fit` does. They are of processor time with one BLAS thread, and of the clock with two; the shortest of a few runs, both
sides in turn. No test depends on these figures.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from math import log, pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky
from scipy.special import gammaln

from deatwin.ident.narx import SvbNarx
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]

TOLERANCE, MAX_ITERATIONS, RESOLUTION = 1e-2, 500, 100.0
A0, B0, C0, D0 = 1e-2, 1e-4, 1e-2, 1e-4


def published_fit(x: Array, y: Array) -> tuple[Array, list[float]]:
    """Iterate the published updates until parameters and noise settle; returns E[alpha] and the bound after each.

    Parameters
    ----------
    x : ndarray, shape (n_samples, n_terms)
        Regressors.
    y : ndarray, shape (n_samples,)
        Outputs.
    """
    n, d = x.shape
    x_corr, xy_corr = x.T @ x, x.T @ y
    an, cn = A0 + n / 2, C0 + 0.5
    constant = -0.5 * (n * log(2 * pi) - d) - gammaln(A0) + A0 * log(B0) + d * (-gammaln(C0) + C0 * log(D0))
    alpha = np.full(d, C0 / D0)
    bounds: list[float] = []
    before = None
    for _ in range(MAX_ITERATIONS):
        inv_v = np.diag(alpha) + x_corr
        factor = cholesky(inv_v, lower=True, check_finite=False)
        v = cho_solve((factor, True), np.eye(d), check_finite=False)
        logdet_v = -2.0 * np.sum(np.log(np.diag(factor)))
        w = v @ xy_corr
        sse = np.sum((x @ w - y) ** 2)
        bn = B0 + 0.5 * (sse + np.sum(w**2 * alpha))
        tau = an / bn
        dn = D0 + 0.5 * (tau * w**2 + np.diag(v))
        settled = before is not None and (
            tau * np.sum((x @ (w - before[0])) ** 2) + tau * np.sum(alpha * (w - before[0]) ** 2) <= TOLERANCE**2 * d
            and abs(bn - before[1]) <= TOLERANCE * bn
        )
        alpha, before = cn / dn, (w, bn)
        bounds.append(
            -0.5 * (tau * sse + np.sum(x * (x @ v)))
            + 0.5 * logdet_v
            - B0 * tau
            + gammaln(an)
            - an * log(bn)
            + an
            + d * gammaln(cn)
            - cn * np.sum(np.log(dn))
            + constant
        )
        if settled:
            break
    return alpha, bounds


def published(recording: Recording) -> list[tuple[Array, float]]:
    """Prune down to one term with the published updates; returns the candidates of each step, and its bound."""
    system = SYSTEMS["E1"]
    data = Regression.of(recording, output_lags=system.output_lags, input_lags=system.input_lags, degree=system.degree)
    rows, y = data.matrix()
    rows /= np.sqrt(np.mean(rows**2, axis=1))[:, None]  # the scaling of the estimator
    y /= np.sqrt(np.mean(y**2))
    x = np.ascontiguousarray(rows.T)
    indices, steps = np.arange(len(rows)), []
    while True:
        alpha, bounds = published_fit(np.ascontiguousarray(x[:, indices]), y)
        steps.append((indices, bounds[-1]))
        if indices.size == 1:
            return steps
        relevance = -np.log(alpha)
        indices = indices[relevance > relevance.min() + (relevance.max() - relevance.min()) / RESOLUTION]


def own(recording: Recording) -> list[tuple[Array, float]]:
    """The same by the estimator."""
    system = SYSTEMS["E1"]
    svb = SvbNarx(output_lags=system.output_lags, input_lags=system.input_lags, degree=system.degree, clean_up="none")
    return [(step.indices, step.lower_bound) for step in svb.fit(recording).path_]


def in_turn(recording: Recording, repeats: int, clock: Callable[[], float]) -> tuple[float, float]:
    """Shortest times of both in s, run one after the other."""
    times = np.empty((repeats, 2))
    for row in times:
        for side, work in enumerate((published, own)):
            begin = clock()
            work(recording)
            row[side] = clock() - begin
    return float(times[:, 0].min()), float(times[:, 1].min())


def largest_difference(recording: Recording) -> float:
    """Largest relative difference of the two bounds of a step.

    Raises
    ------
    SystemExit
        If the steps are not the same.
    """
    pairs = list(zip(published(recording), own(recording), strict=True))
    if not all(np.array_equal(theirs[0], ours[0]) for theirs, ours in pairs):
        raise SystemExit("the two prune different terms")
    return max(abs(theirs[1] - ours[1]) / abs(theirs[1]) for theirs, ours in pairs)


def measure(threads: int, draws: int, repeats: int) -> None:
    """Print the times of both with as many BLAS threads as the process has been given."""
    clock = time.process_time if threads == 1 else time.perf_counter
    kind = "processor time" if threads == 1 else "wall clock"
    for seed in range(draws):
        recording = SYSTEMS["E1"].draw(np.random.default_rng(seed)).recording
        if threads == 1:
            difference = largest_difference(recording)
            if difference > 1e-6:
                raise SystemExit(f"the bounds differ by {difference:.1e} of themselves")
            print(f"draw {seed}: same terms in every step, bounds equal to {difference:.0e}")
        plain, ours = in_turn(recording, repeats, clock)
        print(f"  {threads} thread(s), {kind}: published {plain:.2f} s, SvbNarx {ours:.3f} s, ratio {plain / ours:.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=3, help="recordings of E1")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each")
    parser.add_argument("--threads", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.threads:
        measure(arguments.threads, arguments.draws, arguments.repeats)
        return
    for threads in (1, 2):  # BLAS reads the number when it is loaded
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        environment = os.environ | dict.fromkeys(names, str(threads))
        call = [sys.executable, __file__, "--threads", str(threads)]
        call += ["--draws", str(arguments.draws), "--repeats", str(arguments.repeats)]
        subprocess.run(call, env=environment, check=True)


if __name__ == "__main__":
    main()
