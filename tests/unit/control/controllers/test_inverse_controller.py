"""Static curves and their inverse."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.control import ControlError, StaticCurve


@pytest.fixture(params=[1.0, -1.0], ids=["rising", "falling"])
def curve(request):
    inputs = np.linspace(1.1, 3.75, 20)
    outputs = request.param * 1e-4 * (inputs**2 + 0.1 * np.sin(3 * inputs))
    return StaticCurve(inputs=inputs, outputs=outputs, input_unit="V", output_unit="m")


def test_the_inverse_is_right_to_rounding(curve):
    inputs = np.random.default_rng(0).uniform(1.1, 3.75, 1000)
    np.testing.assert_allclose(curve.input(curve.output(inputs)), inputs, rtol=1e-13)
    np.testing.assert_allclose(curve.input(curve.outputs), curve.inputs, rtol=1e-13)


def test_the_inverse_finds_its_way_where_the_curve_is_flat():
    # Rises from a horizontal tangent, where the input has half the digits of the output.
    inputs = np.linspace(0.0, 2.0, 9)
    curve = StaticCurve(inputs=inputs, outputs=inputs**4)
    asked = np.linspace(0.0, 2.0, 501)
    found = curve.input(curve.output(asked))
    np.testing.assert_allclose(curve.output(found), curve.output(asked), atol=1e-14)


def test_between_its_points_a_smooth_curve_is_followed(curve):
    inputs = np.linspace(1.1, 3.75, 300)
    sign = np.sign(curve.outputs[-1])
    expected = sign * 1e-4 * (inputs**2 + 0.1 * np.sin(3 * inputs))
    # A monotone cubic is of second order near its ends: h^2/8 times the curvature of 3e-4.
    np.testing.assert_allclose(curve.output(inputs), expected, atol=1e-6)


def test_beyond_its_ends_the_ends_are_held(curve):
    assert curve.input(10.0 * curve.outputs[-1]) == pytest.approx(3.75)
    assert curve.input(-10.0 * curve.outputs[-1]) == pytest.approx(1.1)
    np.testing.assert_array_equal(curve.output([0.0, 9.0]), curve.outputs[[0, -1]])


def test_its_slope_is_the_derivative(curve):
    at, step = np.linspace(1.2, 3.7, 50), 1e-6
    expected = (curve.output(at + step) - curve.output(at - step)) / (2 * step)
    np.testing.assert_allclose(curve.slope(at), expected, rtol=1e-6)


def test_a_sample_by_hand(made):
    # e = 0.2: demand 1 + 0.2 (forward) + 0.34 * 0.2 = 1.268; command 2 sqrt(1.268).
    command, state = made.inverse.command(1.2, 1.0, np.zeros(1))
    assert float(command) == pytest.approx(2.0 * np.sqrt(1.268), rel=1e-4)  # what the cubic makes of the parabola
    assert float(made.inverse.curve.output(command)) == pytest.approx(1.268, rel=1e-14)
    assert state == pytest.approx([0.008])


def test_the_local_gain_goes_with_the_slope_of_the_inverse(made):
    for point in (1.5, 2.0, 3.0):
        expected = 0.34 / (0.5 * point)  # the curve is u^2/4
        assert made.inverse.local(point).feedback[0][0] == pytest.approx(expected, rel=2e-3)  # of the cubic
        assert made.falling.local(point).feedback[0][0] == pytest.approx(-expected, rel=2e-3)


def test_it_draws_its_curve(curve):
    axes = curve.plot()
    assert axes.get_xlabel() == "constant input (V)"
    line = axes.get_lines()[0]
    np.testing.assert_allclose(curve.output(line.get_xdata()), line.get_ydata())
    assert replace(curve, input_unit="").plot().get_xlabel() == "constant input"


def test_a_static_curve_keeps_nan_and_refuses_what_is_no_number():
    curve = StaticCurve(inputs=[0.0, 1.0, 2.0], outputs=[0.0, 1.0, 4.0])
    for read in (curve.input, curve.output, curve.slope):
        np.testing.assert_array_equal(np.isnan(read([np.nan, 0.5])), [True, False])
        for wrong in ("a", None, 1j):
            with pytest.raises(ControlError, match="value must be"):
                read(wrong)
    np.testing.assert_allclose(curve.input([-1.0, 5.0]), [0.0, 2.0])


def test_a_feedback_of_another_sample_time_is_refused(made):
    with pytest.raises(ControlError, match="the inverse controller around it every"):
        replace(made.inverse, sample_time=2 * made.inverse.sample_time)
