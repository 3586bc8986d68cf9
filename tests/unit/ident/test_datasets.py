"""What models, runs and validations look like as datasets, and that NetCDF files keep them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.frequency import gfrf
from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.narx import NarxModel, validate
from deatwin.ident.narx.document import fields_of
from deatwin.ident.narx.lasso import LassoPath
from deatwin.ident.narx.linear import LinearModel
from deatwin.ident.narx.linear.model import fields_of as linear_fields_of
from deatwin.ident.narx.posterior import one_step_band
from deatwin.ident.narx.preprocess import choose_sampling, choose_sections
from deatwin.ident.narx.preprocess.orders import OrderChoice, OrderTrial, TrialStatus
from deatwin.ident.nss import NonlinearStateSpace
from deatwin.ident.nss.document import fields_of as state_space_fields_of
from deatwin.plant import Experiment, Plant, Recording

pytest.importorskip("xarray")
MODEL = NarxModel.from_terms(
    {"y(k-1)": 0.6, "u(k-1)": 0.3, "u(k-1)^2": 0.1},
    sample_time=0.02,
    noise_variance=4e-4,
    theta_cov=np.diag([1e-4, 2e-4, 3e-4]),
    input_units=("V",),
    output_units=("m",),
)


@pytest.fixture(scope="module")
def record() -> Recording:
    """What the model makes of noise, with noise of its own."""
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal(400), np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.6 * y[k - 1] + 0.3 * u[k - 1] + 0.1 * u[k - 1] ** 2 + 0.02 * rng.standard_normal()
    return Recording.from_arrays(u, y, 0.02, start=3.0, input_units=("V",), output_units=("m",))


def test_a_narx_model_comes_back_whole(kept):
    back = kept(MODEL.to_xarray())
    assert back["term"].values.tolist() == ["y(k-1)", "u(k-1)", "u(k-1)^2"]
    assert float(back["theta"].sel(term="u(k-1)^2")) == 0.1
    assert float(back["theta_cov"].sel(term="u(k-1)", other_term="u(k-1)")) == 2e-4
    assert back["noise_variance"].values.tolist() == [4e-4] and back["noise_variance"].attrs["units"] == "(m)^2"
    again = NarxModel(**fields_of(json.loads(str(back["document"].values))))
    assert str(again) == str(MODEL) and again.theta.tolist() == MODEL.theta.tolist()


def test_runs_and_bands_stand_over_time(record, kept):
    run = MODEL.simulate(record)
    back = kept(run.to_xarray())
    assert back["computed"].dims == ("output", "time") and float(back["time"][0]) == 3.0
    np.testing.assert_array_equal(back["measured"] - back["computed"], record.outputs - run.outputs)
    assert back["computed"].attrs["units"] == "m" and back.attrs["status"] == "OK"
    sure = replace(MODEL, theta_cov=np.zeros((3, 3)))  # so that the band is that of the noise
    band = kept(one_step_band(sure, record, level=0.9).to_xarray())
    inside = ((band["lower"] <= band["measured"]) & (band["measured"] <= band["upper"])).mean()
    assert 0.86 < float(inside) < 0.94
    assert band.attrs["level"] == 0.9


def test_a_validation_has_each_test_at_its_lags(record, kept):
    found = validate(MODEL, record)
    back = kept(found.to_xarray())
    np.testing.assert_allclose(back["one_step_mean_square"], 4e-4, rtol=0.2)
    for test, name in zip(found.tests, back["test"].values, strict=True):
        row = back["correlation"].sel(test=name)
        np.testing.assert_array_equal(row.sel(lag=test.lags), test.values)
        assert int(np.isfinite(row).sum()) == test.lags.size
    assert back.attrs["status"] == "PASSED"


def test_a_linear_model_and_its_response(kept):
    model = LinearModel(
        a=[1, -0.6],
        b=[[0, 0.3, 0.1]],
        sample_time=0.02,
        theta_cov=1e-4 * np.eye(4),
        input_units=("V",),
        output_units=("m",),
    )
    back = kept(model.to_xarray())
    assert back["a"].values.tolist() == [1.0, -0.6, 0.0]
    assert back["b"].sel(input="input").values.tolist() == [0.0, 0.3, 0.1]
    again = LinearModel(**linear_fields_of(json.loads(str(back["document"].values))))
    assert again.theta.tolist() == model.theta.tolist()
    omega = np.array([0.0, 10.0])
    response = kept(gfrf(model.to_narx(), 1, omega).to_xarray())
    shift = np.exp(-1j * omega * 0.02)
    expected = (0.3 * shift + 0.1 * shift**2) / (1 - 0.6 * shift)
    np.testing.assert_allclose(response["real"], expected.real, rtol=1e-12)
    np.testing.assert_allclose(response["imaginary"], expected.imag, rtol=1e-12, atol=1e-15)
    assert response["omega"].attrs["units"] == "rad/s"
    np.testing.assert_allclose(response["frequency_Hz"], [0.0, 10 / (2 * np.pi)])


def test_a_nonlinear_state_space_comes_back_whole(kept):
    model = NonlinearStateSpace(
        terms=["x1^3"],
        transition=[[0, 0.5, 1, -0.1]],
        output=[[0, 2, 0, 0]],
        sample_time=0.02,
        noise_variance=[4e-4],
        theta_cov=1e-4 * np.eye(8),
        output_units=("m",),
        output_scale=[3.0],
    )
    back = kept(model.to_xarray())
    assert back["regressor"].values.tolist() == ["1", "x1", "u", "x1^3"]
    assert float(back["transition"].sel(regressor="x1^3")[0]) == -0.1
    assert float(back["output_weights"].sel(output="output", regressor="x1")) == 2.0
    assert float(back["noise_variance"][0]) == 4e-4 and back["noise_variance"].attrs["units"] == "(m)^2"
    assert float(back["theta_cov"][7, 7]) == 1e-4 and back.attrs["output_scale"] == 3.0
    again = NonlinearStateSpace(**state_space_fields_of(json.loads(str(back["document"].values))))
    assert again.simulate([1.0, 1.0]).outputs.tolist() == model.simulate([1.0, 1.0]).outputs.tolist()


def test_a_calibration_keeps_values_intervals_and_residuals(oscillator, experiment, kept):
    rng = np.random.default_rng(1)
    plant = Plant(rig=oscillator())
    measured: Experiment = plant.with_values({"stiffness": 450.0}).record(experiment(rng.standard_normal(200)), rng)
    found = calibrate(plant, [Part.whole(measured)], names=["stiffness", "damping"])
    back = kept(found.to_xarray())
    stiffness = back.sel(parameter="stiffness")
    assert float(stiffness["value"]) == pytest.approx(450.0, rel=0.02)
    assert (float(stiffness["low"]), float(stiffness["high"])) == found.interval("stiffness")
    assert str(stiffness["unit"].values) == "N/m"
    assert back["residual"].attrs["units"] == "m" and back.sizes["sample"] == 200
    assert float(np.sqrt((back["residual"] ** 2).mean())) == pytest.approx(back.attrs["rms"], rel=1e-12)


def test_the_choice_of_sampling_stands_over_the_lag(kept):
    time = 0.01 * np.arange(4000)
    slow = np.sin(2 * np.pi * time) + 0.3 * np.sin(0.7 * time)  # of period 1 s, or 100 samples
    found = choose_sampling(Recording.from_arrays(slow, slow, 0.01), n_lags=300)
    back = kept(found.to_xarray())
    assert float(back["linear"].sel(lag=0)) == 1.0 and float(back["lag_time"].sel(lag=100)) == pytest.approx(1.0)
    lowest = int(np.argmin(back["linear"].sel(lag=slice(0, 100)).values))
    assert back.attrs["linear_minimum"] == lowest == pytest.approx(50, abs=3)
    assert back.attrs["status"] == "DECIMATE" and back.attrs["factor"] > 1
    assert back["lag_time"].attrs["units"] == "s"


def test_the_choice_of_orders_is_a_table_with_the_chosen_one_marked(kept):
    tried = [
        OrderTrial(
            output_lags=1,
            input_lags=1,
            degree=1,
            n_terms=2,
            error=0.2,
            mean_square=0.04,
            standard_error=0.001,
            status=TrialStatus.DONE,
        ),
        OrderTrial(
            output_lags=(1, 3),
            input_lags=1,
            degree=2,
            n_terms=5,
            error=0.1,
            mean_square=0.01,
            standard_error=0.001,
            status=TrialStatus.DONE,
        ),
        OrderTrial(output_lags=2, input_lags=1, degree=3, status=TrialStatus.FAILED, reason="too few samples"),
    ]
    back = kept(OrderChoice(trials=tuple(tried), unit="m").to_xarray())
    assert back["chosen"].values.tolist() == [False, True, False]
    assert back["output_lags"].values.tolist() == ["1", "(1, 3)", "2"]
    assert back["error"].attrs["units"] == "m" and back["mean_square"].attrs["units"] == "(m)^2"
    np.testing.assert_array_equal(back["error"], [0.2, 0.1, np.inf])
    assert str(back["reason"].values[2]) == "too few samples"
    none = kept(OrderChoice(trials=tuple(tried[2:])).to_xarray())
    assert none["chosen"].values.tolist() == [False] and none.attrs["n_done"] == 0


def test_sections_keep_where_they_lie_and_every_test(kept):
    rng = np.random.default_rng(3)
    record = Recording.from_arrays(rng.standard_normal(4000), rng.standard_normal(4000), 0.01, start=5.0)
    found = choose_sections(record)
    back = kept(found.to_xarray())
    training = back.sel(section="training")
    assert (float(training["section_start"]), float(training["section_end"])) == (
        found.training.start,
        found.training.end,
    )
    assert float(back["record_start"][0]) == 5.0 and back["record_start"].attrs["units"] == "s"
    assert int(back["section_n_samples"].sum()) <= 4000
    # Input and output, three statistics each, three tests of each.
    assert back.sizes["test"] == 18 and set(back["test_kind"].values) == {"trend", "change", "spread"}
    assert back["test_p_value"].values.tolist() == [one.p_value for one in found.tests[0]]
    assert float(back["segment"][0]) == pytest.approx(2.0)  # 4000 samples in 20 segments of 0.01 s


def test_the_path_of_the_lasso_stands_over_its_knots(kept):
    path = LassoPath(
        terms=MODEL.terms[:2],
        penalties=np.array([0.5, 0.1]),
        coefficients=np.array([[0.0, 0.4], [0.0, 0.2]]),
        errors=np.array([np.inf, 0.01]),
        chosen=1,
    )
    back = kept(path.to_xarray())
    assert back["coefficient"].sel(term="u(k-1)").values.tolist() == [0.0, 0.2]
    assert back["penalty"].values.tolist() == [0.5, 0.1] and back.attrs["chosen"] == 1
