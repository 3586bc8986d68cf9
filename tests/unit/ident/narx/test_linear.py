"""Linear estimators: gradients, closed forms, the Cramér-Rao bound, two peers, and the contract."""

import numpy as np
import pytest
from scipy.signal import lfilter
from slopes import differences

from deatwin.ident.narx import FitStatus, NarxModel
from deatwin.ident.narx.linear import Armax, Arx, BoxJenkins, Orders, OutputError
from deatwin.ident.narx.linear import prediction as search_module
from deatwin.ident.narx.linear.polynomials import is_stable
from deatwin.ident.narx.linear.prediction import prediction_errors
from deatwin.plant.recording import Recording

# A resonant plant (poles 0.75 ± 0.37i) with one sample of delay.
B, F = [0.0, 1.0, 0.5], [1.0, -1.5, 0.7]
SIGMA = 0.5


def record(rng, c=(1.0,), d=(1.0,), n=500, level=0.0):
    """y = (B/F) u + SIGMA (C/D) e + level from rest, white Gaussian u and e; the first 100 samples are cut."""
    u, e = rng.normal(size=(2, n + 100))
    y = lfilter(B, F, u) + SIGMA * lfilter(c, d, e) + level
    return Recording.from_arrays(u[100:], y[100:], 0.1)


@pytest.mark.parametrize(("na", "nc", "nd", "nf"), [(2, 2, 0, (0, 0)), (0, 2, 3, (2, 1)), (2, 1, 1, (1, 2))])
def test_the_gradient_is_that_of_finite_differences(na, nc, nd, nf):
    orders = Orders(na=na, nb=(2, 1), nc=nc, nd=nd, nf=nf, nk=(1, 0), offset=True)
    rng = np.random.default_rng(1)
    inputs, output = rng.normal(size=(2, 60)), rng.normal(size=60)
    theta, start = 0.3 * rng.normal(size=orders.n_theta), rng.normal(size=sum(nf))

    def errors(unknowns):
        p = orders.split(unknowns[: orders.n_theta])
        return prediction_errors(orders, p, inputs, output, unknowns[orders.n_theta :])

    at = np.r_[theta, start]
    assert all(is_stable(p) for p in (orders.split(theta).c, *orders.split(theta).f))
    found = errors(at)
    gradient = np.concatenate([found.theta_gradient, found.start_gradient])
    # central differences: error of order step^2 and rounding / step, both near 1e-10
    slopes = differences(lambda unknowns: errors(unknowns).errors, at, 1e-5).T
    np.testing.assert_allclose(gradient, slopes, atol=1e-7 * max(1.0, np.abs(gradient).max()))


def test_arx_is_linear_least_squares_and_a_narx_model():
    rng = np.random.default_rng(3)
    recordings = [record(rng, d=F, n=80, level=0.2), record(rng, d=F, n=60, level=0.2)]
    model = Arx(na=2, nb=2).fit(recordings).model_
    columns, targets = [], []
    for r in recordings:
        u, y = r.inputs[0], r.outputs[0]
        columns.append(np.stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2], np.ones(y.size - 2)]))
        targets.append(y[2:])
    phi, target = np.concatenate(columns, axis=1).T, np.concatenate(targets)
    theta, square, *_ = np.linalg.lstsq(phi, target)
    np.testing.assert_allclose(model.theta, theta, rtol=1e-10)
    sigma2 = square[0] / (target.size - 5)
    assert model.noise_variance == pytest.approx(sigma2, rel=1e-10)
    np.testing.assert_allclose(model.theta_cov, sigma2 * np.linalg.inv(phi.T @ phi), rtol=1e-8)

    narx = model.to_narx()
    assert isinstance(narx, NarxModel)
    assert [str(term) for term in narx.terms] == ["y(k-1)", "y(k-2)", "u(k-1)", "u(k-2)", "1"]
    np.testing.assert_allclose(narx.theta, theta * [-1, -1, 1, 1, 1], rtol=1e-10)
    np.testing.assert_allclose(model.predict(recordings[0]).outputs, narx.predict(recordings[0]).outputs, rtol=1e-12)


@pytest.mark.parametrize("estimator", [Armax(), OutputError(), BoxJenkins()])
def test_without_noise_the_plant_is_exact_even_from_a_state_that_is_not_rest(estimator):
    u = np.random.default_rng(4).normal(size=(2, 150))
    recordings = []
    for row, state in zip(u, ([3.0, -1.0], [-2.0, 0.5]), strict=True):
        y = lfilter(B, F, row, zi=state)[0] + 0.7
        recordings.append(Recording.from_arrays(row, y, 0.1))
    model = estimator.fit(recordings).model_
    omega = np.linspace(0.1, 30.0, 50)
    shift = np.exp(-0.1j * omega)
    exact = (shift + 0.5 * shift**2) / (1 - 1.5 * shift + 0.7 * shift**2)
    # the floor is rounding, 2e-16, on a resonance of gain 9 and errors that end at 1e-10 of the output
    np.testing.assert_allclose(model.to_control()(np.exp(0.1j * omega)), exact, rtol=1e-7)
    run = model.simulate(recordings[1])
    assert np.abs(run.residuals).max() < 1e-6 and run.first == 2 + 20


