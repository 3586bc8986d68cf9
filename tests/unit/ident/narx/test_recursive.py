"""theta(t): recursive least squares against batch solutions, the smoother against truth, theory and Monte Carlo."""

import numpy as np
import pytest
from stopping import StopAt

from deatwin.ident.narx import FitStatus, NarxModel
from deatwin.ident.narx.recursive import Rls, ThetaSmoother
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.ident.testing import check_identifier
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Experiment, Recording

TERMS = ("y(k-1)", "u(k-1)", "u(k-1)^2")


def walk(rng, n, start, std, gap=()):
    """Random walks, shape (3, n); ``gap`` = (sample, steps): so many steps before that sample."""
    steps = np.array(std)[:, None] * rng.normal(size=(3, n))
    if gap:
        steps[:, gap[0]] *= np.sqrt(gap[1])
    return np.array(start)[:, None] + np.cumsum(steps, axis=1)


def drive(rng, theta, noise=0.1):
    """y(k) = theta(k)'(y(k-1), u(k-1), u(k-1)^2) + e(k), u uniform in ±1."""
    n = theta.shape[1]
    u, e, y = rng.uniform(-1, 1, n), noise * rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        y[k] = theta[0, k] * y[k - 1] + theta[1, k] * u[k - 1] + theta[2, k] * u[k - 1] ** 2 + e[k]
    return u, y


def drifting(seed=0, n=600, std=(0.002, 0.02, 0.0)):
    rng = np.random.default_rng(seed)
    theta = walk(rng, n, (0.5, 1.0, -0.4), std)
    u, y = drive(rng, theta)
    return Recording.from_arrays(u, y, 0.1, start=3.0), theta


def regressors(*recordings):
    """Regressors, shape (n, 3), and outputs, written once more."""
    rows = [np.stack([r.outputs[0, :-1], r.inputs[0, :-1], r.inputs[0, :-1] ** 2], axis=1) for r in recordings]
    return np.concatenate(rows), np.concatenate([r.outputs[0, 1:] for r in recordings])


# ---- recursive least squares


def test_without_forgetting_it_ends_at_least_squares():
    recording, _ = drifting()
    rls = Rls(terms=TERMS, forgetting=1.0)
    assert rls.fit(recording) is rls and rls.status_ is FitStatus.DONE
    phi, y = regressors(recording)
    theta, left, *_ = np.linalg.lstsq(phi, y)
    noise = left[0] / (len(y) - 3)
    np.testing.assert_allclose(rls.model_.theta, theta, rtol=1e-11)
    assert rls.model_.noise_variance == pytest.approx(noise, rel=1e-11)
    np.testing.assert_allclose(rls.model_.theta_cov, noise * np.linalg.inv(phi.T @ phi), rtol=1e-9)


