"""The check on a rig and a model that are known in closed form: every way that it can go, and what the file holds."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deatwin.control import (
    Check,
    ControlError,
    Limit,
    LinearStatus,
    Residual,
    Specification,
    Verdict,
    check,
    lambda_tuning,
    linearise,
)
from deatwin.control.loop.residual import RMS_KEY, TIME_KEY
from deatwin.control.stability.excited import BAND_KEY
from deatwin.ident.narx import NarxModel, ThetaTrajectory
from deatwin.ident.narx.operating import OperatingRange
from deatwin.plant import CalibratedPlant, DataError, ModelError, Recording

H, LAG, SLOPE = 0.02, 0.01, 2.0
POLE = np.exp(-H / LAG)
FAST = 0.06
"""Closed-loop time, s: so short that the check is."""
TRAINED = OperatingRange(
    input_min=np.array([-1.0]), input_max=np.array([1.0]), input_centre=np.array([0.0]),
    output_min=np.array([-2.0]), output_max=np.array([2.0]), output_centre=np.array([0.0]),
)  # fmt: skip
KNOWN = {BAND_KEY: "5.0", **Residual(rms=2e-3, correlation_time=0.2).provenance}


MARGINS = ("gain margin", "phase margin", "delay margin", "disk margin")


def exact(gain: float = SLOPE, spread: float = 1e-3, **details) -> NarxModel:
    """The rig's rows: y(k) = p y(k-1) + g (1 - p) u(k)."""
    given = {"operating": TRAINED, "provenance": KNOWN, "input_units": ("V",), "output_units": ("mm",)} | details
    return NarxModel.from_terms(
        {"y(k-1)": POLE, "u(k)": gain * (1 - POLE)}, sample_time=H, theta_cov=spread**2 * np.eye(2), **given
    )


def checked(model, plant, seed=3, samples=60, **details) -> Check:
    given = {"closed_loop_time": FAST} | details
    return check(model, plant, rng=np.random.default_rng(seed), samples=samples, **given)


def subjects(found: Check) -> set[str]:
    return {finding.subject for finding in found.findings}


def document_of(found: Check, path) -> dict:
    """What `save` writes, strictly JSON: no NaN, no infinity, in numbers or in words."""
    found.save(path / "check.json")
    text = (path / "check.json").read_text(encoding="utf-8")

    def refuse(name):
        raise AssertionError(name)

    document = json.loads(text, parse_constant=refuse)
    written = json.dumps([document["reason"], document["sentence"], document["findings"]]).lower()
    assert " nan" not in written
    assert " inf " not in written
    return document


@pytest.fixture(scope="module")
def rig(lags):
    return lags(time=LAG, slope=SLOPE)


@pytest.fixture(scope="module")
def passed(rig):
    return checked(exact(), rig)


@pytest.fixture(scope="module")
def fast(rig):
    """A sound controller of the shortest check."""
    return lambda_tuning(linearise(exact()).in_loop(rig.rig.reading), command_limits=(-1.0, 1.0), closed_loop_time=FAST)


def test_an_exact_model_of_a_sound_loop_passes(passed):
    assert passed.verdict is Verdict.PASS, passed.sentence
    assert passed.reason == "every limit is kept"
    assert subjects(passed) == {
        "stability", "gain margin", "phase margin", "delay margin", "disk margin", "stability (plant)",
        "gain margin (plant)", "phase margin (plant)", "delay margin (plant)", "disk margin (plant)", "excitation",
        "model in closed loop", "overshoot", "steady error", "ripple", "saturation", "tracking",
        "gain margin on the plant", "limit cycle", "prediction", "width of the prediction", "film", "training data",
        *(f"{name} (model by its analytic band)" for name in ("stability", *MARGINS)),
    }  # fmt: skip
    # The exact model and the plant have the same margins, as far as the rig's integrator is exact.
    at_rest = {row.source: row for row in passed.table if row.operating_input == 0.0}
    model, plant = at_rest["model"], at_rest["plant"]
    assert model.gain == pytest.approx(plant.gain, rel=1e-5)
    assert model.disk == pytest.approx(plant.disk, rel=1e-5)
    assert passed.margins == model
    assert passed.sine_predicted > 0.0


