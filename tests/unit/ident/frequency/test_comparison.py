"""Comparison of models and of records: against closed forms, classical tests, repeats and known changes."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from made_bands import mean
from scipy import stats
from scipy.optimize import minimize

from deatwin.ident.frequency.comparison.bands import Scatter, band_frequencies, band_means, equality, holm, no_drift
from deatwin.ident.frequency.comparison.compare import Agreement, compare
from deatwin.ident.frequency.comparison.records import compare_records, contrast, share_of, spread_of_means
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.robust import Cosines
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

TERMS = ["y(k-1)", "u(k-1)", "u(k-1)^2"]
TRUE = (0.6, 0.4, 0.1)
BANDS = ((0.0, 0.1), (0.1, 0.25), (0.25, 0.5))


def recorded(seed, n=400, gain=1.0, theta=TRUE, noise=0.1):
    """The system of TRUE, driven by white noise, with white equation error; what the input does times ``gain``."""
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal(n), noise * rng.standard_normal(n)
    drive = np.broadcast_to(gain, n) * (theta[1] * u + theta[2] * u**2)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = theta[0] * y[k - 1] + drive[k - 1] + e[k]
    return Recording.from_arrays(u, y, 1.0)


def model_of(theta, deviations=(0.01, 0.01, 0.01)):
    return NarxModel.from_terms(
        dict(zip(TERMS, theta, strict=True)), sample_time=1.0, theta_cov=np.diag(np.square(deviations))
    )


# ---- the test of two means


def test_with_one_direction_it_is_welchs_t_test():
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal(9), 0.3 + 3 * rng.standard_normal(25)
    flat = np.diag([1.0, 0.0])
    found = equality(
        [a.mean() - b.mean(), 0.0],
        [Scatter(flat * a.var(ddof=1) / a.size, 8.0), Scatter(flat * b.var(ddof=1) / b.size, 24.0)],
    )
    welch = stats.ttest_ind(a, b, equal_var=False)
    assert found.p_value == pytest.approx(welch.pvalue, rel=1e-10)
    assert found.statistic == pytest.approx(welch.statistic**2, rel=1e-10)


def test_with_one_sample_it_is_hotellings_test():
    rng = np.random.default_rng(2)
    x = rng.standard_normal((20, 2)) + 0.3
    found = equality(x.mean(axis=0), [Scatter(np.cov(x.T) / 20, 19.0)])
    squared = 20 * x.mean(axis=0) @ np.linalg.solve(np.cov(x.T), x.mean(axis=0))
    assert found.p_value == pytest.approx(stats.f.sf(squared * 18 / (19 * 2), 2, 18), rel=1e-10)
    normal = equality(x.mean(axis=0), [Scatter(np.cov(x.T) / 20, np.inf)])
    assert normal.p_value == pytest.approx(stats.chi2.sf(squared, 2), rel=1e-10)


def test_of_unequal_scatters_it_keeps_its_level():
    """1500 trials at 5 %: the share scatters by 0.6 %, and the approximation is good to about half a per cent."""
    rng = np.random.default_rng(3)
    low, high = np.array([[1.0, 0.6], [0.6, 1.0]]), np.diag([9.0, 0.5])
    rejected = 0
    for _ in range(1500):
        a = rng.multivariate_normal([0, 0], low, 12)
        b = rng.multivariate_normal([0, 0], high, 20)
        scatters = [Scatter(np.cov(a.T) / 12, 11.0), Scatter(np.cov(b.T) / 20, 19.0)]
        rejected += equality(a.mean(axis=0) - b.mean(axis=0), scatters).p_value < 0.05
    assert rejected / 1500 == pytest.approx(0.05, abs=0.02)


def test_a_margin_counts_from_its_nearest_point():
    scale, apart, margin = np.array([[2.0, 0.9], [0.9, 1.0]]), np.array([3.0, -2.0]), 1.5
    inverse = np.linalg.inv(scale)
    nearest = minimize(
        lambda m: (apart - m) @ inverse @ (apart - m),
        [0.0, 0.0],
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda m: margin**2 - m @ m},
    )
    found = equality(apart, [Scatter(scale, np.inf)], margin)
    assert found.statistic == pytest.approx(nearest.fun, rel=1e-6)
    assert equality(apart, [Scatter(scale, np.inf)], 4.0).p_value == 1.0  # within the margin


@pytest.mark.parametrize("scatter", [0.1, 0.001])
def test_a_difference_as_large_as_the_margin_is_rarely_beyond_it(scatter):
    """On the edge of a nearly flat margin a test at 5 % rejects if a normal number exceeds sqrt(5.99): 0.7 %, so that
    1000 trials give 7 with a deviation of 2.7."""
    rng, beyond = np.random.default_rng(11), 0
    for angle in rng.uniform(0, 2 * np.pi, 1000):
        apart = np.array([np.cos(angle), np.sin(angle)]) + scatter * rng.standard_normal(2)
        beyond += equality(apart, [Scatter(scatter**2 * np.eye(2), np.inf)], 1.0).p_value < 0.05
    assert beyond <= 20


def test_of_several_differences_the_most_alike_counts():
    scale = np.eye(2)
    found = equality([[3.0, 0.0], [1.0, 0.0], [0.0, 2.0]], [Scatter(scale, np.inf)])
    assert found.p_value == pytest.approx(stats.chi2.sf(1.0, 2), rel=1e-12)


def test_holms_correction():
    # worked by hand: 4 * 0.005, then 3 * 0.01, then 2 * 0.03, then the largest before or 0.04
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.5, 0.9]), [1.0, 1.0])


@pytest.mark.parametrize(("shape", "count"), [(lambda t: 2.0 * t, 1), (lambda t: np.cos(3 * np.pi * t), 3)])
def test_a_drift_of_one_series_is_the_f_test_of_a_regression(shape, count):
    times = (np.arange(40) + 0.5) / 40
    series = np.random.default_rng(4).standard_normal(40) + shape(times)
    design = np.column_stack([np.ones(40), *(np.cos(j * np.pi * times) for j in (1, 2, 3))])

    def left(columns):
        return series - design[:, columns] @ np.linalg.lstsq(design[:, columns], series, rcond=None)[0]

    within, about = (np.sum(left(columns) ** 2) for columns in ([0, 1, 2, 3], [0]))
    by_all = stats.f.sf((about - within) / 3 / (within / 36), 3, 36)
    by_two = stats.f.sf((about - np.sum(left([0, 1, 2]) ** 2)) / 2 / (within / 36), 2, 36)
    by_one = stats.f.sf((about - np.sum(left([0, 1]) ** 2)) / (within / 36), 1, 36)
    found = no_drift(Cosines.of(series[:, None], 3))
    assert found.p_value == pytest.approx(3 * min(by_one, by_two, by_all), rel=1e-9)
    assert found.dof == (count, 36)


# ---- means over bands


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_frequencies_of_a_band_add_up_to_it(order):
    omega = band_frequencies(order, (0.2, 0.4), (0.05, 0.3)).reshape(-1, order) / (2 * np.pi)
    assert len(omega) >= 4
    assert np.all((omega.sum(axis=1) >= 0.2) & (omega.sum(axis=1) <= 0.4))
    assert np.all((np.abs(omega) >= 0.05) & (np.abs(omega) <= 0.3))


def test_what_the_input_cannot_reach_is_left_out():
    found = band_means(model_of(TRUE), (1, 2), ((0.0, 0.2), (0.3, 0.4)), input_band=(0.0, 0.2))
    assert [(m.order, m.from_Hz) for m in found] == [(1, 0.0), (2, 0.0), (2, 0.3)]
    with pytest.raises(ModelError, match="no order reaches a band"):
        band_means(model_of(TRUE), (1,), ((0.3, 0.4),), input_band=(0.0, 0.2))


def test_means_and_scatter_of_a_static_polynomial_are_its_coefficients():
    model = NarxModel.from_terms(
        {"u(k)": 2.0, "u(k)^2": -0.5}, sample_time=1.0, theta_cov=[[0.04, 0.01], [0.01, 0.09]], theta_dof=10.0
    )
    first, second = band_means(model, (1, 2), ((0.1, 0.2),))
    np.testing.assert_allclose(first.value, [2.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(second.value, [-0.5, 0.0], atol=1e-14)
    # squared scale of a t law: (dof - 2) / dof of the variance
    np.testing.assert_allclose(first.scatter.scale, [[0.032, 0.0], [0.0, 0.0]], atol=1e-14)
    np.testing.assert_allclose(second.scatter.scale, [[0.072, 0.0], [0.0, 0.0]], atol=1e-14)
    assert second.gain == pytest.approx(0.5)


# ---- two models


def test_each_coefficient_shows_in_the_orders_that_it_makes():
    """Changes of five deviations; H_1 = b z / (1 - a z) and H_2 = c z1 z2 / (1 - a z1 z2) about u = 0."""
    linear = compare(model_of(TRUE), model_of((0.6, 0.5, 0.1)), (1, 2), BANDS)
    assert {d.order for d in linear.significant} == {1}
    assert len(linear.significant) == 3
    z = np.exp(2j * np.pi * np.linspace(0, 0.1, 1001))
    shape = 1 / (z - 0.6)
    gain = np.sqrt(np.mean(np.abs(shape) ** 2) * (0.4**2 + 0.5**2) / 2)
    # the mean of eight lines is the midpoint rule for that over the band
    assert linear.differences[0].size == pytest.approx(0.1 * abs(shape.mean()) / gain, rel=2e-3)
    quadratic = compare(model_of(TRUE), model_of((0.6, 0.4, 0.2)), (1, 2), BANDS)
    assert {d.order for d in quadratic.significant} == {2}
    both = compare(model_of(TRUE), model_of((0.7, 0.4, 0.1)), (1, 2), BANDS)
    assert {d.order for d in both.significant} == {1, 2}


def test_a_band_finds_what_is_only_there():
    """A second-order resonance moves: its static gain is kept, the response beside it changes."""

    def resonant(frequency):
        pole = 0.95 * np.exp(2j * np.pi * frequency)
        a1, a2 = 2 * pole.real, -(abs(pole) ** 2)
        return NarxModel.from_terms(
            {"y(k-1)": a1, "y(k-2)": a2, "u(k-1)": 1 - a1 - a2}, sample_time=1.0, theta_cov=1e-6 * np.eye(3)
        )

    found = compare(resonant(0.15), resonant(0.151), (1,), ((0.0, 0.01), (0.12, 0.15)), least=0.02)
    assert [d.differs for d in found.differences] == [False, True]


def test_the_table_corrects_for_its_number_of_tests():
    # b differs by z = 0.038 / (0.01 sqrt 2): H_1 of two parameters has p = exp(-z^2 / 2) in every band
    changed = model_of((0.6, 0.438, 0.1))
    one = compare(model_of(TRUE), changed, (1,), BANDS[:1], operating_input=0.0)
    six = compare(model_of(TRUE), changed, (1, 2), BANDS)
    p = np.exp(-((0.038 / 0.01) ** 2) / 4)
    np.testing.assert_allclose([d.p_value for d in six.differences], [p, p, p, 1, 1, 1], rtol=1e-6)
    np.testing.assert_allclose([d.adjusted for d in six.differences], [6 * p, 6 * p, 6 * p, 1, 1, 1], rtol=1e-6)
    assert not one.ok
    assert six.ok
    assert six.sentences == ("None of 6 tests finds a difference at the level of 0.05.",)


def test_differences_that_do_not_matter_may_be_left_out():
    small, change = (1e-5, 1e-5, 1e-5), (0.6, 0.404, 0.1)
    assert not compare(model_of(TRUE, small), model_of(change, small), (1,), BANDS).ok
    assert compare(model_of(TRUE, small), model_of(change, small), (1,), BANDS, least=0.02).ok


def test_models_that_cannot_be_compared_are_refused():
    exact = model_of(TRUE, (0.0, 0.0, 0.0))
    with pytest.raises(ModelError, match="no covariance"):
        compare(exact, exact, (1,), BANDS)
    other = NarxModel.from_terms({"u(k-1)": 1.0}, sample_time=1.0, output_units=("m",))
    with pytest.raises(ModelError, match="output units"):
        compare(model_of(TRUE), other, (1,), BANDS)
    with pytest.raises(ModelError, match="a band goes from 0 Hz"):
        compare(model_of(TRUE), model_of(TRUE), (1,), ((0.2, 0.1),))
    for wrong in (None, [1.0, 2.0], [("a", "b")], [(0.0, np.inf)], 3):
        with pytest.raises(ModelError, match="band"):
            compare(model_of(TRUE), model_of(TRUE), (1,), wrong)
    for wrong in (1, (), (1.0,), (6,), "a", None):
        with pytest.raises(ModelError, match="order"):
            compare(model_of(TRUE), model_of(TRUE), wrong, BANDS)
    with pytest.raises(ModelError, match="input_band"):
        compare(model_of(TRUE), model_of(TRUE), (1,), BANDS, input_band=0.5)
    with pytest.raises(ModelError, match="at least one"):
        compare(model_of(TRUE), model_of(TRUE), (1,), ())
    with pytest.raises(ModelError, match="level"):
        compare(model_of(TRUE), model_of(TRUE), (1,), BANDS, level=5.0)
    for wrong in (("a",), ("a", "a"), "ab", (1, 2), None):
        with pytest.raises(ModelError, match="give two different names"):
            compare(model_of(TRUE), model_of(TRUE), (1,), BANDS, names=wrong)


# ---- records


@pytest.fixture(scope="module")
def several():
    """Three that are alike but for the third's drift, one with 1.8 times the gain."""
    n = 1200
    return compare_records(
        {
            "a": recorded(1, n, noise=0.05),
            "b": recorded(2, n, noise=0.05),
            "drifting": recorded(3, n, gain=np.linspace(0.9, 1.3, n), noise=0.05),
            "other": recorded(4, n, gain=1.8, noise=0.05),
        },
        TERMS,
        (1, 2),
        BANDS,
        operating_input=0.0,
    )


