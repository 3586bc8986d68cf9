"""Kalman filter and smoother: against dense conditioning of the joint normal law, published numbers, least squares."""

from dataclasses import replace

import numpy as np
import pytest
from nile import NILE

from deatwin.ident.kalman import StateSpace, adjoint, advance_root, kalman_filter, kalman_smoother, update_root
from deatwin.plant.errors import ModelError


@pytest.fixture(params=["compiled", "plain"])
def loops(request, monkeypatch):
    """Both marches: the kernel where there is a compiler, and Python."""
    if request.param == "plain":
        monkeypatch.setenv("DEATWIN_COMPILER", "")
    return request.param


def covariance(rng, m, rank=None):
    root = rng.normal(size=(m, m if rank is None else rank))
    return root @ root.T


def cases():
    rng = np.random.default_rng(0)
    n, m = 22, 3
    walk = {"rows": rng.normal(size=(n, m)), "noise_variance": 0.3, "start": rng.normal(size=m)}
    moving = {"rows": rng.normal(size=(2, n, m)), "noise_variance": [0.3, 0.0], "start": rng.normal(size=m)}
    yield "constant", StateSpace(**walk, start_cov=covariance(rng, m))
    yield (
        "random walk with gaps",
        StateSpace(
            **walk,
            start_cov=covariance(rng, m),
            process_cov=np.diag([0.1, 0.0, 2.0]),
            intervals=rng.integers(1, 9, n - 1),
        ),
    )
    yield (
        "time invariant, start known exactly, one source",
        StateSpace(
            **walk,
            start_cov=np.zeros((m, m)),
            transition=rng.normal(size=(m, m)) / 2,
            process_cov=covariance(rng, m, 1),
        ),
    )
    yield (
        "two outputs, one without noise, all time-varying",
        StateSpace(
            **moving,
            start_cov=covariance(rng, m, 2),
            transition=rng.normal(size=(n - 1, m, m)) / 2,
            process_cov=np.array([covariance(rng, m) for _ in range(n - 1)]),
            intervals=rng.uniform(0.5, 2, n - 1),
            added=rng.normal(size=(n - 1, m)),
        ),
    )


def conditioned(model, outputs):
    """Mean and covariance of all states given all outputs, and the log likelihood, from the joint normal law."""
    p, n, m = model.rows.shape
    transition = np.broadcast_to(np.eye(m) if model.transition is None else model.transition, (n - 1, m, m))
    shift = np.zeros((n - 1, m)) if model.added is None else model.added
    added = np.broadcast_to(np.zeros((m, m)) if model.process_cov is None else model.process_cov, (n - 1, m, m))
    weights = np.ones(n - 1) if model.intervals is None else model.intervals
    mean, cov = np.zeros((n, m)), np.zeros((n, m, n, m))
    mean[0], cov[0, :, 0] = model.start, model.start_cov
    for k in range(n - 1):
        mean[k + 1] = transition[k] @ mean[k] + shift[k]
        for j in range(k + 1):
            cov[k + 1, :, j] = transition[k] @ cov[k, :, j]
            cov[j, :, k + 1] = cov[k + 1, :, j].T
        cov[k + 1, :, k + 1] = transition[k] @ cov[k, :, k] @ transition[k].T + weights[k] * added[k]
    mean, cov = mean.ravel(), cov.reshape(n * m, n * m)
    rows = np.zeros((p, n, n, m))
    rows[:, np.arange(n), np.arange(n)] = model.rows
    there = np.isfinite(outputs.ravel())
    rows, noise = rows.reshape(p * n, n * m)[there], np.repeat(model.noise_variance, n)[there]
    left = outputs.ravel()[there] - rows @ mean
    spread = rows @ cov @ rows.T + np.diag(noise)
    gain = np.linalg.solve(spread, rows @ cov).T
    sign, log_det = np.linalg.slogdet(2 * np.pi * spread)
    assert sign > 0
    states, covs = mean + gain @ left, cov - gain @ rows @ cov
    return states.reshape(n, m), covs.reshape(n, m, n, m), -0.5 * (log_det + left @ np.linalg.solve(spread, left))


