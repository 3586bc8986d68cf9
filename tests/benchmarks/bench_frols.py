"""Speed and memory of `Frols` beside SysIdentPy's FROLS, as ratios: ``python tests/benchmarks/bench_frols.py``.

10,000 samples of S4 with lags to 8 and degree 3, 969 candidates, 15 terms; once as it is, and once on an offset, which
makes the candidates more collinear. Times are wall clock, each the best of a few runs, with as many threads as the
linear algebra takes (OMP_NUM_THREADS); run it on a quiet computer. SysIdentPy (extra ``compare``) is asked with the
number of terms given, so that it selects once, and without its own choice of that number; where it is not installed,
that part is left out and said so. No test depends on these figures.
"""

from __future__ import annotations

import subprocess
import sys
import time
from functools import partial

import numpy as np
from stopwatch import timed
from threadpoolctl import threadpool_info

from deatwin.ident.narx import Frols
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.plant.recording import Recording

SAMPLES, LAGS, DEGREE, TERMS = 10_000, 8, 3, 15
CANDIDATES = {"output_lags": LAGS, "input_lags": LAGS, "degree": DEGREE}
wall = partial(timed, clock=time.perf_counter)
OFFSETS = (0.0, 1.0)  # further from zero than their swing, signals would count from their means


def recording(offset: float, samples: int = SAMPLES) -> Recording:
    drawn = SYSTEMS["S4"].draw(np.random.default_rng(0), samples).recording
    # Without the first samples, which are exactly zero: see tests/validation/test_sysidentpy.py.
    moved = Recording.from_arrays(drawn.inputs + offset, drawn.outputs + offset, 1.0)
    return moved.section(LAGS, samples)


def regressors_and_gram(record: Recording) -> np.ndarray:
    """The unit of comparison: build all regressors, and one product of them with themselves."""
    rows, _ = Regression.of(record, **CANDIDATES).matrix()
    return rows @ rows.T


def own(record: Recording) -> Frols:
    return Frols(**CANDIDATES, max_terms=TERMS, criterion="none").fit(record)


def peer(record: Recording) -> list[str]:
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    model = FROLS(
        ylag=LAGS,
        xlag=LAGS,
        n_terms=TERMS,
        order_selection=False,
        basis_function=Polynomial(degree=DEGREE),
        estimator=LeastSquares(),
    )
    model.fit(X=record.inputs[0][:, None].copy(), y=record.outputs[0][:, None].copy())
    return [
        "".join(f"{'y' if code // 1000 == 1 else 'u'}(k-{code % 1000})" for code in row if code) or "1"
        for row in model.final_model
    ]


def speed(offset: float) -> None:
    record = recording(offset)
    unit = wall(lambda: regressors_and_gram(record))
    ours = wall(lambda: own(record))
    print(f"\noffset {offset:g}: regressors and one Gram matrix {unit:.3f} s, Frols {ours:.3f} s")
    print(f"  Frols takes {ours / unit:.2f} times as long as the regressors and one Gram matrix")
    try:
        import sysidentpy  # noqa: F401
    except ImportError:
        print("  SysIdentPy is not installed (extra compare): no comparison")
        return
    theirs = wall(lambda: peer(record), 3)
    from deatwin.ident.narx import Term

    same = [str(Term.parse(text)) for text in peer(record)] == [str(term) for term in own(record).terms_]
    print(f"  SysIdentPy: {theirs:.3f} s, {theirs / ours:.1f} times as long; {'same' if same else 'OTHER'} terms")


def lasso() -> None:
    system = SYSTEMS["E1"]
    record = system.draw(np.random.default_rng(0)).recording
    taken = wall(lambda: Lasso(output_lags=4, input_lags=4, degree=4).fit(record), 3)
    print(f"\nLasso on E1, {record.n_samples} samples and 495 candidates: {taken:.2f} s")


def memory() -> None:
    """Peak of a fresh process over 100,000 samples (Linux: VmHWM; getrusage would tell the parent's too)."""
    code = (
        "from bench_frols import own, recording\n"
        "record = recording(1.0, 100_000)\n"
        "own(record)\n"
        "lines = open('/proc/self/status').read().splitlines()\n"
        "print(next(float(line.split()[1]) / 1024**2 for line in lines if line.startswith('VmHWM')))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=sys.path[0])
    if done.returncode:
        print(f"\nmemory: not measured here ({done.stderr.strip().splitlines()[-1]})")
        return
    print(f"\n100,000 samples and 969 candidates: peak memory {float(done.stdout):.2f} GB")


def main() -> None:
    threads = max((pool["num_threads"] for pool in threadpool_info()), default=1)
    print(f"{SAMPLES} samples, 969 candidates, {TERMS} terms; {threads} threads")
    for offset in OFFSETS:
        speed(offset)
    lasso()
    memory()


if __name__ == "__main__":
    main()
