"""Frequency responses as those of python-control."""

import control
import numpy as np
import pytest
from made_models import linear_model

from deatwin.control.interop.responses import linear_frd, to_frd
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.narx import linearise
from deatwin.ident.frequency import gfrf
from deatwin.ident.narx import NarxModel
from deatwin.plant import ModelError

H = 0.02
OMEGA = 2 * np.pi * np.geomspace(0.05, 20.0, 30)


@pytest.fixture(scope="module")
def uncertain() -> LinearModel:
    """G = (0.2 + 0.1 z^-1) / (1 - 0.7 z^-1) with correlated coefficients."""
    root = np.random.default_rng(3).normal(scale=1e-3, size=(3, 3))
    return linear_model(
        np.array([0.2, 0.1]),
        np.array([1.0, -0.7]),
        covariance=root @ root.T,
        input_name="command",
        output_name="displacement",
        input_unit="V",
        output_unit="m",
    )


def test_the_response_of_a_model_is_that_of_its_transfer_function(model):
    linear = linearise(model, 2.0)
    frd = to_frd(gfrf(model, 1, OMEGA, operating_input=2.0), input_name="command", output_name="displacement")
    np.testing.assert_allclose(frd.values, linear.system()(np.exp(1j * OMEGA * H)), rtol=1e-8)
    np.testing.assert_allclose(frd.values, linear_frd(linear, OMEGA).values, rtol=1e-8)
    assert frd.system.input_labels == ["command"] and frd.system.output_labels == ["displacement"]


def test_both_ways_have_the_same_covariance(model):
    response = gfrf(model, 1, OMEGA, operating_input=2.0)
    from_model, from_coefficients = to_frd(response), linear_frd(linearise(model, 2.0), OMEGA)
    scale = np.trace(response.covariance, axis1=1, axis2=2)[:, None, None]
    assert np.abs((from_coefficients.covariance - from_model.covariance) / scale).max() < 1e-6
    np.testing.assert_allclose(from_coefficients.gain_deviation, response.gain_deviation, rtol=1e-6)


def test_frequencies_are_put_in_order(uncertain):
    there, back = linear_frd(uncertain, OMEGA), linear_frd(uncertain, OMEGA[::-1])
    np.testing.assert_array_equal(there.values, back.values)
    np.testing.assert_array_equal(there.covariance, back.covariance)


def test_python_control_draws_it_and_puts_it_in_a_loop(uncertain):
    frd = linear_frd(uncertain, OMEGA)
    loop = frd.system * control.tf([0.5, 0.0], [1.0, -1.0], H)
    z = np.exp(1j * OMEGA * H)
    expected = frd.values * 0.5 * z / (z - 1.0)
    np.testing.assert_allclose(loop.frdata[0, 0], expected, rtol=1e-12)
    margins = control.stability_margins(uncertain.system() * control.tf([0.5, 0.0], [1.0, -1.0], H))
    # Between its frequencies a response is interpolated.
    np.testing.assert_allclose(control.stability_margins(loop)[1], margins[1], rtol=1e-3)
    assert control.bode_plot(frd.system).figure.axes
    assert control.nyquist_plot(frd.system, warn_encirclements=False).figure.axes
    axes = frd.plot()
    assert axes.get_ylabel() == "gain (m/V)" and axes.get_xlabel() == "frequency (Hz)"
    zero = linear_frd(uncertain, [0.0, 1.0, 2.0]).plot()
    assert zero.lines[0].get_xdata().size == 2


def test_its_arrays_cannot_be_written(uncertain):
    with pytest.raises(ValueError, match="read-only"):
        linear_frd(uncertain, OMEGA).covariance[0] = 0.0


def test_bad_input_is_one_clear_error(model, uncertain):
    with pytest.raises(ModelError, match="order 1"):
        to_frd(gfrf(model, 2, [[1.0, 2.0]]))
    with pytest.raises(ModelError, match="order 1"):
        to_frd(uncertain)
    with pytest.raises(ModelError, match="from 0 on"):
        linear_frd(uncertain, [-1.0])
    for wrong in ([np.nan], [], [1e3], [[1.0]]):
        with pytest.raises(ModelError, match="half the sampling rate"):
            linear_frd(uncertain, wrong)
    without = linearise(NarxModel.from_terms({"y(k-1)": 1.0}, sample_time=H))
    with pytest.raises(ModelError, match="does not settle"):
        linear_frd(without, OMEGA)


def test_a_dataset_holds_values_covariance_and_both_frequencies(uncertain, kept):
    frd = linear_frd(uncertain, [1.0, 30.0])
    back = kept(frd.to_xarray())
    np.testing.assert_array_equal(back["real"] + 1j * back["imaginary"], frd.values)
    np.testing.assert_array_equal(back["covariance"].sel(part="real", other_part="imaginary"), frd.covariance[:, 0, 1])
    np.testing.assert_allclose(2 * np.pi * back["frequency_Hz"], [1.0, 30.0], rtol=1e-15)
    assert back["real"].attrs["units"] == "m/V" and back["covariance"].attrs["units"] == "(m/V)^2"