def test_drift_is_told_from_difference(several):
    agreement = {
        pair: {d.agreement for d in several.differences if (d.first, d.second) == pair} for pair in several.pairs
    }
    assert agreement["a", "b"] == {Agreement.ALIKE}
    assert agreement["a", "drifting"] == {Agreement.DRIFT}
    assert agreement["b", "drifting"] == {Agreement.DRIFT}
    assert agreement["a", "other"] == {Agreement.DIFFERENT}
    # from 0.9 to 1.3 of the gain never comes near 1.8
    assert agreement["drifting", "other"] == {Agreement.DIFFERENT}
    assert {d.name for d in several.drifts if d.drifts} == {"drifting"}
    assert several.share == pytest.approx(5 / 6)


def test_the_size_of_a_drift_is_how_far_it_goes(several):
    sizes = [d.size for d in several.drifts if d.name == "drifting" and d.order == 1]
    # 0.4 of a mean of 1.1; blocks scatter, so that the largest distance is rather more than less
    assert all(0.3 <= size <= 0.6 for size in sizes)


def test_a_table_can_be_read_drawn_and_exported(several):
    assert several.columns == tuple((order, *band) for order in (1, 2) for band in BANDS)
    assert [(d.first, d.second) for d in several.differences[:: len(several.columns)]] == list(several.pairs)
    sure = [d.p_value for d in several.significant]
    assert all(before <= after for before, after in pairwise(sure))
    assert any("which a drift within a record may explain" in text for text in several.sentences)
    data = several.to_xarray()
    assert data.sizes == {"pair": 6, "column": 6}
    assert data["agreement"].sel(column=0).values[0] == "ALIKE"
    axes = several.plot()
    texts = [t.get_text() for t in axes.texts]
    assert len(texts) == len(several.significant)
    assert sum(t.startswith("(") for t in texts) == sum(d.agreement is Agreement.DRIFT for d in several.differences)