def test_the_operating_points_are_where_the_references_move(passed):
    """30 % of the stroke to the nearer limit, of 1 V to each side."""
    expected = np.linspace(-0.3, 0.3, 5)
    for source in ("model", "plant"):
        points = [row.operating_input for row in passed.table if row.source == source]
        np.testing.assert_allclose(points, expected, atol=1e-12)


def test_the_file_comes_back(passed, tmp_path):
    document = document_of(passed, tmp_path)
    loaded = Check.load(tmp_path / "check.json")
    for name in ("verdict", "reason", "sentence", "findings", "operating", "margins", "table", "excited_band_Hz"):
        assert getattr(loaded, name) == getattr(passed, name), name
    assert loaded.sine_predicted == passed.sine_predicted
    assert loaded.steps.to_dict() == passed.steps.to_dict()
    assert loaded.sine.to_dict() == passed.sine.to_dict()
    (tmp_path / "again").mkdir()
    again = document_of(loaded, tmp_path / "again")
    assert {**document, "predicted": None} == again


def test_the_same_seed_gives_the_same_bytes_and_progress_goes_from_0_to_1(rig, passed, tmp_path):
    shares, heavy = [], {"rival": rig.with_values({"slope": 1.1 * SLOPE})}
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        checked(exact(), rig, others=heavy, progress=shares.append).save(tmp_path / name / "check.json")
    first, second = ((tmp_path / name / "check.json").read_bytes() for name in ("first", "second"))
    assert first == second
    half = shares[: len(shares) // 2]
    assert half == sorted(half)
    assert shares[: len(half)] == shares[len(half) :]
    assert 0.0 <= half[0] < 0.2
    assert half[-1] == 1.0


@pytest.mark.parametrize("calls", [1, 3, 8])
def test_an_interrupt_passes_through(rig, calls):
    count = 0

    def stop(share):
        nonlocal count
        count += 1
        if count == calls:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        checked(exact(), rig, progress=stop)


def test_a_specification_that_cannot_be_met_fails_with_its_reason(rig, fast, tmp_path):
    wanted = Specification(gain=Limit(good=2000.0, poor=1000.0))
    found = checked(exact(), rig, controller=fast, specification=wanted)
    assert found.verdict is Verdict.FAIL
    assert "the gain margin is" in found.reason
    assert "at least 2000 is wanted" in found.reason
    document_of(found, tmp_path)


@pytest.mark.parametrize(("good", "poor"), [(2.0, 2.0), (np.nan, 1.0), (2.0, np.inf)])
def test_a_limit_that_says_nothing_is_refused(good, poor):
    with pytest.raises(ControlError, match="two finite numbers that differ"):
        Limit(good=good, poor=poor)


def refused(error):
    def design(linear, *, command_limits):
        raise error

    return design


@pytest.mark.parametrize(
    "details",
    [
        pytest.param({"closed_loop_time": 1e-3}, id="shorter than a sample"),
        pytest.param({"closed_loop_time": -1.0}, id="backwards"),
        pytest.param({"command_limits": (-1.0, np.inf)}, id="no limit"),
        pytest.param({"design": refused(ControlError("no such controller"))}, id="design"),
        pytest.param({"design": refused(ModelError("not on this model"))}, id="model"),
    ],
)
def test_a_design_that_is_refused_fails_with_its_reason(rig, details, tmp_path):
    shares = []
    found = checked(exact(), rig, progress=shares.append, **details)
    assert found.verdict is Verdict.FAIL
    assert found.reason.startswith("no controller could be designed: ")
    assert found.controller is found.margins is found.steps is None
    assert found.table == ()
    document_of(found, tmp_path)
    assert Check.load(tmp_path / "check.json").sentence == found.sentence


def test_a_rival_that_fails_decides_and_is_named(rig, fast, tmp_path):
    others = {
        "stiff": rig.with_values({"slope": 0.9 * SLOPE}),
        "electrode_rc": CalibratedPlant.nominal(rig.with_values({"slope": 12 * SLOPE})),
    }
    found = checked(exact(), rig, controller=fast, others=others)
    assert found.verdict is Verdict.FAIL
    assert "electrode_rc" in found.reason
    assert "stiff" not in found.reason
    failed = {f.subject for f in found.findings if f.verdict is Verdict.FAIL}
    assert failed
    assert all("electrode_rc" in subject for subject in failed)
    assert set(found.others) == {"stiff", "electrode_rc"}
    document_of(found, tmp_path)
    loaded = Check.load(tmp_path / "check.json")
    assert loaded.others["stiff"].to_dict() == found.others["stiff"].to_dict()


def varying(factor: float) -> ThetaTrajectory:
    """The gain grows by a factor from 0 to 100 s."""
    model, times = exact(spread=1e-4), np.linspace(0.0, 100.0, 11)
    grown = model.theta[:, None] * np.array([np.ones(11), 1 + (factor - 1) * times / 100])
    return ThetaTrajectory(
        model=model, timepts=times, theta=grown, theta_cov=np.tile(model.theta_cov, (11, 1, 1)),
        drift_variance=np.zeros(2),
    )  # fmt: skip


def test_margins_along_time_are_worst_where_the_gain_is_largest(rig, fast, tmp_path):
    found = checked(exact(spread=1e-4), rig, controller=fast, trajectory=varying(3.0))
    rows = [row for row in found.table if row.time is not None]
    assert [row.time for row in rows] == pytest.approx(np.linspace(0.0, 100.0, 11).tolist())
    margins = np.array([row.gain for row in rows])
    # A gain margin goes with the inverse of the gain.
    np.testing.assert_allclose(margins, found.margins.gain / (1 + 2 * np.linspace(0, 1, 11)), rtol=1e-9)
    gain = next(f for f in found.findings if f.subject == "gain margin")
    assert gain.value == rows[-1].gain_low
    assert "100 s after the start" in gain.text
    table = document_of(found, tmp_path)["table"]
    assert [row["time"] for row in table if row["time"] is not None] == [row.time for row in rows]
    assert Check.load(tmp_path / "check.json").table == found.table


def test_a_gain_that_grows_beyond_the_margin_fails_by_its_time(rig, fast):
    found = checked(exact(spread=1e-4), rig, controller=fast, trajectory=varying(20.0))
    assert found.verdict is Verdict.FAIL
    assert "s after the start" in found.worst_case.text
    assert found.worst_case.subject == "stability"
    late = [row for row in found.table if row.time == 100.0]
    assert late[0].stable_share == late[0].gain == 0.0


def test_a_calibrated_plant_is_judged_on_draws_of_its_parameters(rig, fast):
    calibrated = CalibratedPlant(
        plant=rig, noise=1e-3, model_error=0.0, names=("slope",), covariance=np.array([[0.2**2]])
    )
    found = checked(exact(), calibrated, controller=fast)
    rows = [row for row in found.table if row.source == "plant"]
    assert all(row.samples == 21 for row in rows)
    # The slope's coordinate is its logarithm or itself: deviations of 20 or 10 %, of which 20 draws reach two.
    assert all(row.gain_low < 0.9 * row.gain for row in rows)
    film = next(f for f in found.findings if f.subject == "film")
    assert "8 plants" in film.text


@pytest.mark.parametrize(
    ("points", "message"),
    [([], "finite"), ([np.nan], "finite"), ([0.0, np.inf], "finite"), (["a"], "real numbers"),
     ([[0.0], [0.1, 0.2]], "real numbers"), ([0.0, 1.5], "outside of the training data")],
)  # fmt: skip
def test_operating_inputs_that_make_no_sense_are_one_clear_error(rig, fast, points, message):
    with pytest.raises((ModelError, ControlError), match=message):
        checked(exact(), rig, controller=fast, operating_inputs=points)


def test_given_operating_inputs_are_judged_each_once(rig, fast):
    found = checked(exact(), rig, controller=fast, operating_inputs=[0.5, -0.5, 0.5])
    assert [r.operating_input for r in found.table if r.source == "plant"] == [-0.5, 0.5]
    # The model is judged at the controller's own point as well.
    assert [r.operating_input for r in found.table if r.source == "model"] == [-0.5, 0.0, 0.5]
    assert found.margins.operating_input == 0.0


def test_a_controller_of_another_sample_time_is_refused_at_once(rig, fast):
    shares = []
    with pytest.raises(ControlError, match=r"every 0\.01 s"):
        checked(exact(), rig, controller=replace(fast, sample_time=0.01), progress=shares.append)
    assert shares == []


def test_a_controller_outside_of_the_training_data_is_refused(rig, fast):
    far = replace(fast, operating_input=1.2, command_max=2.0)
    with pytest.raises(ModelError, match="outside of the training data"):
        checked(exact(), rig, controller=far)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        pytest.param({"y(k-1)": 0.5, "u1(k)": 1.0, "u2(k)": 1.0}, "2 inputs", id="two inputs"),
        pytest.param({"y1": {"y1(k-1)": 0.5, "u(k)": 1.0}, "y2": {"y2(k-1)": 0.5}}, "output", id="two outputs"),
        pytest.param({"y(k-1)": 0.5, "u(k)": 1.0, "e(k-1)": 0.3}, "noise", id="noise terms"),
    ],
)
def test_a_model_of_another_kind_is_one_clear_error(rig, terms, message):
    with pytest.raises(ModelError, match=message):
        checked(NarxModel.from_terms(terms, sample_time=H), rig, operating_input=0.0, command_limits=(-1.0, 1.0))