def test_every_sample_is_the_weighted_least_squares_of_its_past():
    (recording, _), forgetting = drifting(1, 200), 0.95
    found = Rls(terms=TERMS, forgetting=forgetting).fit(recording).trajectory_
    phi, y = regressors(recording)
    assert found.timepts[-1] == recording.timepts[-1]
    for k in (found.timepts.size - 1, found.timepts.size // 2, 5, 0):
        last = np.flatnonzero(np.isclose(recording.timepts[1:], found.timepts[k]))[0] + 1
        weights = np.sqrt(forgetting) ** np.arange(last - 1, -1, -1)
        theta, *_ = np.linalg.lstsq(weights[:, None] * phi[:last], weights * y[:last])
        np.testing.assert_allclose(found.theta[:, k], theta, rtol=1e-9)
        spread = np.linalg.inv((weights[:, None] * phi[:last]).T @ (weights[:, None] * phi[:last]))
        np.testing.assert_allclose(found.theta_cov[k], found.model.noise_variance * spread, rtol=1e-8, atol=1e-12)


def test_collinear_regressors_cost_no_more_digits_than_least_squares():
    # u1 and u2 differ in the sixth digit: condition 1e6. Two QR-like solutions may differ by some 1e6 * 1e-16 in the
    # ill-determined direction, relative to its parameter; normal equations would be wrong in the fourth digit.
    rng = np.random.default_rng(2)
    u = rng.normal(size=(2, 500))
    u[1] = u[0] + 1e-6 * u[1]
    y = np.concatenate([[0.0], (u[0] - u[1] * 2)[:-1]]) + 1e-3 * rng.normal(size=500)
    found = Rls(terms=("u1(k-1)", "u2(k-1)"), forgetting=1.0).fit(Recording.from_arrays(u, y, 0.1))
    theta, *_ = np.linalg.lstsq(u[:, :-1].T, y[1:])
    np.testing.assert_allclose(found.model_.theta, theta, rtol=1e-8)


def test_it_waits_until_the_regressors_are_independent():
    recording, _ = drifting(3, 300)
    u = recording.inputs[0].copy()
    u[:100] = 0.0
    rng = np.random.default_rng(3)
    _, y = drive(rng, np.repeat([[0.5], [1.0], [-0.4]], 300, axis=1))
    y[:100] = 0.0
    found = Rls(terms=TERMS).fit(Recording.from_arrays(u, y, 0.1)).trajectory_
    assert 10.0 <= found.timepts[0] < 25.0
    with pytest.raises(ModelError, match="depend on each other"):
        Rls(terms=("u(k-1)", "y(k-1)", "u(k-1)^3")).fit(
            Recording.from_arrays(np.sign(rng.normal(size=200)), rng.normal(size=200), 0.1)
        )


# ---- smoother


def test_without_drift_it_is_bayesian_least_squares():
    recording, _ = drifting(5)
    phi, y = regressors(recording)
    noise = 0.02
    smoother = ThetaSmoother(terms=TERMS, noise_variance=noise, drift_variance=(0.0, 0.0, 0.0)).fit(recording)
    # The prior is least squares with the covariance noise n 1e4 (phi'phi)^-1: the data have 1e4 n times its precision.
    theta, *_ = np.linalg.lstsq(phi, y)
    cov = noise * np.linalg.inv(phi.T @ phi) / (1 + 1e-4 / len(y))
    for trajectory in (smoother.trajectory_, smoother.filtered_):
        np.testing.assert_allclose(trajectory.theta[:, -1], theta, rtol=1e-10)
        np.testing.assert_allclose(trajectory.theta_cov[-1], cov, rtol=1e-8)
    np.testing.assert_allclose(smoother.trajectory_.theta, np.repeat(theta[:, None], len(y), axis=1), rtol=1e-9)
    np.testing.assert_allclose(smoother.trajectory_.theta_cov, np.repeat(cov[None], len(y), axis=0), rtol=1e-8)
    left = y - phi @ theta
    spread = noise * np.eye(len(y)) + phi @ (noise * 1e4 * len(y) * np.linalg.inv(phi.T @ phi)) @ phi.T
    expected = -0.5 * (np.linalg.slogdet(2 * np.pi * spread)[1] + left @ np.linalg.solve(spread, left))
    assert smoother.trajectory_.log_likelihood == pytest.approx(expected, rel=1e-8)


def test_bands_with_estimated_variances():
    # A strong walk and two weak ones. The likelihood often makes none of the weak ones; the posterior never does, and
    # its bands cover 95 %, of which 3 % are allowed to be missed. The scatter of the mean
    # over 40 records is 0.5 %.
    covered = {"likelihood": [], "posterior": []}
    for seed in range(40):
        recording, theta = drifting(5000 + seed, 600, (0.002, 0.02, 0.005))
        for variances, shares in covered.items():
            found = ThetaSmoother(terms=TERMS, variances=variances).fit(recording).trajectory_
            shares.append(np.mean(np.abs(found.theta - theta[:, 1:]) < 1.96 * found.std))
            assert variances == "likelihood" or np.all(found.drift_variance > 0)
    assert 0.92 < np.mean(covered["posterior"]) < 0.98
    assert np.mean(covered["likelihood"]) < np.mean(covered["posterior"])


def test_variances_of_largest_likelihood_recover_the_truth():
    # Where all variances are well inside, twice the gain of the log likelihood over the truth is chi-square with one
    # degree of freedom for each variance (here 1 + 2; the third parameter is left out), mean 3, variance 6: over 40
    # records within 3 ± 4 sqrt(6 / 40). The estimate of the noise scatters by sqrt(2 / n), a little more for the drift.
    std, noise = np.array([0.012, 0.06]), 0.1  # y(k-1) ends at a std of 0.24: all walks are stable
    gains, noises, drifts = [], [], []
    for seed in range(40):
        rng = np.random.default_rng(2000 + seed)
        theta = walk(rng, 400, (0.0, 1.0, 0.0), (*std, 0.0))
        recording = Recording.from_arrays(*drive(rng, theta, noise), 0.1)
        best = ThetaSmoother(terms=TERMS[:2]).fit(recording).trajectory_
        true = ThetaSmoother(terms=TERMS[:2], noise_variance=noise**2, drift_variance=std**2).fit(recording).trajectory_
        gains.append(2 * (best.log_likelihood - true.log_likelihood))
        noises.append(best.model.noise_variance)
        drifts.append(np.sqrt(best.drift_variance))
    assert min(gains) > -1e-3  # nothing is likelier than the most likely
    assert abs(np.mean(gains) - 3) < 4 * np.sqrt(6 / 40)
    assert np.mean(noises) == pytest.approx(noise**2, rel=0.05)
    np.testing.assert_allclose(np.mean(drifts, axis=0), std, rtol=0.2)


def test_common_drift_is_one_variance_in_contributions():
    recording, _ = drifting(7, 500, (0.01, 0.02, 0.02))
    common = ThetaSmoother(terms=TERMS, drift="common").fit(recording).trajectory_
    contributions = common.drift_variance * np.mean(regressors(recording)[0] ** 2, axis=0)
    np.testing.assert_allclose(contributions, contributions[0], rtol=1e-9)
    each = ThetaSmoother(terms=TERMS).fit(recording).trajectory_
    assert each.log_likelihood >= common.log_likelihood - 1e-6


def test_units_change_nothing_but_the_units():
    recording, _ = drifting(8, 300)
    plain = ThetaSmoother(terms=TERMS).fit(recording).trajectory_
    small = ThetaSmoother(terms=TERMS).fit(
        Recording.from_arrays(recording.inputs * 2.0**11, recording.outputs * 2.0**-13, 0.1, start=3.0)
    )
    factors = np.array([1.0, 2.0**-24, 2.0**-35])
    np.testing.assert_allclose(small.trajectory_.theta, plain.theta * factors[:, None], rtol=1e-12)
    np.testing.assert_allclose(small.trajectory_.theta_cov, plain.theta_cov * np.outer(factors, factors), rtol=1e-12)
    samples = plain.timepts.size
    expected = plain.log_likelihood + samples * 13 * np.log(2)  # density of an output in another unit
    assert small.trajectory_.log_likelihood == pytest.approx(expected, rel=1e-12)


def test_the_walk_goes_on_over_a_gap():
    # The variance of theta, given the first part only, grows by its drift in each interval of the gap.
    std = (0.0, 0.02, 0.0)
    recording, _ = drifting(9, 500, std)
    parts = (recording.section(0, 250), recording.section(400, 500))
    given = {"terms": TERMS, "noise_variance": 0.01, "drift_variance": np.square(std)}
    found = ThetaSmoother(**given).fit(Experiment(recordings=parts)).filtered_
    assert found.timepts.size == 249 + 99
    before, after = found.std[1, 248] ** 2, found.std[1, 249] ** 2
    # One more sample with rms 1/sqrt(3) of input and noise 0.1 is taken in after the gap of 152 intervals.
    predicted = found.theta_cov[248] + np.diag([0.0, 152 * 0.02**2, 0.0])
    row = regressors(parts[1])[0][0]
    spread = row @ predicted @ row + 0.01
    assert after == pytest.approx(predicted[1, 1] - (predicted[1] @ row) ** 2 / spread, rel=1e-9)
    assert after > before
    swapped = ThetaSmoother(**given).fit(list(parts[::-1])).filtered_
    np.testing.assert_array_equal(swapped.theta, found.theta)
    with pytest.raises(DataError, match="overlap"):
        ThetaSmoother(**given).fit([recording, recording])


def test_several_outputs_each_have_their_equation():
    rng = np.random.default_rng(10)
    u, e, y = rng.uniform(-1, 1, 400), 0.05 * rng.normal(size=(2, 400)), np.zeros((2, 400))
    for k in range(1, 400):
        y[0, k] = 0.5 * y[0, k - 1] + (1 + k / 400) * u[k - 1] + e[0, k]
        y[1, k] = 0.8 * y[0, k - 1] + e[1, k]
    model = NarxModel.from_terms({"y1": {"y1(k-1)": 0.5, "u(k-1)": 1.0}, "y2": {"y1(k-1)": 0.8}}, sample_time=0.1)
    recording = Recording.from_arrays(u, y, 0.1)
    written = {"y1": ["y1(k-1)", "u(k-1)"], "y2": ["y1(k-1)"]}
    for estimator in (Rls(terms=model, forgetting=0.97), ThetaSmoother(terms=model), ThetaSmoother(terms=written)):
        found = estimator.fit(recording).trajectory_
        assert found.terms == model.terms and found.model.equations == (0, 0, 1)
        assert found.at(35.0).theta[1] == pytest.approx(1 + 350 / 400, abs=0.1)
        assert found.at(35.0).theta[2] == pytest.approx(0.8, abs=0.05)
        assert np.shape(found.model.noise_variance) == (2,)
        assert not found.theta_cov[:, :2, 2].any()
        assert "u(k-1)" in repr(estimator)


def test_an_interrupt_keeps_the_best_so_far():
    recording, _ = drifting(11, 200)
    stop = StopAt(7)
    smoother = ThetaSmoother(terms=TERMS).fit(recording, progress=stop)
    assert smoother.status_ is FitStatus.INTERRUPTED and smoother.trajectory_.theta.shape == (3, 199)
    assert all(0 < share < 1 for share, _ in stop.told) and "log likelihood" in stop.told[0][1]
    whole = ThetaSmoother(terms=TERMS).fit(recording)
    assert whole.trajectory_.log_likelihood >= smoother.trajectory_.log_likelihood


# ---- trajectory


def test_a_trajectory_runs_with_the_parameters_of_each_time():
    recording, theta = drifting(12, 120)
    known = ThetaTrajectory(
        model=NarxModel.from_terms(dict.fromkeys(TERMS, 1.0), sample_time=0.1),
        timepts=recording.timepts,
        theta=theta,
        theta_cov=np.zeros((120, 3, 3)),
        drift_variance=np.zeros(3),
    )
    u, y = recording.inputs[0], recording.outputs[0]
    step, free = known.predict(recording).outputs[0], known.simulate(recording).outputs[0]
    run = [y[0]]
    for k in range(1, 120):
        assert step[k] == pytest.approx(theta[:, k] @ [y[k - 1], u[k - 1], u[k - 1] ** 2], rel=1e-12, abs=1e-14)
        run.append(theta[:, k] @ [run[-1], u[k - 1], u[k - 1] ** 2])
    np.testing.assert_allclose(free, run, rtol=1e-10, atol=1e-12)
    part = recording.section(50, 90)
    np.testing.assert_allclose(known.predict(part).outputs[0, 1:], step[51:90], rtol=1e-12)
    np.testing.assert_array_equal(known.at(recording.timepts[70] + 0.04).theta, theta[:, 70])
    np.testing.assert_array_equal(known.at(recording.timepts[70] - 0.04).theta, theta[:, 70])
    for time in (2.9, 15.0):
        with pytest.raises(ModelError, match=r"known from 3 s to 14\.9 s"):
            known.at(time)
    for time, said in ((np.nan, "asked for nan s"), ("a", "time must be real numbers"), ([1.0, 2.0], "one number")):
        with pytest.raises(ModelError, match=said):
            known.at(time)
    with pytest.raises(ModelError, match="known from"):
        known.thinned(1).simulate(Recording.from_arrays(u, y, 0.1, start=3.5))


def test_a_thinned_trajectory_ends_where_the_whole_one_does():
    recording, _ = drifting(13, 90)
    found = ThetaSmoother(terms=TERMS).fit(recording).trajectory_
    thin = found.thinned(10)
    assert thin.timepts[-1] == found.timepts[-1] and thin.timepts.size == 9
    np.testing.assert_array_equal(thin.theta, found.theta[:, 8::10])


def test_plot_and_dataset():
    recording, _ = drifting(14, 90)
    found = ThetaSmoother(terms=TERMS).fit(recording).trajectory_
    axes = found.plot()
    for ax, term, theta in zip(axes, TERMS, found.theta, strict=True):
        assert ax.get_title(loc="left") == term
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), theta)
    assert axes[-1].get_xlabel() == "time (s)"
    dataset = found.to_xarray()
    assert dataset.theta.sel(term="u(k-1)").shape == (89,) and dataset.time.attrs["units"] == "s"


