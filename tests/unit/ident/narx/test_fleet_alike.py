"""One structure for several actuators of one law."""

import numpy as np
import pytest

from deatwin.ident.frequency import gfrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.fleet import alike
from deatwin.ident.narx.fleet.alike import OPERATING_INPUT, Fleet, choose_structure, fit, identify_alike
from deatwin.ident.narx.fleet.orders import DEGREES, LAGS, Orders, Plan
from deatwin.ident.narx.fleet.records import HELD_OUT, VARIANTS, Prepared
from deatwin.ident.narx.preprocess import choose_sampling, choose_sections, inspect_recordings
from deatwin.plant.fleet import fleet as fabricated
from deatwin.plant.recording import Recording

PERIOD, STEP, NOISE = 60, 0.12, 1e-6
"""Samples of the probing tones; sample time and noise, s and m, of the made-up actuators."""
GAINS = (1.0, 1.2, 1.5)
"""Of the made-up actuators."""


def made_up(gain: float, n: int = 3000, seed: int = 0) -> Recording:
    """y(k) = 0.55 y(k-1) + gain 1e-5 (u(k)^2 + u(k-1)^2 + u(k) u(k-1)) + e(k)."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.uniform(-2.5, 2.5, n + 4), np.ones(5) / 5, "valid") + OPERATING_INPUT
    e, y = NOISE * rng.standard_normal(n), np.zeros(n)
    y[0] = 3.8e-4 * gain
    for k in range(1, n):
        y[k] = 0.55 * y[k - 1] + 1e-5 * gain * (u[k] ** 2 + u[k - 1] ** 2 + u[k] * u[k - 1]) + e[k]
    return Recording.from_arrays(
        u, y, STEP, input_names=("command",), input_units=("V",), output_names=("displacement",), output_units=("m",)
    )


def plan_of() -> Plan:
    """Every sample, y(k-1), u(k) and u(k-1), second degree."""
    errors = np.ones((3, len(LAGS), len(DEGREES)))
    errors[:, LAGS.index((1, 1)), DEGREES.index(2)] = 0.1
    return Plan(orders=(Orders(factor=1, errors=errors),), chosen=0)


@pytest.fixture(scope="module")
def made() -> Fleet:
    """Three actuators of one law and three gains, recorded for 360 s."""
    prepared = []
    for number, gain in enumerate(GAINS):
        record = made_up(gain, seed=number)
        prepared.append(
            Prepared(
                actuator=fabricated(0)[number],
                recordings=dict.fromkeys(VARIANTS, record),
                sections=choose_sections(record, n_segments=20),
                sampling=choose_sampling(record, n_lags=50),
                findings=inspect_recordings(record),
            )
        )
    return identify_alike(prepared, plan_of())


def test_a_common_structure_holds_the_law(made: Fleet) -> None:
    truth = {"y(k-1)", "u(k)^2", "u(k-1)^2", "u(k)u(k-1)"}
    assert truth <= {str(term) for term in made.structure}
    assert all(one.model.terms == made.structure for one in made.actuators)
    # The free run's error is the noise through the loop, 1 / sqrt(1 - 0.55^2) = 1.2 of it at the mean command.
    for one, error in zip(made.actuators, made.errors, strict=True):
        assert error < 2 * NOISE / one.sections[0].outputs.std()
        assert one.sections[1].duration == pytest.approx(HELD_OUT, abs=STEP) and one.fit_percent > 95


def test_the_shortest_of_equally_good_structures(monkeypatch: pytest.MonkeyPatch) -> None:
    records = [made_up(gain, 600, seed) for seed, gain in enumerate(GAINS)]
    passed = [[("a", "b", "c")], [("a", "b"), ("a",)], [("a", "d")]]
    # Least: three terms. Two terms are worse by half a standard error of the paired differences, one by far.
    least, noise = np.array([0.1, 0.2, 0.3]), 0.01 * np.array([-1.0, 0.0, 1.0])
    errors = {("a", "b", "c"): least, ("a", "b"): least + noise + 0.003, ("a",): least + 0.1, ("a", "d"): least + 0.05}
    calls = iter(passed)
    monkeypatch.setattr(alike, "_passed", lambda *_: next(calls))
    rows = iter(range(3))
    monkeypatch.setattr(
        alike,
        "_free_run_errors",
        lambda structures, *_: [errors[s][i] for i in [next(rows)] for s in structures],
    )
    structure, chosen, tried = choose_structure(records, plan_of())
    assert structure == ("a", "b") and tried == 4  # type: ignore[comparison-overlap]
    np.testing.assert_allclose(chosen, errors["a", "b"])


def test_a_fit_has_a_covariance_that_the_scatter_bears_out() -> None:
    terms = ["y(k-1)", "u(k)^2", "u(k-1)^2", "u(k)u(k-1)"]
    models = [
        fit(NarxModel.from_terms(dict.fromkeys(terms, 1.0), sample_time=1.0).terms, made_up(1.0, 600, seed))
        for seed in range(40)
    ]
    gains = [gfrf(m, 1, [0.5], operating_input=OPERATING_INPUT) for m in models]
    scatter = np.std([float(g.gain[0]) for g in gains], ddof=1)
    stated = np.sqrt(np.mean([float(g.gain_deviation[0]) ** 2 for g in gains]))
    # The scatter of 40 is known to 11 %; the robust variance of 600 samples (28 cosines) has 19 % and is averaged.
    assert scatter / stated == pytest.approx(1.0, abs=0.35)