def information(orders, theta):
    """Fisher information of one sample for white Gaussian u of variance 1 and e of variance SIGMA^2.

    Ljung, eq. (9.54): the mean over frequency of [G' Phi_u G'^* / Phi_e + H' H'^*] / |H|^2 for G = B/(A F) and
    H = C/(A D), by the trapezoidal rule, which is exact to rounding for periodic functions; G' and H' by central
    differences, so that nothing of the code under test is used.
    """
    q = np.exp(-2j * np.pi * np.arange(4096) / 4096)

    def responses(values):
        p = orders.split(values)
        at = [np.polyval(c[::-1], q) for c in (p.a, p.b[0], p.c, p.d, p.f[0])]
        return np.array([at[1] / (at[0] * at[4]), at[2] / (at[0] * at[3])])

    step = 1e-6
    slopes = np.array(
        [(responses(theta + step * row) - responses(theta - step * row)) / (2 * step) for row in np.eye(theta.size)]
    )
    g, h = (slopes / responses(theta)[1]).transpose(1, 0, 2)
    return ((g @ g.conj().T) / SIGMA**2 + h @ h.conj().T).real / q.size


CASES = {
    "armax": (Armax(na=2, nb=2, nc=1, offset=False), (1.0, 0.6), F, [-1.5, 0.7, 1.0, 0.5, 0.6]),
    "oe": (OutputError(nb=2, nf=2, offset=False), (1.0,), (1.0,), [1.0, 0.5, -1.5, 0.7]),
    "bj": (BoxJenkins(nb=2, nf=2, nc=1, nd=1, offset=False), (1.0, 0.6), (1.0, -0.8), [1.0, 0.5, -1.5, 0.7, 0.6, -0.8]),
}


@pytest.mark.parametrize(("estimator", "c", "d", "theta"), CASES.values(), ids=CASES)
def test_estimates_reach_the_cramer_rao_bound(estimator, c, d, theta):
    runs, n, rng, theta = 30, 400, np.random.default_rng(5), np.array(theta)
    models = [estimator.fit(record(rng, c, d, n)).model_ for _ in range(runs)]
    bound = np.linalg.inv(information(estimator._orders(1), theta)) / n
    errors = np.array([model.theta[:-1] for model in models]) - theta
    # An efficient estimator without bias: the sum of squares in the metric of the bound is chi-squared with
    # runs * n_theta degrees of freedom. Four standard deviations, and 30/n for terms of the next order in 1/n.
    square = np.einsum("ri,ij,rj->", errors, np.linalg.inv(bound), errors) / errors.size
    assert abs(square - 1) < 4 * np.sqrt(2 / errors.size) + 30 / n
    # No bias: each mean within four of its standard deviations, and a tenth of the deviation for the order 1/n.
    spread = np.sqrt(np.diag(bound))
    assert np.all(np.abs(errors.mean(axis=0)) < (4 / np.sqrt(runs) + 0.1) * spread)
    # What the models say of their own uncertainty, on average, is the bound, correlations and all.
    said = np.mean([model.theta_cov[:-1, :-1] for model in models], axis=0)
    np.testing.assert_allclose(np.diag(said), spread**2, rtol=0.15)
    root = np.linalg.inv(np.linalg.cholesky(bound))
    np.testing.assert_allclose(root @ said @ root.T, np.eye(theta.size), atol=0.15)
    assert np.mean([m.noise_variance for m in models]) == pytest.approx(SIGMA**2, rel=4 * np.sqrt(2 / (n * runs)))


def peers_data(c, d, f=(1.0, -1.5, 0.7), n=600):
    """As tests/benchmarks/linear_peers.py makes them."""
    rng = np.random.default_rng(20261120)
    u, e = 2 * rng.random((2, n)) - 1
    return Recording.from_arrays(u, lfilter(B, f, u) + 0.5 * lfilter(c, d, e), 1.0)


