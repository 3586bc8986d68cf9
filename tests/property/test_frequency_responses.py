"""Frequency responses of random models equal those that sympy gets by expanding the model's equation in tones."""

from collections import Counter
from functools import reduce
from itertools import combinations
from math import factorial, prod

import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sympy.polys.domains import QQ, QQ_I
from sympy.polys.rings import ring as polynomial_ring

from deatwin.ident.frequency import equilibrium, gfrf
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError

SAMPLE_TIME = 0.25

factors = st.sampled_from([("y", 1), ("y", 2), ("y", 3), ("u", 0), ("u", 1), ("u", 3)])
lower = st.lists(factors, min_size=0, max_size=1).map(tuple)
tangents = st.fractions(-4, 4, max_denominator=16)
higher = st.lists(factors, min_size=2, max_size=4).map(lambda chosen: tuple(sorted(chosen)))
eighths = st.sampled_from([sympy.Rational(sign * size, 8) for size in (1, 2, 3) for sign in (1, -1)])


def written(factors):
    """As `NarxModel.from_terms` reads it."""
    signals = {("u", 0): "u(k)"}
    parts = Counter(signals.get(f, f"{f[0]}(k-{f[1]})") for f in factors)
    return "".join(f"{part}^{power}" for part, power in parts.items()) or "1"


@st.composite
def models(draw):
    """Up to eight terms of degree 0 to 4; the input always acts alone too."""
    terms = draw(st.dictionaries(lower, eighths, max_size=3)) | {(("u", 1),): sympy.Rational(1)}
    return terms | draw(st.dictionaries(higher, eighths, min_size=1, max_size=4))


def symbolic(terms, z, ybar, ubar):
    """H_n, exact, at tones given by z_i = e^(-jw_i) in Gaussian rationals.

    The input is ubar plus the sum of a_i z_i^-k, the output ybar plus the sum over all sets S of tones of Y_S times the
    product of their a_i z_i^-k. The model's equation is expanded as a polynomial in the a_i; its coefficient at the
    product of those of S is linear in Y_S.
    """
    n = len(z)
    ring, *a = polynomial_ring(f"a:{n}", QQ_I)

    def tone(chosen, lag):
        return prod((a[i] * z[i] ** lag for i in chosen), start=ring.one)

    def multilinear(polynomial):  # squares of an a_i belong to other responses
        return ring.from_dict({powers: c for powers, c in polynomial.items() if max(powers) < 2})

    def equation(y, chosen):
        """Left less right side of the model, its coefficient at the tones of a set."""
        delayed = {("u", lag): QQ_I.convert(ubar) + sum(tone([i], lag) for i in range(n)) for lag in range(4)}
        delayed |= {("y", lag): QQ_I.convert(ybar) + sum(v * tone(s, lag) for s, v in y.items()) for lag in range(4)}
        total = delayed["y", 0]
        for factors, value in terms.items():
            total -= QQ_I.convert(value) * reduce(lambda p, f: multilinear(p * delayed[f]), factors, ring.one)
        return total.get(tuple(int(i in chosen) for i in range(n)), QQ_I.zero)

    y = {}
    for chosen in (s for size in range(1, n + 1) for s in combinations(range(n), size)):
        y[chosen] = QQ_I.zero
        without = equation(y, chosen)
        y[chosen] = QQ_I.one
        slope = equation(y, chosen) - without
        assume(abs(complex(QQ_I.to_sympy(slope))) > 0.05)  # far from poles, where rounding would grow
        y[chosen] = -without / slope
    return complex(QQ_I.to_sympy(y[chosen])) / factorial(n)


@pytest.mark.parametrize("order", [1, 2, 3])
@settings(max_examples=25, deadline=None)
@given(
    terms=models(),
    tangents=st.tuples(tangents, tangents, tangents),
    ubar=st.sampled_from([0, sympy.Rational(1, 2), sympy.Rational(-1, 4)]),
)
def test_they_equal_the_symbolic_ones(order, terms, tangents, ubar):
    """At points of the unit circle that are Gaussian rationals, the squares of 1 - jt by their size."""
    named = {written(chosen): float(value) for chosen, value in terms.items()}
    model = NarxModel.from_terms(named, sample_time=SAMPLE_TIME)
    try:
        ybar = equilibrium(model, float(ubar)).output
    except ModelError:  # none
        assume(False)
    rational = [QQ(t.numerator, t.denominator) for t in tangents[:order]]
    z = [QQ_I((1 - t * t) / (1 + t * t), -2 * t / (1 + t * t)) for t in rational]
    expected = symbolic(terms, z, sympy.Rational(ybar), ubar)
    omega = 2 * np.arctan(np.array(tangents[:order], dtype=float)) / SAMPLE_TIME
    found = gfrf(model, order, omega, operating_input=float(ubar)).values[0]
    # Up to seven denominators of at least 0.05 and products of up to four of them: 1e-16 may grow by 1e5.
    assert abs(found - expected) <= 1e-11 * max(abs(expected), 1.0)
