"""The check on a rig and a model that are known in closed form: every way that it can go, and what the file holds."""

import json
from dataclasses import dataclass, fields, replace
from functools import partial

import control
import numpy as np
import pytest

from deatwin.control import (
    Check,
    ControlError,
    Law,
    Limit,
    LinearController,
    LinearStatus,
    Residual,
    Specification,
    Verdict,
    check,
    from_control,
    lambda_tuning,
    linearise,
)
from deatwin.control.checking.trial import Trial, require_short_runs
from deatwin.control.loop.residual import DIVERGED, RMS_KEY, TIME_KEY
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


REVERSED = {"gain": (1.5, 2.0), "stable_share": (0.9, 0.975), "overshoot": (0.5, 0.25), "limit_cycle": (0.3, 0.05)}


@pytest.mark.parametrize("name", REVERSED)
def test_limits_the_wrong_way_round_are_refused(name):
    good, poor = REVERSED[name]
    with pytest.raises(ControlError, match=rf"of {name} (more|less) is better.* good = {good:g} and poor = {poor:g}"):
        Specification(**{name: Limit(good=good, poor=poor)})
    kept = Specification(**{name: Limit(good=poor, poor=good)})
    assert getattr(kept, name).good == poor


def test_a_number_is_no_limit():
    with pytest.raises(ControlError, match="overshoot must be a Limit, with a good and a poor value; got a float"):
        Specification(overshoot=0.1)


def refused(error):
    def design(linear, *, command_limits):
        raise error

    return design


