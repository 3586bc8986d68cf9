"""The check of a model that is unusable, vague or wrong, or of one whose recording says too little."""

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.control import Check, LinearStatus, Verdict
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.excited import BAND_KEY
from deatwin.ident.narx.residual import DIVERGED, RMS_KEY, TIME_KEY
from deatwin.plant import DataError, ModelError, Recording

H, LAG, SLOPE = 0.02, 0.01, 2.0  # of the fixture `rig`
POLE = np.exp(-H / LAG)
FAST = 0.06
"""Closed-loop time, s: so short that the check is."""


@pytest.mark.parametrize(
    ("terms", "status"),
    [
        ({"y(k-1)": 1.2, "u(k)": 1.0}, LinearStatus.UNSTABLE),
        ({"y(k-1)": 1.0, "u(k)": 1.0}, None),  # it integrates
        ({"y(k-1)": 1.0, "y(k-1)^2": 1.0, "u(k)^2": 1.0, "1": 1.0}, LinearStatus.NO_EQUILIBRIUM),
        ({"y(k-1)": 0.5, "u(k)": 1.0, "u(k-1)": -1.0}, LinearStatus.NO_GAIN),
        ({"y(k-1)": 0.5, "u(k)^2": 1.0}, LinearStatus.NO_GAIN),  # at u = 0
        ({"y(k-1)": 0.5, "1": 1.0}, None),
    ],
)
def test_a_model_that_cannot_be_used_fails_with_its_reason_with_a_controller_too(
    checked, document_of, trained, rig, fast, terms, status, tmp_path
):
    model = NarxModel.from_terms(terms, sample_time=H, operating=trained)
    for details in ({}, {"controller": fast}):
        try:
            found = checked(model, rig, **details)
        except ModelError as error:  # no input at all is one clear error
            assert "input" in str(error)
            continue
        assert found.verdict is Verdict.FAIL
        assert status is None or found.operating.status is status
        assert found.operating.status.value in found.reason
        assert found.margins is found.steps is None
        document_of(found, tmp_path)
        assert Check.load(tmp_path / "check.json").operating.status is found.operating.status


def test_a_band_that_is_not_known_is_at_most_marginal_and_no_prediction_is_judged(
    checked, exact, subjects, document_of, rig, fast, passed, tmp_path
):
    found = checked(exact(provenance={}), rig, controller=fast)
    assert (found.verdict, found.worst_case.subject) == (Verdict.MARGINAL, "excitation")
    assert "give the recording" in found.reason
    assert not subjects(found) & {"model in closed loop", "prediction", "width of the prediction"}
    assert found.predicted is found.excited_band_Hz is None
    document = document_of(found, tmp_path)
    assert document["predicted"] is document["excited_band_Hz"] is None
    # Without a residual the model predicts the sine by its linear part, without noise of the sensor in the loop.
    assert found.sine_predicted == pytest.approx(passed.sine_predicted, rel=0.05)


@pytest.mark.parametrize("written", ["wide", "nan", "inf", "-1.0", "0"])
def test_a_band_that_is_none_is_refused(checked, exact, rig, fast, written):
    with pytest.raises(ModelError, match=r"must be a (positive )?number"):
        checked(exact(provenance={BAND_KEY: written}), rig, controller=fast)


def read_by_the_rig(command: np.ndarray) -> np.ndarray:
    return lfilter([SLOPE * (1 - POLE)], [1.0, -POLE], command)


def test_a_recording_tells_band_and_residual(checked, exact, rig, fast):
    rng = np.random.default_rng(4)
    command = np.repeat(rng.uniform(-1.0, 1.0, 500), 4)
    sound = Recording.from_arrays(command, read_by_the_rig(command) + 1e-3 * rng.standard_normal(2000), H)
    found = checked(exact(provenance={}), rig, controller=fast, recording=sound)
    assert found.predicted is not None
    assert found.excited_band_Hz > found.margins.crossover_Hz
    with pytest.raises(DataError, match="constant"):
        checked(exact(), rig, controller=fast, recording=Recording.from_arrays(np.zeros(90), np.zeros(90), H))


@pytest.fixture
def divergent(trained, known):
    """p y + 8 y³ grows without end beyond |y| = sqrt((1 - p)/8) = 0.33."""
    terms = {"y(k-1)": POLE, "y(k-1)^3": 8.0, "u(k)": SLOPE * (1 - POLE)}
    return NarxModel.from_terms(terms, sample_time=H, operating=trained, provenance=known)


def test_a_model_whose_free_run_diverges_on_the_recording_fails_with_the_reason(
    checked, document_of, divergent, rig, tmp_path
):
    """A step to 1 V takes the linear part to 2."""
    command = np.repeat([0.0, 1.0, 0.0, 1.0], 50)
    steps = Recording.from_arrays(command, SLOPE * command, H)
    found = checked(divergent, rig, recording=steps)
    assert (found.verdict, found.worst_case.subject) == (Verdict.FAIL, "model")
    assert "the model's free run fails on the recording: the free run diverged" in found.reason
    assert found.controller is found.margins is None and found.operating.static_gain == pytest.approx(SLOPE)
    document_of(found, tmp_path)
    assert Check.load(tmp_path / "check.json").sentence == found.sentence


def test_a_model_whose_free_run_diverged_where_it_was_identified_fails(checked, exact, known, rig):
    found = checked(exact(provenance={**known, **DIVERGED}), rig)
    assert (found.verdict, found.worst_case.subject) == (Verdict.FAIL, "model")
    assert "from which it was identified" in found.reason


