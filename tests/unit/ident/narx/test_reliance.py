"""What held-out data say of a model: a bias of a known size is found with its interval, a true model has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.narx import NarxModel, Recording, Reliance, SvbNarx, ValidationStatus, assess_reliance
from deatwin.plant.errors import ModelError

MODEL = NarxModel.from_terms({"y(k-1)": 0.8, "u(k-1)": 0.2}, sample_time=0.01)


def recorded(seed: int, factor: float = 1.0, samples: int = 1500) -> Recording:
    """The model's own output, `factor` times as large, under measurement noise that is correlated over ten samples."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 10), 10)
    y = lfilter([0.0, 0.2], [1.0, -0.8], factor * u)
    noise = lfilter([0.05], [1.0, -0.9], rng.standard_normal(samples))
    return Recording.from_arrays(u, y + noise, 0.01)


def test_the_interval_of_the_gain_error_holds_the_truth() -> None:
    # 200 recordings, 95 % intervals: fewer than 180 by chance has a probability of 0.2 %
    held = 0
    for seed in range(200):
        found = assess_reliance(MODEL, [recorded(seed, factor=1.15, samples=600)])
        assert found is not None and found.gain_error is not None and found.gain_error_half_width is not None
        held += abs(found.gain_error - 0.15) <= found.gain_error_half_width
    assert held >= 180


def test_a_biased_model_says_so_with_its_size() -> None:
    found = assess_reliance(MODEL, [recorded(1, factor=1.5), recorded(2, factor=1.5)])
    assert found is not None and found.biased
    assert found.gain_error == pytest.approx(0.5, abs=0.1)
    assert any("biased" in text and "larger than the gain of the model's free run" in text for text in found.caveats)


def test_a_missing_input_term_is_a_caveat() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(2000)
    y = np.zeros(2000)
    for k in range(2, 2000):
        y[k] = 0.5 * y[k - 1] + 0.3 * u[k - 1] + 0.3 * u[k - 2]
    record = Recording.from_arrays(u, y + 0.01 * rng.standard_normal(2000), 1.0)
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 0.3}, sample_time=1.0)
    found = assess_reliance(model, [record])
    assert found is not None and found.status is ValidationStatus.STRUCTURE and "ue" in found.failed
    assert "residual test" in found.caveats[0] and "ue" in found.caveats[0]


@pytest.mark.parametrize(
    ("terms", "status", "said"),
    [
        ({"y(k-1)": 0.8, "u(k-1)": 0.2, "y(k-1)^3": 5.0}, ValidationStatus.DIVERGED, "diverged on held-out data"),
        ({"y(k-1)": 1.5, "u(k-1)": 0.2}, ValidationStatus.UNSTABLE, "the model is unstable"),
    ],
)
def test_a_free_run_that_runs_away_is_a_caveat(terms: dict[str, float], status: ValidationStatus, said: str) -> None:
    model = NarxModel.from_terms(terms, sample_time=0.01)
    found = assess_reliance(model, [recorded(3, factor=3.0)])
    assert found is not None and found.status is status and found.gain_error is None
    assert len(found.caveats) == 1 and said in found.caveats[0]


def test_it_travels_with_the_model_and_comes_back_as_it_was() -> None:
    found = assess_reliance(MODEL, [recorded(1, factor=1.5)])
    assert found is not None
    model = replace(MODEL, provenance=found.provenance)
    again = Reliance.of_provenance(model.provenance)
    assert again is not None and (again.status, again.failed) == (found.status, found.failed)
    assert again.caveats == found.caveats
    assert Reliance.of_provenance({}) is None


def test_a_model_that_nothing_tested_says_so_and_so_does_its_file() -> None:
    found = assess_reliance(MODEL, [recorded(1).section(0, 20)])
    assert found.status is None and "too short for the residual tests" in found.caveats[0]
    again = Reliance.of_provenance(found.provenance)
    assert again is not None and again.caveats == found.caveats


@pytest.mark.parametrize(("samples", "scarce"), [(20, True), (30, True), (100, True), (400, False)])
def test_the_choice_among_candidates_counts_as_parameters(samples: int, scarce: bool) -> None:
    """Degree 3 of five variables: 56 candidates, of which 4 chosen count for 4 * 2 ln(56/4) = 21 parameters."""
    kept = {"samples": str(samples), "candidates": "56"}
    terms = {"y(k-1)": 0.8, "u(k-1)": 0.2, "u(k-1)^3": 0.1, "y(k-1)u(k-1)^2": 0.1}
    model = NarxModel.from_terms(terms, sample_time=0.01, provenance=kept)
    found = assess_reliance(model, [recorded(1)])
    assert found.samples_per_parameter == pytest.approx(samples / (8.0 * np.log(14.0)))
    assert bool(found.scarcity) is scarce and (found.scarcity in found.caveats) is scarce
    again = Reliance.of_provenance(found.provenance)
    assert again is not None and bool(again.scarcity) is scarce


def test_a_model_that_explains_nothing_says_so() -> None:
    """An input and an output that have nothing to do with each other leave a white residual, which passes all tests."""
    u, y = np.random.default_rng(6).normal(size=(2, 600))
    record = Recording.from_arrays(u, y, 0.01)
    found = assess_reliance(NarxModel.from_terms({"u(k-1)": 0.08}, sample_time=0.01), [record])
    assert found.status is ValidationStatus.PASSED and found.fit is not None and found.fit <= 0.0
    assert "predicts nothing" in found.caveats[0]
    again = Reliance.of_provenance(found.provenance)
    assert again is not None and again.remarks == found.remarks


def test_a_fit_counts_its_candidates() -> None:
    u, noise = np.random.default_rng(4).normal(size=(2, 30))
    record = Recording.from_arrays(u, np.convolve(u, [0.0, 0.5, 0.3])[:30] + 0.1 * noise, 0.01)
    model = SvbNarx(degree=3, input_lags=2).fit(record).model_
    assert model.provenance["candidates"] == "35" and Reliance.of(model, None).scarcity  # (4 + 3)! / (4! 3!)


@pytest.mark.parametrize(
    "provenance",
    [
        {"residual_tests": "fine"},
        {"residual_tests": "passed", "free_run_gain_error": "0.1"},
        {"residual_tests": "passed", "free_run_gain_error": "nan +- 0.1"},
        {"residual_tests": "passed", "samples_per_parameter": "few"},
    ],
)
def test_what_cannot_be_read_is_named(provenance: dict[str, str]) -> None:
    with pytest.raises(ModelError, match="the model's provenance has"):
        Reliance.of_provenance(provenance)
