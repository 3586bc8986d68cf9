"""Refinement by the free-run error: finite differences, output error of a linear model, Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from slopes import differences
from stopping import StopAt

from deatwin.ident.narx import NarxModel, generate_terms
from deatwin.ident.narx.refine import Joined, extensions, prunings, refine, sensitivities
from deatwin.ident.narx.terms import Term
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

TRUE = {"y(k-1)": 1.1, "y(k-2)": -0.5, "u(k-1)": 0.6, "y(k-1)^3": -0.08, "y(k-2)u(k-1)": 0.1}
NOISE = 0.3


def plant(**changed: float) -> NarxModel:
    return NarxModel.from_terms({**TRUE, **changed}, sample_time=0.1)


def measured(rng: np.random.Generator, n: int = 600, noise: float = NOISE, model: NarxModel | None = None) -> Recording:
    u = rng.uniform(-1.5, 1.5, n)
    y = (model or plant()).simulate(Recording.from_arrays(u, np.zeros(n), 0.1)).outputs[0]
    return Recording.from_arrays(u, y + noise * rng.standard_normal(n), 0.1)


@pytest.mark.parametrize("lengths", [(200,), (5, 40, 9), (300, 7)])
def test_sensitivities_over_recordings_are_differences_of_their_runs(lengths: tuple[int, ...]) -> None:
    """One march over all recordings gives what runs of one after another give, also with the slope of a change."""
    terms = {**TRUE, "u(k)": 0.2, "y(k-1)y(k-3)u(k-4)": 0.02, "rbf(y(k-1)-y(k-3),0.1,0.5)": 0.2, "1": 0.1}
    model = NarxModel.from_terms(terms, sample_time=0.1)
    rng = np.random.default_rng(9)
    recordings = [measured(rng, n) for n in lengths]

    def runs(theta: np.ndarray) -> np.ndarray:
        found = [replace(model, theta=theta).simulate(recording) for recording in recordings]
        return np.concatenate([run.outputs[0, run.first :] for run in found])

    joined = Joined.of(model, recordings)
    expected = differences(runs, model.theta, 1e-5)
    sizes = np.abs(expected).max(axis=0)
    # Central differences: rounding 1e-16 / 1e-5, third derivatives times 1e-10.
    np.testing.assert_allclose(sensitivities(model, joined) / sizes, expected / sizes, atol=1e-7)
    np.testing.assert_array_equal(joined.run(model)[0][0, joined.samples(4)], runs(model.theta))


def test_a_divergence_is_told_on_the_clock_of_its_recording() -> None:
    """y(k) = y(k-1)^2 from 0.5 goes to zero; from 2 it passes 2^64 in the sixth step."""
    model = NarxModel.from_terms({"y(k-1)^2": 1.0}, sample_time=0.1)
    inputs = np.zeros(30)
    quiet, fatal = (
        Recording.from_arrays(inputs, np.full(30, first), 0.1, start=start)
        for first, start in ((0.5, 0.0), (2.0, 50.0))
    )
    run = model.simulate(fatal)
    with pytest.raises(ModelError, match=f"diverges at {run.failed_at_s:g} s"):
        refine(model, [quiet, fatal])
    assert 50.1 <= run.failed_at_s <= 50.7


def test_noise_on_the_readings_leaves_no_bias_and_the_intervals_cover() -> None:
    # Mean over 40 experiments: within 4 standard errors of the truth. Of 200 95 % intervals 190 cover on average; those
    # of one experiment are not independent, so the count spreads by at most sqrt(5) times the binomial 3.1.
    rng = np.random.default_rng(3)
    true = np.array(list(TRUE.values()))
    found = [refine(plant(), measured(rng)) for _ in range(40)]
    theta = np.array([model.theta for model in found])
    errors = np.array([np.sqrt(np.diag(model.theta_cov)) for model in found])
    assert np.all(np.abs(theta.mean(axis=0) - true) < 4 * theta.std(axis=0) / np.sqrt(40))
    assert np.sum(np.abs(theta - true) < 1.96 * errors) > 190 - 3 * np.sqrt(5) * 3.1
    np.testing.assert_allclose(errors.mean(axis=0), theta.std(axis=0), rtol=0.5)  # 40 draws tell it to 11 %


def test_several_recordings_count_together_and_the_one_step_error_is_kept() -> None:
    rng = np.random.default_rng(4)
    parts = [measured(rng, 300), measured(rng, 500)]
    start = plant(**{"y(k-1)": 1.0})
    found = refine(start, parts)

    def square(model: NarxModel) -> float:
        return sum(float((model.simulate(part).residuals ** 2).sum()) for part in parts)

    assert square(found) < min(square(start), square(plant()))
    one_step = np.concatenate([found.predict(part).residuals[0] for part in parts])
    assert found.noise_variance == pytest.approx(one_step @ one_step / (one_step.size - 5))
    assert found.provenance["refined"]


def test_the_best_so_far_survives_an_interrupt() -> None:
    recording = measured(np.random.default_rng(5))
    start = plant(**{"y(k-1)": 0.8, "u(k-1)": 0.3})
    stop = StopAt(4)
    found = refine(start, recording, progress=stop)
    assert len(stop.told) == 4
    assert plant().simulate(recording).rms_error * 0.9 < found.simulate(recording).rms_error
    assert found.simulate(recording).rms_error < start.simulate(recording).rms_error


def test_terms_are_added_until_the_structure_is_whole() -> None:
    # The two terms that are missing explain most of what is left; each first gain is hundreds of noise variances.
    recording = measured(np.random.default_rng(0), 2000, 0.05)
    start = NarxModel.from_terms({"y(k-1)": 1.0, "y(k-2)": -0.4, "u(k-1)": 0.6}, sample_time=0.1)
    path = list(extensions(start, (recording,), generate_terms(2, 2, 3), max_terms=5))
    assert [len(model.terms) for model in path] == [3, 4, 5]
    assert set(path[-1].terms) == {Term.parse(text) for text in TRUE}
    errors = [model.simulate(recording).rms_error for model in path]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == pytest.approx(0.05, rel=0.07)  # 4 / sqrt(2 n)


def test_false_terms_are_pruned() -> None:
    # Among ten candidates the five true ones stand hundreds of noise variances above the false.
    recording = measured(np.random.default_rng(0), 2000, 0.05)
    more = plant(**{"1": 0.0, "y(k-1)^2": 0.0, "u(k-2)": 0.0, "y(k-1)u(k-1)^2": 0.0, "y(k-2)^3": 0.0})
    path = list(prunings(more, (recording,), n_terms=5))
    assert [len(model.terms) for model in path] == [10, 9, 8, 7, 6, 5]
    assert set(path[-1].terms) == {Term.parse(text) for text in TRUE}
    errors = [model.simulate(recording).rms_error for model in path]
    assert errors == sorted(errors)


def test_terms_that_the_run_needs_stay() -> None:
    # y(k) = 1.4 y(k-1) - 0.8 y(k-2) + ...: without either lag's term the other alone may diverge, and is kept then.
    rng = np.random.default_rng(8)
    resonant = NarxModel.from_terms({"y(k-1)": 1.4, "y(k-2)": -0.8, "u(k-1)": 0.5}, sample_time=0.1)
    recording = measured(rng, 500, 0.01, resonant)
    assert all(model.simulate(recording).status.ok for model in prunings(resonant, (recording,), n_terms=1))


def test_a_term_that_follows_from_the_others_is_not_added() -> None:
    rng = np.random.default_rng(6)
    u = rng.choice([-1.0, 1.0], 300)  # its square is the constant
    recording = Recording.from_arrays(u, np.convolve(u, [0, 0.5, 0.2])[:300] + 0.3, 0.1)
    start = NarxModel.from_terms({"1": 0.2, "u(k-1)": 0.4}, sample_time=0.1)
    path = list(extensions(start, (recording,), [Term.parse(t) for t in ("u(k-1)^2", "u(k-2)")], max_terms=4))
    assert [str(term) for term in path[-1].terms] == ["1", "u(k-1)", "u(k-2)"]


@pytest.mark.parametrize("units", [(1e3, 1e-9), (1e-6, 1e9)])
def test_the_search_does_not_depend_on_units(units):
    rng = np.random.default_rng(8)
    u = rng.normal(size=500)
    plant = NarxModel.from_terms({"y(k-1)": 0.8, "u(k-1)": 0.5, "y(k-1)^2": -0.05}, sample_time=1.0)
    y = plant.simulate(Recording.from_arrays(u, 0 * u, 1.0)).outputs[0] + 0.1 * rng.normal(size=500)
    scales = np.array([1.0, units[1] / units[0], 1 / units[1]])
    near = NarxModel.from_terms({"y(k-1)": 0.7, "u(k-1)": 0.6, "y(k-1)^2": 0.01}, sample_time=1.0)
    found = refine(near, Recording.from_arrays(u, y, 1.0))
    scaled = refine(replace(near, theta=near.theta * scales), Recording.from_arrays(units[0] * u, units[1] * y, 1.0))
    np.testing.assert_allclose(scaled.theta / scales, found.theta, rtol=1e-5)
    candidates = generate_terms(2, 2, 2)
    for one, other in zip(
        extensions(found, (Recording.from_arrays(u, y, 1.0),), candidates, max_terms=6),
        extensions(scaled, (Recording.from_arrays(units[0] * u, units[1] * y, 1.0),), candidates, max_terms=6),
        strict=True,
    ):
        assert one.terms == other.terms
