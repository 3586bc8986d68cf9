"""The variational lower bound never falls during an update, whatever the regression."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance, posterior

sizes = st.integers(1, 25)
exponents = st.floats(-3, 3)


@st.composite
def regressions(draw):
    """Regressors of sizes over six decades, some all but equal, some that count, and noise from nothing to all."""
    n, m = draw(st.integers(2, 120)), draw(sizes)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    phi = rng.normal(size=(n, m)) * 10 ** rng.uniform(-draw(st.floats(0, 3)), 3, m)
    for _ in range(draw(st.integers(0, 3))):  # a regressor that is another one up to a little
        i, j = rng.integers(m, size=2)
        phi[:, i] = phi[:, j] * (1 + 10 ** -draw(st.floats(1, 6)) * rng.normal(size=n))
    theta = np.where(rng.uniform(size=m) < draw(st.floats(0, 1)), rng.normal(size=m), 0.0)
    return phi, phi @ theta + 10 ** draw(st.floats(-4, 2)) * rng.normal(size=n)


@settings(max_examples=150, deadline=None)
@given(
    regression=regressions(),
    priors=st.builds(
        Priors, a0=st.floats(1e-3, 2), b0=st.floats(1e-6, 2), c0=st.floats(1e-3, 2), d0=st.floats(1e-6, 2)
    ),
    start=exponents,
)
def test_the_bound_never_falls(regression, priors, start):
    phi, y = regression
    data = Statistics(gram=phi.T @ phi, moment=phi.T @ y, power=float(y @ y), n_samples=y.size)
    data = data.divided(data.sizes)
    alpha = np.full(phi.shape[1], 10**start)
    fit = fit_relevance(data, priors, alpha, tolerance=0.0, max_iterations=100)
    bounds = np.array(fit.bounds)
    # The sum of squares comes from differences of y'y, of which each is right to a few units in the last place; the
    # bound holds half of it times the noise precision.
    q = fit.posterior
    first = posterior(data, alpha, priors)
    rounding = 1e-14 * y.size * data.power * max(q.a / q.b, first.a / first.b) + 1e-12 * np.abs(bounds[1:])
    assert np.all(np.diff(bounds) >= -rounding)