@pytest.mark.parametrize(
    ("terms", "status"),
    [
        ({"y(k-1)": 1.2, "u(k)": 1.0}, LinearStatus.UNSTABLE),
        ({"y(k-1)": 1.0, "u(k)": 1.0}, None),  # it integrates
        ({"y(k-1)": 0.5, "u(k)": 1.0, "u(k-1)": -1.0}, LinearStatus.NO_GAIN),
        ({"y(k-1)": 0.5, "u(k)^2": 1.0}, LinearStatus.NO_GAIN),  # at u = 0
        ({"y(k-1)": 0.5, "1": 1.0}, None),
    ],
)
def test_a_model_that_cannot_be_used_fails_with_its_reason_with_a_controller_too(rig, fast, terms, status, tmp_path):
    model = NarxModel.from_terms(terms, sample_time=H, operating=TRAINED)
    for details in ({}, {"controller": fast}):
        try:
            found = checked(model, rig, **details)
        except ModelError as error:  # no input at all is one clear error
            assert "input" in str(error)
            continue
        assert found.verdict is Verdict.FAIL
        assert status is None or found.operating.status is status
        assert found.operating.status.value in found.reason
        document_of(found, tmp_path)


def test_a_band_that_is_not_known_is_at_most_marginal_and_no_prediction_is_judged(rig, fast, passed, tmp_path):
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
def test_a_band_that_is_none_is_refused(rig, fast, written):
    with pytest.raises(ModelError, match="must be a positive number"):
        checked(exact(provenance={BAND_KEY: written}), rig, controller=fast)


