"""The check of an exact model: the points, times, plants and draws that it judges, and what its file holds."""

from dataclasses import replace

import control
import numpy as np
import pytest
from made_models import controller_of
from made_narx import trajectory_of
from stopping import StopAt

from deatwin.control import Check, Law, Limit, Specification, Verdict, controller_to_dict, lambda_tuning, linearise
from deatwin.ident.narx import ThetaTrajectory
from deatwin.plant import CalibratedPlant

H, LAG, SLOPE = 0.02, 0.01, 2.0  # of the fixture `rig`
FAST = 0.06
"""Closed-loop time, s: so short that the check is."""
MARGINS = ("gain margin", "phase margin", "delay margin", "disk margin")


def test_an_exact_model_of_a_sound_loop_passes(subjects, passed):
    assert passed.verdict is Verdict.PASS, passed.sentence
    assert (
        passed.reason
        == f"the {passed.controller.name} controller meets all requirements at constant inputs of -0.3 to 0.3 V"
    )
    assert subjects(passed) == {
        *(f"{name}{of}" for name in ("stability", *MARGINS) for of in ("", " (plant)", " (model, linearised)")),
        "excitation",
        "model in closed loop",
        "overshoot",
        "steady-state error",
        "ripple",
        "saturation",
        "tracking",
        "gain margin on the plant",
        "limit cycle",
        "prediction",
        "width of the prediction",
        "film",
        "training data",
    }
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


def test_the_file_comes_back(document_of, passed, tmp_path):
    document = document_of(passed, tmp_path)
    loaded = Check.load(tmp_path / "check.json")
    for name in ("verdict", "reason", "sentence", "findings", "operating", "margins", "table", "excited_band_Hz"):
        assert getattr(loaded, name) == getattr(passed, name), name
    assert loaded.sine_predicted == passed.sine_predicted
    assert loaded.steps.to_dict() == passed.steps.to_dict()
    assert loaded.sine.to_dict() == passed.sine.to_dict()
    assert controller_to_dict(loaded.controller) == controller_to_dict(passed.controller)
    assert document["schema"] == "deatwin/check/1"
    (tmp_path / "again").mkdir()
    again = document_of(loaded, tmp_path / "again")
    assert {**document, "predicted": None} == again


def test_the_same_seed_gives_the_same_bytes_and_progress_goes_from_0_to_1(checked, exact, rig, passed, tmp_path):
    shares = []
    again = checked(exact(), rig, progress=shares.append)
    for name, found in (("first", passed), ("second", again)):
        (tmp_path / name).mkdir()
        found.save(tmp_path / name / "check.json")
    first, second = ((tmp_path / name / "check.json").read_bytes() for name in ("first", "second"))
    assert first == second
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < 0.2 and shares[-1] == 1.0


@pytest.mark.parametrize("calls", [1, 3, 8])
def test_an_interrupt_passes_through(checked, exact, rig, calls):
    with pytest.raises(KeyboardInterrupt):
        checked(exact(), rig, progress=StopAt(calls))


def test_a_rival_that_fails_decides_and_is_named(checked, exact, document_of, rig, fast, tmp_path):
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


@pytest.fixture
def varying(exact):
    """The gain grows by a factor from 0 to 100 s."""

    def grow(factor: float) -> ThetaTrajectory:
        model, times = exact(spread=1e-4), np.linspace(0.0, 100.0, 11)
        grown = model.theta[:, None] * np.array([np.ones(11), 1 + (factor - 1) * times / 100])
        return trajectory_of(model, times, grown, theta_cov=np.tile(model.theta_cov, (11, 1, 1)))

    return grow


def test_margins_along_time_are_worst_where_the_gain_is_largest(
    checked, exact, document_of, varying, rig, fast, tmp_path
):
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


def test_a_gain_that_grows_beyond_the_margin_fails_by_its_time(checked, exact, varying, rig, fast):
    found = checked(exact(spread=1e-4), rig, controller=fast, trajectory=varying(20.0))
    assert found.verdict is Verdict.FAIL
    assert "s after the start" in found.worst_case.text
    assert found.worst_case.subject == "stability"
    late = [row for row in found.table if row.time == 100.0]
    assert late[0].stable_share == late[0].gain == 0.0


def test_a_calibrated_plant_is_judged_on_draws_of_its_parameters(checked, exact, rig, fast):
    calibrated = CalibratedPlant(
        plant=rig, noise=1e-3, model_error=0.0, names=("slope",), covariance=np.array([[0.2**2]])
    )
    found = checked(exact(), calibrated, controller=fast)
    rows = [row for row in found.table if row.source == "plant"]
    assert all(row.samples == 21 for row in rows)
    # The slope's coordinate is its logarithm or itself: deviations of 20 or 10 %, of which 20 draws reach two.
    assert all(row.gain_low < 0.9 * row.gain for row in rows)
    film = next(f for f in found.findings if f.subject == "film")
    assert "8 simulated actuators" in film.text


