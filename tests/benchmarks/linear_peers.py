"""Estimates of two peers for tests/unit/ident/narx/test_linear.py: run in an environment that has them.

    python -m venv peers && peers/bin/pip install statsmodels==0.15.0 sippy_unipi==1.0.1
    peers/bin/python tests/benchmarks/linear_peers.py

statsmodels maximises the exact Gaussian likelihood of a regression on lagged inputs with ARMA noise (a Box-Jenkins
model with F = 1); SIPPY minimises prediction errors from zero initial states (ARMAX, output error, Box-Jenkins).
"""

import numpy as np


def data(noise_numerator, noise_denominator, b=(0.0, 1.0, 0.5), f=(1.0, -1.5, 0.7), n=600):
    """Input and output of y = (B/F) u + 0.5 (C/D) e, uniform on [-1, 1], from rest."""
    rng = np.random.default_rng(20261120)
    u, e = 2 * rng.random((2, n)) - 1
    return u, _filtered(b, f, u) + 0.5 * _filtered(noise_numerator, noise_denominator, e)


def _filtered(numerator, denominator, x):
    y = np.zeros(x.size)
    for k in range(x.size):
        y[k] = sum(c * x[k - i] for i, c in enumerate(numerator) if i <= k)
        y[k] -= sum(c * y[k - i] for i, c in enumerate(denominator) if 0 < i <= k)
    return y


def statsmodels_figures():
    from statsmodels.tsa.statespace.sarimax import SARIMAX

    u, y = data((1.0, 0.6), (1.0, -0.8), f=(1.0,))
    exog = np.column_stack([u[1:-1], u[:-2]])  # u(k-1), u(k-2) from the third sample on
    fit = SARIMAX(y[2:], exog=exog, order=(1, 0, 1)).fit(disp=False, pgtol=1e-10, maxiter=500)
    print("statsmodels", dict(zip(fit.param_names, fit.params, strict=True)), "standard errors", fit.bse)


def sippy_figures():
    from sippy_unipi import system_identification

    for name, noise, orders in (
        ("ARMAX", ((1.0, 0.6), (1.0, -1.5, 0.7)), {"ARMAX_orders": [2, 2, 1, 0], "ARMAX_mod": "OPT"}),
        ("OE", ((1.0,), (1.0,)), {"OE_orders": [2, 2, 0]}),
        ("BJ", ((1.0, 0.6), (1.0, -0.8)), {"BJ_orders": [2, 1, 1, 2, 0]}),
    ):
        u, y = data(*noise)
        found = system_identification(y, u, name, max_iterations=500, **orders)
        print("sippy", name, "G", found.NUMERATOR, found.DENOMINATOR, "H", found.NUMERATOR_H, found.DENOMINATOR_H)


if __name__ == "__main__":
    statsmodels_figures()
    sippy_figures()
