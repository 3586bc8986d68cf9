"""Sections by stationarity: the laws of the tests, their level, and planted changes."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kendalltau

from deatwin.ident.narx.preprocess import SectionStatus, choose_sections
from deatwin.ident.narx.preprocess.sections import SegmentMeans, correlation_samples, cut, trend_p_value
from deatwin.plant.recording import Recording


def coloured(rng, n, pole):
    """First-order noise of unit variance; its correlation time is (1 + pole)/(1 - pole) samples."""
    return np.sqrt(1 - pole**2) * lfilter([1.0], [1.0, -pole], rng.normal(size=n + 300))[300:]


def record(rng, n=6000, pole=0.8, change=lambda y, t: y):
    y = change(coloured(rng, n, pole), np.arange(n) / n)
    return Recording.from_arrays(coloured(rng, n, pole), y, 0.02, start=10.0)


def as_means(values):
    return SegmentMeans(np.asarray(values, dtype=float), np.ones(len(values)))


def test_reverse_arrangements_are_exact():
    # the same question as that of Kendall's tau against time, whose exact law scipy has
    values = np.random.default_rng(0).normal(size=(20, 20)) + 0.1 * np.arange(20)
    for row in values:
        exact = kendalltau(np.arange(20), row, method="exact").pvalue
        assert trend_p_value(as_means(row)) == pytest.approx(exact, rel=1e-9)


def test_correlation_time_of_first_order_noise():
    # (1 + 0.8)/(1 - 0.8) = 9; the mean that is taken from each segment of 300 lowers it by about 9/300 of itself, the
    # stop at the first zero adds noise: 15 %
    rng = np.random.default_rng(2)
    found = np.mean([correlation_samples(cut(coloured(rng, 6000, 0.8), 20)) for _ in range(20)])
    assert found == pytest.approx(9.0, rel=0.15)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_stationary_records_fail_as_seldom_as_said(pole):
    # segments of 300 samples and correlation times of 1 and 19: at least fifteen of them in a segment
    rng = np.random.default_rng(3)
    runs = 150
    failed = 0
    for _ in range(runs):
        tests = choose_sections(record(rng, pole=pole)).tests[0]
        assert len(tests) == 2 * 3 * 3
        failed += len(tests) * min(test.p_value for test in tests) < 0.05
    assert 0 < failed / runs < 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)


CHANGES = {
    "a step of one deviation": (lambda y, t: y + (t > 0.7), 0.7),
    "twice the deviation": (lambda y, t: y * np.where(t > 0.7, 2.0, 1.0), 0.7),
    "noise": (lambda y, t: y + np.where(t > 0.6, 1.0, 0.0) * np.random.default_rng(9).normal(size=y.size), 0.6),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_found_and_left_out(name):
    change, when = CHANGES[name]
    rng = np.random.default_rng(4)
    for _ in range(10):
        chosen = choose_sections(record(rng, change=change))
        assert chosen.status is SectionStatus.PART
        first, last = 10.0, 10.0 + 120.0 * when
        # all of what is used lies before the change, but for half a segment
        assert chosen.training.start >= first - 1e-9 and chosen.validation.end <= last + 3.0
        assert chosen.training.end <= chosen.validation.start + 1e-9
        assert chosen.training.duration + chosen.validation.duration > 0.8 * (last - first) - 12.0


def test_a_burst_in_the_middle_is_left_out():
    rng = np.random.default_rng(5)
    found = choose_sections(
        record(rng, n=24000, change=lambda y, t: y * np.where(abs(t - 0.5) < 0.05, 3.0, 1.0)), n_segments=40
    )
    assert found.status is SectionStatus.PART and len(found.stretches) == 2
    for section in (found.training, found.validation):
        assert section.end <= 10.0 + 0.45 * 480 + 6 or section.start >= 10.0 + 0.55 * 480 - 6


def test_a_stationary_record_is_divided():
    found = choose_sections(record(np.random.default_rng(6)), validation_share=0.25)
    assert found.status is SectionStatus.STATIONARY and found.segments_are_long
    assert (found.training.n_samples, found.validation.n_samples) == (4500, 1500)
    assert found.validation.start == pytest.approx(found.training.end)
    text = str(found)
    assert "training: 10 to 100 s (4500 samples)" in text and "passes as a whole" in text


def test_of_several_recordings_the_next_longest_validates():
    rng = np.random.default_rng(7)
    long, short = record(rng, n=6000), record(rng, n=4000)
    found = choose_sections([short, long])
    assert found.training.n_samples == 6000 and found.validation.n_samples == 4000


def test_a_trend_throughout_is_said():
    found = choose_sections(record(np.random.default_rng(8), change=lambda y, t: y + 20 * t))
    assert found.status is SectionStatus.NOTHING
    assert "a model with constant parameters may be wrong" in str(found) and "fails as a whole" in str(found)
    assert found.training.n_samples == found.validation.n_samples == 3000


def test_slow_signals_ask_for_longer_segments():
    found = choose_sections(record(np.random.default_rng(9), pole=0.98))
    assert not found.segments_are_long and "short compared with the correlation time" in str(found)


def test_plot_marks_both_sections():
    axes = choose_sections(record(np.random.default_rng(11))).plot()
    assert axes.get_xlabel() == "time (s)" and "(m)" in axes.get_ylabel()
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {"training", "validation"}