def test_a_model_whose_own_loops_all_diverge_fails(checked, document_of, divergent, rig, tmp_path):
    """The references go to 0.6."""
    found = checked(divergent, rig)
    assert found.verdict is Verdict.FAIL
    assert "the closed loop diverges for 100 % of the models drawn from the posterior" in found.reason
    assert found.predicted is None
    assert found.sine_predicted > 0.0
    document_of(found, tmp_path)


def test_draws_whose_loops_are_unstable_are_counted(checked, exact, document_of, rig, fast, tmp_path):
    near = fast.scaled(0.9 * exact_gain_margin(fast))
    found = checked(exact(spread=0.2), rig, controller=near, samples=200)
    rows = [row for row in found.table if row.source == "model"]
    assert all(0.4 < row.stable_share < 0.9 for row in rows)
    assert all(row.gain == pytest.approx(1 / 0.9, rel=1e-6) for row in rows)
    assert all(row.gain_low == row.disk_low == 0.0 for row in rows)
    assert found.verdict is Verdict.FAIL
    stability = next(f for f in found.findings if f.subject == "stability")
    assert stability.value == min(row.stable_share for row in rows)
    document_of(found, tmp_path)


def test_a_far_too_aggressive_controller_fails_on_the_model_and_on_the_plant(checked, exact, rig, fast):
    wild = fast.scaled(1.5 * exact_gain_margin(fast))
    found = checked(exact(), rig, controller=wild, samples=5)
    assert found.verdict is Verdict.FAIL
    assert found.margins.gain == found.margins.stable_share == 0.0
    assert "plant model" in found.reason and found.steps.ripple > 0.3
    assert found.steps.command.min() >= wild.command_min


def exact_gain_margin(controller) -> float:
    """(z - p)(z - 1) + K (1 - p) z has a root at z = -1 where K = 2 (1 + p)/(1 - p)."""
    step = controller.law.d[0]  # K_i h
    return 2 * (1 + POLE) / (1 - POLE) / (step * SLOPE)


def test_a_model_of_the_wrong_gain_is_caught_on_the_plant(checked, exact, rig):
    """Designed for an eighth of the gain, the loop of the plant has an eighth of the margin."""
    found = checked(exact(gain=SLOPE / 8, spread=1e-4), rig)
    assert found.verdict is Verdict.FAIL
    assert "plant model" in found.reason


def test_a_crossover_beyond_the_band_is_marginal_and_says_what_would_settle_it(checked, exact, known, rig, fast):
    found = checked(exact(provenance={**known, BAND_KEY: "0.2"}), rig, controller=fast)
    assert found.verdict is Verdict.MARGINAL
    assert found.worst_case.subject == "excitation"
    assert "so the margins are extrapolated; record with" in found.reason


def test_a_crossover_between_two_tones_is_marginal(checked, exact, rig, fast, passed):
    """The lag is the same in every recording of the rig; only what it was asked differs."""
    crossover = passed.margins.crossover_Hz
    timepts = H * np.arange(2000)
    command = sum(0.4 * np.sin(2 * np.pi * factor * crossover * timepts + factor) for factor in (0.25, 3.0))
    quiet = read_by_the_rig(command) + 1e-3 * np.random.default_rng(2).standard_normal(2000)
    found = checked(exact(), rig, controller=fast, recording=Recording.from_arrays(command, quiet, H))
    assert (found.verdict, found.worst_case.subject) == (Verdict.MARGINAL, "excitation")
    assert "but the input of the recording has no power from" in found.reason
    assert found.excited_band_Hz == pytest.approx(3.0 * crossover, rel=0.05)


def test_a_model_that_says_too_little_does_not_pass_for_it(checked, exact, rig, fast):
    """Its residual, ten times the step, makes a band in which anything lies inside."""
    vague = exact(provenance={**exact().provenance, RMS_KEY: "6.0", TIME_KEY: "0.2"})
    found = checked(vague, rig, controller=fast)
    assert (found.verdict, found.worst_case.subject) == (Verdict.MARGINAL, "width of the prediction")
    assert found.worst_case.value > 1.0


def test_a_loop_that_leaves_the_training_data_is_at_most_marginal(checked, exact, rig):
    found = checked(exact(), rig, command_limits=(-10.0, 10.0), closed_loop_time=FAST)
    judged = {f.subject: f for f in found.findings}["training data"]
    assert judged.verdict is Verdict.MARGINAL
    assert "beyond the range of the training data, -1 to 1 V" in judged.text


def test_a_recording_in_another_unit_is_noticed(checked, exact, rig, fast):
    """What the model's free run leaves of it is far more than it left where it was identified."""
    rng = np.random.default_rng(3)
    command = rng.uniform(-1.0, 1.0, 500)
    model = exact(provenance={**exact().provenance, RMS_KEY: "0.001", TIME_KEY: "0.2"})
    sound = Recording.from_arrays(command, np.zeros(500), 0.02)
    outputs = model.simulate(sound).outputs[0]
    checked(model, rig, controller=fast, recording=Recording.from_arrays(command, outputs, 0.02))
    with pytest.raises(ModelError, match="in the same units"):
        checked(model, rig, controller=fast, recording=Recording.from_arrays(command, 1e3 * outputs, 0.02))