@pytest.mark.parametrize(("name", "model"), list(cases()))
def test_smoother_equals_conditioning_of_the_joint_normal_law(name, model, loops):
    p, n, _ = model.rows.shape
    outputs = np.random.default_rng(1).normal(size=(p, n))
    outputs[0, 3] = outputs[:, 10] = np.nan
    filtered = kalman_filter(model, outputs)
    smoothed = kalman_smoother(filtered)
    states, covs, log_likelihood = conditioned(model, outputs)
    # Exact but for rounding; the dense reference solves systems of condition up to 1e5 here.
    assert filtered.log_likelihood == pytest.approx(log_likelihood, rel=1e-10)
    np.testing.assert_allclose(smoothed.states, states, rtol=0, atol=1e-10)
    np.testing.assert_allclose(smoothed.covariances, [covs[k, :, k] for k in range(n)], rtol=0, atol=1e-10)
    np.testing.assert_allclose(smoothed.std**2, [np.diag(covs[k, :, k]) for k in range(n)], rtol=0, atol=1e-10)
    # The filter knows what conditioning on the outputs so far knows.
    so_far = np.where(np.arange(n) <= 14, outputs, np.nan)
    states, covs, _ = conditioned(model, so_far)
    np.testing.assert_allclose(filtered.states[14], states[14], rtol=0, atol=1e-10)
    np.testing.assert_allclose(filtered.covariances[14], covs[14, :, 14], rtol=0, atol=1e-10)
    np.testing.assert_allclose(filtered.std[14] ** 2, np.diag(covs[14, :, 14]), rtol=0, atol=1e-10)


def test_nile_as_published(loops):
    # Durbin, Koopman, "Time Series Analysis by State Space Methods" (2001), section 2.10.3: variances 15099 and 1469.1
    # maximise the diffuse likelihood, -632.54; for a local level the diffuse start is N(y_1, R + Q) at the second year.
    # States and covariances: statsmodels 0.15.0, UnobservedComponents(y, "llevel", use_exact_diffuse=True).
    model = StateSpace(
        rows=np.ones((99, 1)),
        noise_variance=15099.0,
        start=NILE[:1],
        start_cov=[[15099.0 + 1469.1]],
        process_cov=[[1469.1]],
    )
    filtered = kalman_filter(model, NILE[1:])
    smoothed = kalman_smoother(filtered)
    assert filtered.log_likelihood == pytest.approx(-632.54, abs=0.01)
    assert filtered.log_likelihood == pytest.approx(-633.4645636488787 + 0.5 * np.log(2 * np.pi), abs=1e-8)
    chosen = [0, 49, 98]
    np.testing.assert_allclose(smoothed.states[chosen, 0], [1110.85766462, 829.55045118, 798.37029261], rtol=1e-10)
    np.testing.assert_allclose(
        smoothed.covariances[chosen, 0, 0], [3242.93007322, 2326.75686981, 4032.15794181], rtol=1e-10
    )