@pytest.mark.parametrize(
    "details",
    [
        pytest.param({"closed_loop_time": 1e-3}, id="shorter than a sample"),
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


def test_given_operating_inputs_are_judged_each_once_and_the_controller_s_own_as_well(rig, fast):
    rivals = {"stiff": rig.with_values({"slope": 0.9 * SLOPE})}
    found = checked(exact(), rig, controller=fast, operating_inputs=[0.5, -0.5, 0.5], others=rivals)
    for source in ("model", "plant", "stiff"):
        assert [r.operating_input for r in found.table if r.source == source] == [-0.5, 0.0, 0.5], source
    assert found.margins.operating_input == 0.0


def test_an_operating_input_that_differs_in_its_last_digit_is_the_same(rig, fast):
    """As in the middle of a range of nine points."""
    near = replace(fast, operating_input=0.1 + 0.2)
    found = checked(exact(), rig, controller=near, operating_inputs=[0.2, 0.3, 0.3001])
    for source in ("model", "plant"):
        assert [r.operating_input for r in found.table if r.source == source] == [0.2, 0.1 + 0.2, 0.3001]


def test_a_loop_that_is_weak_only_at_its_own_operating_input_is_caught_on_the_plant(lags):
    """With 2 (u + c u³) the slope of the plant is 2 (1 + 3 c u²): 2 at 0 V and 62 at 1 V, where the loop is closed."""
    steep = lags(time=LAG, slope=SLOPE, cubic=10.0)
    controller = lambda_tuning(
        linearise(exact(), 0.9).in_loop(steep.rig.reading), command_limits=(-1.0, 1.0), closed_loop_time=FAST
    )
    found = checked(exact(), steep, controller=controller, operating_inputs=[-0.1, 0.0, 0.1])
    unstable = next(f for f in found.findings if f.subject == "stability (plant)")
    assert unstable.verdict is Verdict.FAIL
    assert "at the input 0.9" in unstable.text


def test_a_controller_of_another_sample_time_is_refused_at_once(rig, fast):
    shares = []
    with pytest.raises(ControlError, match=r"every 0\.01 s"):
        checked(exact(), rig, controller=replace(fast, sample_time=0.01), progress=shares.append)
    assert shares == []


def test_what_is_no_controller_is_refused_with_what_would_be(rig):
    model = from_control(control.tf([1.0], [1.0, -0.5], H))
    for given, says in (
        (model, r"LinearModel \(that is a model to design one on\): give a Controller"), ("PI", "= str: give"),
    ):  # fmt: skip
        with pytest.raises(ControlError, match=says):
            checked(exact(), rig, controller=given)


def test_a_controller_from_a_transfer_function_is_judged_by_its_own_margins(rig):
    """As the how-to shows it; times its gain margin the loop's poles are on the unit circle."""
    pi = control.ss(control.tf([0.2, -0.1], [1.0, -1.0], H))
    law = Law.of_error(pi.A, pi.B[:, 0], pi.C[0], pi.D[0, 0])
    mine = LinearController(
        name="my PI", law=law, windup=pi.B[:, 0] / pi.D[0, 0], sample_time=H, closed_loop_time=FAST,
        operating_input=0.0, operating_output=0.0, command_min=-1.0, command_max=1.0,
    )  # fmt: skip
    found = checked(exact(provenance={}), rig, controller=mine, samples=5)
    seen = linearise(exact()).in_loop(rig.rig.reading)
    bottom = np.convolve([1.0, -1.0], seen.denominator)
    top = np.convolve([0.2, -0.1], seen.numerator)
    size = max(top.size, bottom.size)
    top, bottom = (np.pad(part, (0, size - part.size)) for part in (top, bottom))
    for factor, stable in ((0.999, True), (1.001, False)):
        poles = np.roots(bottom + factor * found.margins.gain * top)
        assert bool(np.abs(poles).max() < 1.0) is stable


@dataclass(frozen=True, kw_only=True, eq=False)
class Unlawful(LinearController):
    """A controller whose law breaks, or is none."""

    returned: object = None

    def local(self, operating_input):
        return self.returned or {}["law"]


def test_a_controller_of_one_s_own_whose_law_breaks_is_one_clear_error(rig, fast):
    values = {field.name: getattr(fast, field.name) for field in fields(fast)}
    with pytest.raises(ControlError, match=r"Unlawful\.local raised KeyError at 0: 'law'") as caught:
        checked(exact(), rig, controller=Unlawful(**values))
    assert isinstance(caught.value.__cause__, KeyError)
    with pytest.raises(ControlError, match=r"Unlawful\.local returned str at 0; it must return a Law"):
        checked(exact(), rig, controller=Unlawful(**values, returned="PI"))


def test_runs_without_an_end_are_refused_with_the_longest_closed_loop_time(rig, fast):
    """50 times for the steps and 30 pi for three periods of a sine at a fifth of the bandwidth: 144.2 in all."""
    longest = 200_000 * H / (50 + 30 * np.pi)
    require_short_runs(replace(fast, closed_loop_time=longest - 1e-6))
    with pytest.raises(ControlError, match=r"need 2e\+05 samples, and may have 200000; give 27\.7 s or less"):
        require_short_runs(replace(fast, closed_loop_time=longest + 1e-6))
    trial = Trial(controller=replace(fast, closed_loop_time=1.0), linear=linearise(exact()), rng=None)
    assert trial.step_reference.size + trial.sine_reference.size == pytest.approx((50 + 30 * np.pi) / H, abs=1)
    with pytest.raises(ControlError, match=r"give 27\.7 s or less"):
        checked(exact(), rig, controller=replace(fast, closed_loop_time=1e9))


@pytest.mark.parametrize("samples", [1.5, 0, True, "many"])
def test_a_number_of_draws_that_is_none_is_refused(rig, samples):
    with pytest.raises(ControlError, match="samples must be an integer of at least 1; got"):
        checked(exact(), rig, samples=samples)


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


def test_a_model_whose_free_run_diverges_on_the_recording_fails_with_the_reason(rig, tmp_path):
    """p y + 8 y³ grows without end beyond |y| = 0.33; a step to 1 V takes the linear part to 2."""
    model = NarxModel.from_terms(
        {"y(k-1)": POLE, "y(k-1)^3": 8.0, "u(k)": SLOPE * (1 - POLE)}, sample_time=H, operating=TRAINED,
        provenance=KNOWN,
    )  # fmt: skip
    command = np.repeat([0.0, 1.0, 0.0, 1.0], 50)
    steps = Recording.from_arrays(command, SLOPE * command, H)
    found = checked(model, rig, recording=steps)
    assert (found.verdict, found.worst_case.subject) == (Verdict.FAIL, "model")
    assert "the model's free run fails on the recording: the free run diverged" in found.reason
    assert found.controller is found.margins is None and found.operating.static_gain == pytest.approx(SLOPE)
    document_of(found, tmp_path)
    assert Check.load(tmp_path / "check.json").sentence == found.sentence


def test_a_model_whose_free_run_diverged_where_it_was_identified_fails(rig):
    found = checked(exact(provenance={**KNOWN, **DIVERGED}), rig)
    assert (found.verdict, found.worst_case.subject) == (Verdict.FAIL, "model")
    assert "from which it was identified" in found.reason


def broken_design(linear, *, command_limits):
    return {"gain": 1.0}["gian"]


@dataclass(frozen=True)
class Drawer:
    """A design that is an object."""

    opened: bool

    def __call__(self, linear, *, command_limits):
        if not self.opened:
            raise OSError("the drawer is locked")
        return "a drawing"


@pytest.mark.parametrize(
    ("design", "says", "cause"),
    [
        (broken_design, "the design broken_design raised KeyError: 'gian'", KeyError),
        (partial(broken_design, nothing=1), "the design broken_design raised TypeError: .*nothing", TypeError),
        (Drawer(opened=False), "the design Drawer raised OSError: the drawer is locked", OSError),
        (Drawer(opened=True), "the design Drawer returned str; it must return a Controller", type(None)),
    ],
    ids=["function", "partial", "object", "no controller"],
)
def test_a_design_of_one_s_own_that_breaks_is_one_clear_error(rig, design, says, cause):
    with pytest.raises(ControlError, match=says) as caught:
        checked(exact(), rig, design=design)
    assert type(caught.value.__cause__) is cause


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


def test_a_crossover_between_two_tones_is_marginal(rig, fast, passed):
    """The lag is the same in every recording of the rig; only what it was asked differs."""
    crossover = passed.margins.crossover_Hz
    timepts = H * np.arange(2000)
    command = sum(0.4 * np.sin(2 * np.pi * factor * crossover * timepts + factor) for factor in (0.25, 3.0))
    output, value = [], 0.0
    for u in command:
        value = POLE * value + SLOPE * (1 - POLE) * u
        output.append(value)
    quiet = np.array(output) + 1e-3 * np.random.default_rng(2).standard_normal(2000)
    found = checked(exact(), rig, controller=fast, recording=Recording.from_arrays(command, quiet, H))
    assert (found.verdict, found.worst_case.subject) == (Verdict.MARGINAL, "excitation")
    assert "lies in a hole of what the recording excited" in found.reason
    assert found.excited_band_Hz == pytest.approx(3.0 * crossover, rel=0.05)


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