def test_a_recording_tells_band_and_residual(rig, fast):
    rng = np.random.default_rng(4)
    command = np.repeat(rng.uniform(-1.0, 1.0, 500), 4)
    output, value = [], 0.0
    for u in command:
        value = POLE * value + SLOPE * (1 - POLE) * u
        output.append(value)
    sound = Recording.from_arrays(command, np.array(output) + 1e-3 * rng.standard_normal(2000), H)
    found = checked(exact(provenance={}), rig, controller=fast, recording=sound)
    assert found.predicted is not None
    assert found.excited_band_Hz > found.margins.crossover_Hz
    with pytest.raises(DataError, match="constant"):
        checked(exact(), rig, controller=fast, recording=Recording.from_arrays(np.zeros(90), np.zeros(90), H))


def test_a_model_whose_own_loops_all_diverge_fails(rig, tmp_path):
    """p y + 8 y³ grows without end beyond |y| = sqrt((1 - p)/8) = 0.33; the references go to 0.6."""
    model = NarxModel.from_terms(
        {"y(k-1)": POLE, "y(k-1)^3": 8.0, "u(k)": SLOPE * (1 - POLE)}, sample_time=H, operating=TRAINED,
        provenance=KNOWN,
    )  # fmt: skip
    found = checked(model, rig)
    assert found.verdict is Verdict.FAIL
    assert "100 % of the model's own closed loops diverge" in found.reason
    assert found.predicted is None
    assert found.sine_predicted > 0.0
    document_of(found, tmp_path)