@pytest.mark.parametrize(("name", "model"), list(cases()))
def test_scores_are_the_derivatives_of_the_likelihood(name, model, loops):
    p, n, m = model.rows.shape
    outputs = np.random.default_rng(2).normal(size=(p, n))
    outputs[0, 5] = np.nan
    vectors, _ = adjoint(kalman_filter(model, outputs))
    step = 1e-5  # central differences: error of the order of step^2, relative to scores of order 1 to 100

    def slope(name, base, direction):
        up, down = (kalman_filter(replace(model, **{name: base + s * direction}), outputs) for s in (step, -step))
        return (up.log_likelihood - down.log_likelihood) / (2 * step)

    assert slope("start", model.start, np.eye(m)[1]) == pytest.approx(vectors[0, 1], rel=1e-6, abs=1e-6)
    if model.process_cov is not None and model.process_cov.ndim == 2:
        inside = model.process_cov + np.eye(m)  # away from the edge of the cone
        vectors, matrices = adjoint(kalman_filter(replace(model, process_cov=inside), outputs))
        weights, later = np.ones(n - 1) if model.intervals is None else model.intervals, vectors[1:]
        score = 0.5 * ((later * weights[:, None]).T @ later - np.tensordot(weights, matrices[1:], axes=1))
        for i, j in ((0, 0), (2, 2), (0, 2)):
            direction = np.zeros((m, m))
            direction[i, j] = direction[j, i] = 1.0
            expected = score[i, j] * (1 if i == j else 2)
            assert slope("process_cov", inside, direction) == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_collinear_states_and_a_wide_start(loops):
    # 1e12 times the variance of the noise beside regressors that differ in the sixth digit: a covariance filter loses
    # its sign here. The reference is least squares by QR on the rows with the start as further rows; its condition is
    # 1e6, so that the two can agree to 1e6 * 1e-16 times a factor for some hundred operations.
    rng = np.random.default_rng(3)
    n = 400
    base = rng.normal(size=n)
    rows = np.stack([base, base + 1e-6 * rng.normal(size=n), rng.normal(size=n)], axis=1)
    outputs = rows @ [1.0, -2.0, 0.5] + rng.normal(size=n)
    filtered = kalman_filter(
        StateSpace(rows=rows, noise_variance=1.0, start=np.zeros(3), start_cov=1e12 * np.eye(3)), outputs
    )
    q, r = np.linalg.qr(np.concatenate([rows, 1e-6 * np.eye(3)]))
    theta = np.linalg.solve(r, q.T @ np.concatenate([outputs, np.zeros(3)]))
    inverse = np.linalg.inv(r)
    np.testing.assert_allclose(filtered.states[-1], theta, rtol=1e-6)
    np.testing.assert_allclose(filtered.covariances[-1], inverse @ inverse.T, rtol=1e-6)
    assert all(np.all(np.linalg.eigvalsh(cov) > -1e-16 * np.trace(cov)) for cov in filtered.covariances)


def test_a_wide_start_costs_the_smoother_no_digits(loops):
    # Without process noise every smoothed state is the least squares solution of the whole record. The start is worth
    # 1e-12 of one sample; a smoother that subtracts from its covariance has no digit left at the first samples.
    rng = np.random.default_rng(8)
    rows = rng.normal(size=(200, 3)) * [1.0, 30.0, 0.01]
    outputs = rows @ [1.0, -0.02, 50.0] + rng.normal(size=200)
    model = StateSpace(
        rows=rows,
        noise_variance=1.0,
        start=np.zeros(3),
        start_cov=1e12 * np.diag([1.0, 1e-3, 1e4]),
        process_cov=np.zeros((3, 3)),
    )
    smoothed = kalman_smoother(kalman_filter(model, outputs))
    theta, *_ = np.linalg.lstsq(rows, outputs)
    cov = np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(smoothed.states, np.repeat(theta[None], 200, axis=0), rtol=1e-8)
    size = np.sqrt(np.outer(np.diag(cov), np.diag(cov)))
    np.testing.assert_allclose(smoothed.covariances / size, np.repeat((cov / size)[None], 200, axis=0), atol=1e-8)


