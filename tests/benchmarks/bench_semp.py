"""Speed of the free run and of Semp against their peers, as ratios: ``python tests/benchmarks/bench_semp.py``.

Ratios are of processor time, each the best of a few runs. Peers:

- of the free run, a C loop with the equation of S3 written out, compiled with -O2 or -O3 (the faster one);
- of the search, the published one (additions by the largest SRR, pruning) with one candidate at a time: numpy's least
  squares on its regressors, then a free run; the free run in plain Python floats, and, for what the compiled one alone
  makes up, in the compiled kernel. Regressors of all candidates are computed beforehand and not counted.

No test depends on these figures.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from stopwatch import timed

from deatwin.ident.narx.free_run import free_run
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.ident.narx.terms import TermTable
from deatwin.plant.integrator.compiled import compiler
from deatwin.plant.recording import Recording

SAMPLES = 100_000
SMALLER_INPUT = 0.7
"""S3 is stable only locally: with inputs up to 1, long runs of it diverge."""
PUBLISHED = {"level": 0.5, "significance": None, "max_exchanges": 0, "max_terms": 6}

C_LOOP = """
void s3(const double *u, double *y, long n) {
    for (long k = 2; k < n; k++)
        y[k] = 0.2 * y[k - 1] * y[k - 1] * y[k - 1] + 0.7 * y[k - 1] * u[k - 1] + 0.6 * u[k - 2] * u[k - 2]
             - 0.7 * y[k - 2] * u[k - 2] * u[k - 2] - 0.5 * y[k - 2];
}
"""


def hand_written(level: str, folder: str) -> Callable[[np.ndarray], np.ndarray]:
    """S3 as a C loop of its own."""
    source, library = Path(folder) / "s3.c", Path(folder) / f"s3{level}.so"
    source.write_text(C_LOOP)
    program = compiler()
    if program is None:
        raise SystemExit("this benchmark needs a C compiler")
    subprocess.run([program, level, "-march=native", "-fPIC", "-shared", str(source), "-o", str(library)], check=True)
    function = ctypes.CDLL(str(library)).s3
    function.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long)

    def run(u: np.ndarray) -> np.ndarray:
        y = np.zeros(u.size)
        function(u.ctypes.data, y.ctypes.data, u.size)
        return y

    return run


def against_the_c_loop() -> None:
    u = SMALLER_INPUT * np.random.default_rng(0).uniform(-1, 1, SAMPLES)
    model, recording = SYSTEMS["S3"].model, Recording.from_arrays(u, np.zeros(SAMPLES), 1.0)
    with tempfile.TemporaryDirectory() as folder:
        peers = [hand_written(level, folder) for level in ("-O2", "-O3")]
        seconds, peer = min(
            ((timed(lambda peer=peer: peer(u), 20), peer) for peer in peers), key=lambda found: found[0]
        )
    ours = timed(lambda: model.simulate(recording), 20)
    difference = np.abs(model.simulate(recording).outputs[0] - peer(u)).max()
    print(f"free run of S3, {SAMPLES} samples: {ours * 1e3:.2f} ms, {ours / seconds:.2f} times the C loop")
    print(f"  (outputs at most {difference:.0e} apart)")
    os.environ["DEATWIN_COMPILER"] = ""
    slow = timed(lambda: model.simulate(recording), 3)
    del os.environ["DEATWIN_COMPILER"]
    print(f"  without a compiler: {slow / ours:.0f} times as long")


class OneAtATime:
    """The published search, candidate by candidate."""

    def __init__(self, data: Regression, compiled: bool) -> None:
        ((self.inputs, self.outputs),) = [data.scaled(record) for record in data.recordings]
        self.terms, self.first, self.compiled = data.table.terms, data.first, compiled
        self.rows, self.target = data.matrix()
        self.factors = [
            ([v.lag for v in term.expanded if v.kind == "y"], [v.lag for v in term.expanded if v.kind == "u"])
            for term in self.terms
        ]

    def sse(self, chosen: list[int]) -> float:
        theta = np.linalg.lstsq(self.rows[chosen].T, self.target)[0]
        y = self._kernel(chosen, theta) if self.compiled else self._floats(chosen, theta.tolist())
        return float(np.sum((self.target - y[self.first :]) ** 2))

    def _kernel(self, chosen: list[int], theta: np.ndarray) -> np.ndarray:
        table = TermTable(tuple(self.terms[i] for i in chosen))
        start = self.first - table.max_lag
        run, failed = free_run(table, theta, self.inputs[:, start:], self.outputs[:, start:], 1e3)
        y = np.concatenate([np.zeros(start), run[0]])
        return y if failed is None else np.full(y.size, np.inf)

    def _floats(self, chosen: list[int], theta: list[float]) -> np.ndarray:
        u, y = self.inputs[0].tolist(), self.outputs[0].tolist()
        terms = [(value, *self.factors[i]) for value, i in zip(theta, chosen, strict=True)]
        for k in range(self.first, len(y)):
            value = 0.0
            for product, output_lags, input_lags in terms:
                for lag in output_lags:
                    product *= y[k - lag]
                for lag in input_lags:
                    product *= u[k - lag]
                value += product
            if not -1e3 < value < 1e3:
                return np.full(len(y), np.inf)
            y[k] = value
        return np.array(y)

    def search(self, max_terms: int) -> list[int]:
        chosen: list[int] = []
        now, seen = float(self.target @ self.target), {frozenset[int]()}
        while len(chosen) < max_terms:
            before = now
            now, best = min((self.sse([*chosen, j]), j) for j in range(len(self.terms)) if j not in chosen)
            if now > before:
                break
            chosen = [*chosen, best]
            while len(chosen) > 1:
                smaller = [[i for i in chosen if i != out] for out in chosen]
                smaller = [rest for rest in smaller if frozenset(rest) not in seen]
                least, rest = min(((self.sse(rest), rest) for rest in smaller), default=(np.inf, chosen))
                if least >= before:
                    break
                chosen, now = rest, least
            seen.add(frozenset(chosen))
        return chosen


def against_one_at_a_time(name: str) -> None:
    system = SYSTEMS[name]
    recording = system.draw(np.random.default_rng(0)).recording
    lags = {"output_lags": system.output_lags, "input_lags": system.input_lags, "degree": system.degree}
    data = Regression.of(recording, **lags)
    published, usual = Semp(**lags, **PUBLISHED), Semp(**lags)
    ours, default = timed(lambda: published.fit(recording), 20), timed(lambda: usual.fit(recording), 20)
    print(f"Semp on {name} ({recording.n_samples} samples, {len(data.table.terms)} candidates), published search:")
    print(f"  {ours * 1e3:.1f} ms for {len(published.path_)} steps; with tests and exchanges {default * 1e3:.1f} ms")
    for compiled, what in ((False, "plain Python floats"), (True, "the compiled kernel")):
        peer = OneAtATime(data, compiled)
        seconds = timed(lambda peer=peer: peer.search(PUBLISHED["max_terms"]), 2)
        same = {data.table.terms[i] for i in peer.search(PUBLISHED["max_terms"])} == set(published.terms_)
        print(f"  one candidate at a time, free run in {what}: {seconds / ours:.0f} times as long, same terms: {same}")


if __name__ == "__main__":
    against_the_c_loop()
    against_one_at_a_time("S3")