def test_long_names_and_labels_fit_on_the_figure():
    records = {f"actuator {k} of the second batch": recorded(k, gain=1.0 + 0.1 * k) for k in range(3)}
    axes = compare_records(records, TERMS, (1, 2), BANDS).plot()
    axes.figure.canvas.draw()
    drawn, figure = axes.get_tightbbox(), axes.figure.bbox
    assert figure.x0 <= drawn.x0 and drawn.x1 <= figure.x1 and figure.y0 <= drawn.y0 and drawn.y1 <= figure.y1
    columns = [label.get_window_extent() for label in axes.get_xticklabels()]
    assert all(left.x1 < right.x0 for left, right in pairwise(columns))


def test_one_record_cannot_be_compared():
    for wrong in ({"a": recorded(1)}, [recorded(1), recorded(2)], None):
        with pytest.raises(ModelError, match="at least two"):
            compare_records(wrong, TERMS, (1,), BANDS)


def test_a_measured_difference_beside_the_true_one() -> None:
    # The true one is 0.3j; the measured one has 0.36 of it along, and 0.02 across: 0.06 beside it of 0.0632 in all.
    true = mean(1.0 + 0.3j), mean(1.0)
    apart = contrast((mean(1.02 + 0.36j, 5e-4), mean(1.0, 5e-4)), true)
    assert (apart.true, apart.measured) == pytest.approx((0.15, 0.18))
    assert apart.error == pytest.approx(np.sqrt(1e-3) / 2)
    # The squared distance is 0.004 / 0.001 = 4 < 5.99; with half the variance it is 8.
    assert apart.inside
    assert not contrast((mean(1.02 + 0.36j, 2.5e-4), mean(1.0, 2.5e-4)), true).inside


def test_agreements_are_counted_by_column() -> None:
    kinds = ("DIFFERENT", "ALIKE", "DRIFT", "DIFFERENT", "DIFFERENT", "ALIKE")
    table = SimpleNamespace(
        differences=[SimpleNamespace(agreement=Agreement[kind]) for kind in kinds],
        pairs=("ab", "ac", "bc"),
        columns=(1, 2),
    )
    shares = share_of(table, Agreement.DIFFERENT)  # type: ignore[arg-type]
    np.testing.assert_allclose(shares, [2 / 3, 1 / 3])


def test_the_spread_of_a_group_leaves_out_the_scatter_of_the_estimates() -> None:
    # Each part has the variance 0.04/3 about its mean; each estimate scatters by 0.004 in both parts.
    group = [(mean(value, 0.004),) for value in (2.0, 2.2, 2.0 + 0.2j, 2.2 + 0.2j)]
    gain = np.sqrt(np.mean([each.gain**2 for (each,) in group]))
    np.testing.assert_allclose(spread_of_means(group), np.sqrt(0.08 / 3 - 2 * 0.004) / gain)
    assert spread_of_means([(mean(value, 1.0),) for value in (2.0, 2.001)]) == [0.0]