def test_units_of_the_states_do_not_matter(loops):
    _, model = list(cases())[1]
    outputs = np.random.default_rng(9).normal(size=model.rows.shape[:2])
    unit = np.array([1e-9, 1.0, 1e7])
    other = replace(
        model,
        rows=model.rows / unit,
        start=model.start * unit,
        start_cov=model.start_cov * np.outer(unit, unit),
        process_cov=model.process_cov * np.outer(unit, unit),
    )
    one, two = (kalman_smoother(kalman_filter(m, outputs)) for m in (model, other))
    np.testing.assert_allclose(two.states / unit, one.states, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(two.covariances / np.outer(unit, unit), one.covariances, rtol=1e-9, atol=1e-12)
    assert two.log_likelihood == pytest.approx(one.log_likelihood, rel=1e-11)


def test_one_factor_on_all_covariances_is_found_in_closed_form():
    _, model = list(cases())[1]
    outputs = np.random.default_rng(4).normal(size=model.rows.shape[:2])
    filtered = kalman_filter(model, outputs)

    def scaled(factor):
        return kalman_filter(
            replace(
                model,
                noise_variance=factor * model.noise_variance,
                start_cov=factor * model.start_cov,
                process_cov=factor * model.process_cov,
            ),
            outputs,
        )

    best = filtered.variance_factor
    assert scaled(best).log_likelihood == pytest.approx(filtered.scaled_log_likelihood, rel=1e-12)
    assert scaled(best).log_likelihood > max(scaled(0.99 * best).log_likelihood, scaled(1.01 * best).log_likelihood)


def test_an_extended_filter_is_smoothed_as_its_linearisation(loops):
    # A pendulum, linearised along its filtered path by hand with the single steps; what they find is the exact filter
    # of the linear model with c_k = f(x) - F x.
    rng = np.random.default_rng(12)
    n, noise, source = 60, 0.01, np.array([[0.0, 0.05]])
    outputs = np.sin(0.2 * np.arange(n)) + 0.1 * rng.normal(size=n)

    def f(x):
        return np.array([x[0] + 0.1 * x[1], x[1] - 0.1 * np.sin(x[0])])

    state, root = np.array([0.1, 0.8]), 0.5 * np.eye(2)
    rows = np.repeat([[1.0, 0.0]], n, axis=0)
    states, transitions, added = [], [], []
    for k in range(n):
        root, gain, _ = update_root(root, rows[k], noise)
        state = state + gain * (outputs[k] - state[0])
        states.append(state)
        transition = np.array([[1.0, 0.1], [-0.1 * np.cos(state[0]), 1.0]])
        transitions.append(transition)
        added.append(f(state) - transition @ state)
        state, root = f(state), advance_root(root, transition, source)
    linear = StateSpace(
        rows=rows,
        noise_variance=noise,
        start=[0.1, 0.8],
        start_cov=0.25 * np.eye(2),
        transition=transitions[:-1],
        added=added[:-1],
        process_cov=source.T @ source,
    )
    filtered = kalman_filter(linear, outputs)
    np.testing.assert_allclose(filtered.states, states, rtol=1e-9, atol=1e-12)
    expected = conditioned(linear, outputs[None])[0]
    np.testing.assert_allclose(kalman_smoother(filtered).states, expected, rtol=0, atol=1e-9)


def test_what_cannot_be_is_said(loops):
    fine = {"rows": np.ones((4, 2)), "noise_variance": 1.0, "start": np.zeros(2), "start_cov": np.eye(2)}
    for change, text in (
        ({"start": np.zeros(3)}, "start has the shape"),
        ({"transition": np.ones((4, 2, 2))}, "transition has the shape"),
        ({"rows": np.ones(4)}, "rows have the shape"),
        ({"noise_variance": -1.0}, "must not be negative"),
        ({"fading": 0.0}, "fading = 0"),
    ):
        with pytest.raises(ModelError, match=text):
            StateSpace(**fine | change)
    for cov in ([[1.0, 2.0], [2.0, 1.0]], [[1.0, 0.5], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]):
        with pytest.raises(ModelError, match="positive semidefinite"):
            kalman_filter(StateSpace(**fine | {"start_cov": cov}), np.zeros(4))
    with pytest.raises(ModelError, match="outputs have the shape"):
        kalman_filter(StateSpace(**fine), np.zeros(5))
    certain = StateSpace(**fine | {"noise_variance": 0.0, "start_cov": np.zeros((2, 2))})
    with pytest.raises(ModelError, match="sample 1 was certain"):
        kalman_filter(certain, [np.nan, 1.0, 1.0, 1.0])
    with pytest.raises(ModelError, match="fading"):
        adjoint(kalman_filter(StateSpace(**fine | {"fading": 0.9}), np.zeros(4)))