# Printed by tests/benchmarks/linear_peers.py with sippy_unipi 1.0.1 and statsmodels 0.15.0.
PEERS = [
    # SIPPY's ARMAX minimises the same sum of squares with the same conditions: its tolerance is the limit.
    (
        Armax(na=2, nb=2, nc=1, offset=False),
        ((1.0, 0.6), (1.0, -1.5, 0.7)),
        [-1.486701630753902, 0.6878335858715133, 0.9816912784432914, 0.49455188186148374, 0.6279019044933623],
        1e-6,
    ),
    # The others treat the start otherwise (SIPPY from rest, statsmodels by the exact likelihood): estimates
    # differ by terms of order 1/n, about 1/sqrt(600) = 0.04 standard deviations; 0.15 is allowed.
    (
        OutputError(nb=2, nf=2, offset=False),
        ((1.0,), (1.0,)),
        [0.9737717467116698, 0.5348712140184704, -1.4955903946257008, 0.696186551127249],
        0.15,
    ),
    (
        BoxJenkins(nb=2, nc=1, nd=1, nf=2, offset=False),
        ((1.0, 0.6), (1.0, -0.8)),
        [
            0.977393017495577,
            0.4889334401544596,
            -1.498586466178618,
            0.7004904149497658,
            0.6254953183767111,
            -0.7897619518834527,
        ],
        0.15,
    ),
    (
        BoxJenkins(nb=2, nc=1, nd=1, nf=0, offset=False),
        ((1.0, 0.6), (1.0, -0.8), (1.0,)),
        [0.9987337807328291, 0.5018494174367822, 0.6256334929102625, -0.7894125073714044],
        0.15,
    ),
]


@pytest.mark.parametrize(("estimator", "system", "published", "tolerance"), PEERS)
def test_against_peers(estimator, system, published, tolerance):
    model = estimator.fit(peers_data(*system)).model_
    deviations = (model.theta[:-1] - published) / np.sqrt(np.diag(model.theta_cov)[:-1])
    assert np.abs(deviations).max() < tolerance


def test_several_inputs_with_their_own_orders_and_delays():
    rng = np.random.default_rng(7)
    u, e = rng.normal(size=(2, 800)), 0.1 * rng.normal(size=800)
    y = lfilter([0, 1.0], [1, -0.8], u[0]) + lfilter([0, 0, 0, 0.4, 0.2], [1, -0.2, 0.5], u[1]) + e
    recording = Recording.from_arrays(u, y, 0.1)
    model = OutputError(nb=(1, 2), nf=(1, 2), nk=(1, 3)).fit(recording).model_
    truth = [1.0, 0.4, 0.2, -0.8, -0.2, 0.5, 0.0]
    assert np.all(np.abs(model.theta - truth) < 4 * np.sqrt(np.diag(model.theta_cov)))
    assert model.orders.nk == (1, 3) and model.orders.nf == (1, 2)
    assert model.noise_variance == pytest.approx(0.01, rel=4 * np.sqrt(2 / 800))


def test_units_change_nothing_but_the_units():
    plain = record(np.random.default_rng(8), (1.0, 0.6), (1.0, -0.8), level=1.0)
    other = Recording.from_arrays(plain.inputs * 2.0**11, plain.outputs * 2.0**-13, 0.1)
    a, b = (BoxJenkins(nc=1, nd=1).fit(r).model_ for r in (plain, other))
    factors = np.array([2.0**-24] * 2 + [1.0] * 4 + [2.0**-13])
    np.testing.assert_array_equal(b.theta, a.theta * factors)
    np.testing.assert_allclose(b.theta_cov, a.theta_cov * np.outer(factors, factors), rtol=1e-12)
    assert b.noise_variance == pytest.approx(a.noise_variance * 2.0**-26, rel=1e-12)


def test_c_and_f_stay_stable_on_the_edge():
    # Differenced white noise has its C root on the unit circle, an integrator its F root: the estimates come
    # near, from inside.
    rng = np.random.default_rng(9)
    u, e = rng.normal(size=(2, 300))
    y = np.cumsum(0.1 * u) + 0.1 * lfilter([1.0, -1.0], [1.0], e)
    model = BoxJenkins(nb=1, nf=1, nc=1, nd=0, nk=0).fit(Recording.from_arrays(u, y, 1.0)).model_
    assert is_stable(model.c) and is_stable(model.f[0])
    assert model.c[1] < -0.9 and model.f[0][1] == pytest.approx(-1.0, abs=0.02)


def test_an_interrupt_keeps_the_best_so_far(monkeypatch):
    recording = record(np.random.default_rng(10), (1.0, 0.6), (1.0, -0.8))
    whole = BoxJenkins(nc=1, nd=1).fit(recording)
    calls = []
    gradient = search_module.PredictionErrorLoss.gradient

    def stopped(self, unknowns):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return gradient(self, unknowns)

    monkeypatch.setattr(search_module.PredictionErrorLoss, "gradient", stopped)
    cut = BoxJenkins(nc=1, nd=1).fit(recording)
    assert whole.status_ is FitStatus.DONE and cut.status_ is FitStatus.INTERRUPTED
    assert whole.model_.noise_variance <= cut.model_.noise_variance < 1.05 * whole.model_.noise_variance


def test_what_the_data_do_not_determine_is_uncertain():
    # white noise answers to nothing: where B is zero, F has no meaning; two equal inputs share in any way
    rng = np.random.default_rng(14)
    u, e = rng.normal(size=(2, 400))
    model = OutputError(nb=1, nf=1).fit(Recording.from_arrays(np.stack([u, u]), 2 * u + 0.1 * e, 1.0)).model_
    assert np.sqrt(model.theta_cov[0, 0]) > 1.0