def test_draws_whose_loops_are_unstable_are_counted(rig, fast, tmp_path):
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


def exact_gain_margin(controller) -> float:
    """(z - p)(z - 1) + K (1 - p) z has a root at z = -1 where K = 2 (1 + p)/(1 - p)."""
    step = controller.law.d[0]  # K_i h
    return 2 * (1 + POLE) / (1 - POLE) / (step * SLOPE)


def test_a_model_of_the_wrong_gain_is_caught_on_the_plant(rig):
    """Designed for an eighth of the gain, the loop of the plant has an eighth of the margin."""
    found = checked(exact(gain=SLOPE / 8, spread=1e-4), rig)
    assert found.verdict is Verdict.FAIL
    assert "physics plant" in found.reason


def test_a_crossover_beyond_the_band_is_marginal_and_says_what_would_settle_it(rig, fast):
    found = checked(exact(provenance={**KNOWN, BAND_KEY: "0.2"}), rig, controller=fast)
    assert found.verdict is Verdict.MARGINAL
    assert found.worst_case.subject == "excitation"
    assert "would settle it" in found.reason


def test_plots(passed):
    import matplotlib

    matplotlib.use("agg")
    assert passed.plot().get_ylabel() == "output (mm)"
    assert passed.predicted.plot().get_xlabel() == "time (s)"
    assert passed.steps.plot().get_ylabel() == "output (mm)"


def test_a_model_that_says_too_little_does_not_pass_for_it(rig, fast):
    """Its residual, ten times the step, makes a band in which anything lies inside."""
    vague = exact(provenance={**exact().provenance, RMS_KEY: "6.0", TIME_KEY: "0.2"})
    found = checked(vague, rig, controller=fast)
    assert (found.verdict, found.worst_case.subject) == (Verdict.MARGINAL, "width of the prediction")
    assert found.worst_case.value > 1.0


def test_a_loop_that_leaves_the_training_data_is_at_most_marginal(rig):
    found = checked(exact(), rig, command_limits=(-10.0, 10.0), closed_loop_time=FAST)
    judged = {f.subject: f for f in found.findings}["training data"]
    assert judged.verdict is Verdict.MARGINAL
    assert "beyond the training data, which go from -1 to 1" in judged.text


def test_a_design_for_another_operating_input_is_refused(rig, fast):
    with pytest.raises(ControlError, match=r"for the operating input 0\.5, not for 0"):
        checked(exact(), rig, design=lambda linear, command_limits: replace(fast, operating_input=0.5))


@pytest.mark.parametrize("name", ["", "plant", "model", "plant in large motions"])
def test_another_plant_needs_a_name_of_its_own(rig, fast, name):
    with pytest.raises(ControlError, match="cannot be called"):
        checked(exact(), rig, controller=fast, others={name: rig})


def test_a_recording_in_another_unit_is_noticed(rig, fast):
    """What the model's free run leaves of it is far more than it left where it was identified."""
    rng = np.random.default_rng(3)
    command = rng.uniform(-1.0, 1.0, 500)
    model = exact(provenance={**exact().provenance, RMS_KEY: "0.001", TIME_KEY: "0.2"})
    sound = Recording.from_arrays(command, np.zeros(500), 0.02)
    outputs = model.simulate(sound).outputs[0]
    checked(model, rig, controller=fast, recording=Recording.from_arrays(command, outputs, 0.02))
    with pytest.raises(ModelError, match="in the same units"):
        checked(model, rig, controller=fast, recording=Recording.from_arrays(command, 1e3 * outputs, 0.02))
