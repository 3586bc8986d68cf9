"""Speed and memory of `gfrf` beside a symbolic route: ``python tests/benchmarks/bench_gfrf.py``.

The third-order frequency response of a model of 20 terms on 64 x 64 x 64 points, in processor time on one core (best of
a few runs). The symbolic route writes the recursion of Peyton Jones and Billings in sympy, as published programs do:
frequencies and lags are symbols, H_2 of other frequencies is a substitution, and the expression is made a function of
numpy arrays by `lambdify`; once as it comes, and once with common subexpressions taken out, which published programs do
not. It gives the recursive form; the symmetric one is its mean over the six permutations of the frequencies. Building
the expression belongs to the symbolic route; ratios are given with and without. Memory is the peak of what is allocated
(tracemalloc) beside what goes in and comes out. No test depends on these figures.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tracemalloc
from itertools import permutations
from typing import Any

import numpy as np
from stopwatch import best

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.narx import NarxModel

POINTS, SAMPLE_TIME = 64, 0.1
LINEAR = {"y(k-1)": 0.5, "y(k-2)": 0.1, "u(k-1)": 0.3, "u(k-2)": 0.2}
QUADRATIC = ["y(k-1)^2", "y(k-1)y(k-2)", "y(k-2)^2", "y(k-1)u(k-1)", "y(k-2)u(k-1)", "u(k-1)^2", "u(k-1)u(k-2)"]
CUBIC = [
    "y(k-1)^3",
    "y(k-1)^2y(k-2)",
    "y(k-1)y(k-2)^2",
    "y(k-2)^3",
    "y(k-1)^2u(k-1)",
    "y(k-1)u(k-1)^2",
    "y(k-2)u(k-2)^2",
    "u(k-1)^3",
    "u(k-1)^2u(k-2)",
]
MODEL = NarxModel.from_terms(LINEAR | dict.fromkeys(QUADRATIC + CUBIC, 0.01), sample_time=SAMPLE_TIME)


def lags_by_kind() -> dict[tuple[int, int], list[tuple[list[int], float]]]:
    """The lags of each term, those of outputs first, by how many outputs and inputs it holds."""
    found: dict[tuple[int, int], list[tuple[list[int], float]]] = {}
    for term, value in zip(MODEL.terms, MODEL.theta, strict=True):
        lags = [[v.lag for v in term.expanded if v.kind == kind] for kind in "yu"]
        found.setdefault((len(lags[0]), len(lags[1])), []).append((lags[0] + lags[1], float(value)))
    return found


def symbolic(order: int) -> Any:
    """H_n of the model as an expression of sympy, and its frequencies."""
    import sympy as sym

    c = lags_by_kind()
    w, lag = sym.symbols(f"w1:{order + 1}", real=True), sym.symbols(f"lag1:{order + 1}")
    h: dict[int, Any] = {}
    hp: dict[tuple[int, int], Any] = {}

    def turned(frequencies: Any, lags: Any) -> Any:
        return sym.exp(-sym.I * SAMPLE_TIME * sum(f * k for f, k in zip(frequencies, lags, strict=True)))

    def at_lags(n: int, p: int, lags: list[int]) -> Any:
        return hp[n, p].subs(list(zip(lag, lags, strict=False)))

    for n in range(1, order + 1):
        for p in range(2, n + 1):
            hp[n, p] = sum(
                h[i]
                * hp[n - i, p - 1].subs(list(zip(w, w[i:n], strict=False)), simultaneous=True)
                * turned([sum(w[:i])], [lag[p - 1]])
                for i in range(1, n - p + 2)
            )
        total = sum(value * turned(w[:n], lags) for lags, value in c.get((0, n), []))
        for q in range(1, n):
            for p in range(1, n - q + 1):
                for lags, value in c.get((p, q), []):
                    total += value * turned(w[n - q : n], lags[p:]) * at_lags(n - q, p, lags[:p])
        for p in range(2, n + 1):
            total += sum(value * at_lags(n, p, lags) for lags, value in c.get((p, 0), []))
        h[n] = total / (1 - sum(value * turned([sum(w[:n])], lags) for lags, value in c.get((1, 0), [])))
        hp[n, 1] = h[n] * turned([sum(w[:n])], [lag[0]])
    return w, h[order]


def peer(omega: np.ndarray, ours: dict[str, tuple[float, np.ndarray]]) -> None:
    try:
        import sympy
    except ImportError:
        print("sympy is not installed: no comparison")
        return
    print(f"\nsympy {sympy.__version__}")
    build, (frequencies, expression) = best(lambda: symbolic(3), 1)
    for name, options in (("as it comes", {}), ("common subexpressions taken out", {"cse": True})):
        compiled, function = best(lambda o=options: sympy.lambdify(frequencies, expression, "numpy", **o), 1)  # type: ignore[misc]
        print(f"{name}: expression {build:.2f} s, function {compiled:.2f} s")
        for form, orders in (("recursive", [(0, 1, 2)]), ("symmetric", list(permutations(range(3))))):
            columns = [omega[:, order].T for order in orders]
            run, values = best(lambda f=function, c=columns: sum(f(*w) for w in c) / len(c), 2)  # type: ignore[misc]
            seconds, expected = ours[form]
            assert np.allclose(values, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
            print(
                f"  {form}: {run:.2f} s; {(build + compiled + run) / seconds:.0f} times ours with building, "
                f"{run / seconds:.0f} times without"
            )


def memory(omega: np.ndarray) -> None:
    for count in (len(omega) // 8, len(omega)):
        tracemalloc.start()
        response = gfrf(MODEL, 3, omega[:count])
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        copies = 2 * omega[:count].nbytes + response.values.nbytes  # in rad/s and rad/sample
        print(f"{count:7d} points: peak {peak / 1e6:.0f} MB, of which {copies / 1e6:.0f} MB are frequencies and values")
    tracemalloc.start()
    gradient = response.gradient
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"their gradient: peak {peak / 1e6:.0f} MB, of which {gradient.nbytes / 1e6:.0f} MB are itself")


def main() -> None:
    axis = np.linspace(-1.0, 1.0, POINTS) * np.pi / SAMPLE_TIME
    omega = frequency_grid(axis, axis, axis)
    print(f"H_3 of {len(MODEL.terms)} terms on {POINTS}^3 = {len(omega)} points, one core")
    ours = {}
    for form in ("symmetric", "recursive"):
        seconds, response = best(lambda f=form: gfrf(MODEL, 3, omega, form=f), 5)  # type: ignore[misc]
        ours[form] = seconds, response.values
        print(f"{form}: {seconds:.3f} s")
    seconds, _ = best(lambda: gfrf(MODEL, 3, omega).gradient, 1)
    print(f"symmetric with the derivatives by {len(MODEL.terms)} parameters: {seconds:.2f} s")
    memory(omega)
    peer(omega, ours)


if __name__ == "__main__":
    main()