def test_the_contract_and_what_cannot_be():
    recording, _ = drifting(15, 90)
    for estimator in (Rls(terms=TERMS), ThetaSmoother(terms=TERMS, variances="posterior")):
        check_identifier(estimator)
    rls = Rls(terms=TERMS, forgetting=0.9)
    assert rls.get_params() == {"terms": TERMS, "forgetting": 0.9}
    assert "forgetting=0.9" in repr(Rls(terms=NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=0.1), forgetting=0.9))
    assert "y(k-1)" in rls.fit(recording).model_.provenance["identifier"]
    for estimator, text in (
        (Rls(terms=TERMS, forgetting=1.1), "forgetting = 1.1"),
        (Rls(terms=("e(k-1)",)), "without noise"),
        (Rls(terms=()), "give a list of terms"),
        (Rls(terms=("y(k-1",)), "cannot read the term"),
        (ThetaSmoother(terms=TERMS, drift="al"), "known are each and common"),
        (ThetaSmoother(terms=TERMS, variances="likelyhood"), 'did you mean "likelihood"'),
        (ThetaSmoother(terms=TERMS, noise_variance=1.0), "together"),
        (ThetaSmoother(terms=TERMS, noise_variance=1.0, drift_variance=[1.0]), "3 terms need as many"),
        (ThetaSmoother(terms=("u(k-1)", "y(k-1)"), noise_variance=0.0, drift_variance=[0.0, 0.0]), "must be positive"),
    ):
        with pytest.raises(ModelError, match=text):
            estimator.fit(recording)
    twice = Recording.from_arrays([recording.inputs[0]] * 2, recording.outputs, 0.1)
    with pytest.raises(ModelError, match="depend on each other"):
        ThetaSmoother(terms=("u1(k-1)", "u2(k-1)")).fit(twice)