def test_given_operating_inputs_are_judged_each_once_by_the_given_limits(
    checked, exact, document_of, rig, fast, tmp_path
):
    """One that differs from the controller's own in its last digit is the same, as in the middle of a range."""
    near, rivals = replace(fast, operating_input=0.1 + 0.2), {"stiff": rig.with_values({"slope": 0.9 * SLOPE})}
    wanted = Specification(gain=Limit(good=2000.0, poor=1000.0))
    inputs = [0.5, -0.5, 0.5, 0.3, 0.3001]
    found = checked(exact(), rig, controller=near, operating_inputs=inputs, others=rivals, specification=wanted)
    for source in ("model", "plant", "stiff"):
        assert [r.operating_input for r in found.table if r.source == source] == [-0.5, 0.1 + 0.2, 0.3001, 0.5], source
    assert found.margins.operating_input == 0.1 + 0.2
    assert found.verdict is Verdict.FAIL
    assert "the gain margin is" in found.reason
    assert "required: at least 2000" in found.reason
    document_of(found, tmp_path)


def test_a_loop_that_is_weak_only_at_its_own_operating_input_is_caught_on_the_plant(checked, exact, lags):
    """With 2 (u + c u³) the slope of the plant is 2 (1 + 3 c u²): 2 at 0 V and 62 at 1 V, where the loop is closed."""
    steep = lags(time=LAG, slope=SLOPE, cubic=10.0)
    controller = lambda_tuning(
        linearise(exact(), 0.9).in_loop(steep.rig.reading), command_limits=(-1.0, 1.0), closed_loop_time=FAST
    )
    found = checked(exact(), steep, controller=controller, operating_inputs=[-0.1, 0.0, 0.1])
    assert [r.operating_input for r in found.table if r.source == "plant"] == [-0.1, 0.0, 0.1, 0.9]
    unstable = next(f for f in found.findings if f.subject == "stability (plant)")
    assert unstable.verdict is Verdict.FAIL
    assert "at a constant input of 0.9" in unstable.text


def test_a_controller_from_a_transfer_function_is_judged_by_its_own_margins(checked, exact, rig):
    """As the how-to shows it; times its gain margin the loop's poles are on the unit circle."""
    pi = control.ss(control.tf([0.2, -0.1], [1.0, -1.0], H))
    law = Law.of_error(pi.A, pi.B[:, 0], pi.C[0], pi.D[0, 0])
    mine = controller_of(law, pi.B[:, 0] / pi.D[0, 0], name="my PI", closed_loop_time=FAST)
    found = checked(exact(provenance={}), rig, controller=mine, samples=5)
    seen = linearise(exact()).in_loop(rig.rig.reading)
    bottom = np.convolve([1.0, -1.0], seen.denominator)
    top = np.convolve([0.2, -0.1], seen.numerator)
    size = max(top.size, bottom.size)
    top, bottom = (np.pad(part, (0, size - part.size)) for part in (top, bottom))
    for factor, stable in ((0.999, True), (1.001, False)):
        poles = np.roots(bottom + factor * found.margins.gain * top)
        assert bool(np.abs(poles).max() < 1.0) is stable


def test_plots(passed):
    axes = passed.plot()
    assert axes.get_ylabel() == "output (mm)" and passed.verdict.value in axes.get_title()
    assert passed.predicted.plot().get_xlabel() == "time (s)"
    assert passed.steps.plot().get_ylabel() == "output (mm)"


def test_a_plant_with_another_zero_is_told_apart_from_a_bad_controller(checked, exact, rig, trained):
    """The plant rests from -2 to 2 mm; the steps of 0.6 mm are about the model's own rest."""
    for zero, told in ((1.0, False), (3.0, True)):
        ends = {f"output_{end}": getattr(trained, f"output_{end}") + zero for end in ("min", "max", "centre")}
        model = exact(output_origin=np.array([zero]), operating=replace(trained, **ends))
        found = checked(model, rig)
        assert (found.verdict is Verdict.FAIL) == told
        apart = [finding for finding in found.findings if finding.subject == "operating point"]
        assert len(apart) == told
    assert found.worst_case is apart[0] and apart[0].value == pytest.approx(-3.0)
    assert "the model's output is 3 mm and the plant's is 0 mm, a difference of 3 mm" in found.sentence
    assert "within the limits of the command, the plant reaches only -2 to 2 mm" in found.sentence
