"""Orders of the output: against the sum over the frequency responses, simulation, closed forms and differences."""

import numpy as np
import pytest
from direct import direct_output
from made_narx import trajectory_of
from slopes import differences

from deatwin.ident.frequency import output_orders, output_spectrum
from deatwin.ident.frequency.output_responses.excitation import design_excitation
from deatwin.ident.frequency.varying.along_time import tv_nofrf
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError

TERMS = {
    "1": 0.2,
    "y(k-1)": 0.6,
    "y(k-3)": -0.1,
    "u(k)": 0.1,
    "u(k-1)": 0.4,
    "y(k-1)^2": 0.1,
    "y(k-1)u(k-2)": 0.1,
    "u(k-1)^3": 0.1,
    "y(k-1)y(k-2)u(k-1)": -0.05,
}
SAMPLE_TIME = 0.1
OPERATING = 0.3


def model(theta=None):
    values = TERMS.values() if theta is None else theta
    return NarxModel.from_terms(
        dict(zip(TERMS, values, strict=True)), sample_time=SAMPLE_TIME, input_units=("V",), output_units=("m",)
    )


def multisine(n_samples, lines, level=0.0):
    rng = np.random.default_rng(n_samples)
    k = np.arange(n_samples)
    return level + sum(0.2 * np.cos(2 * np.pi * (line * k / n_samples + rng.uniform())) for line in lines)


EXCITATIONS = {
    "three lines": multisine(64, (3, 10, 14)),
    "with a level, orders that fold back, and half the sampling rate": multisine(32, (5, 13, 16), level=0.1),
    "odd length": multisine(27, (2, 9, 13)),
    "noise": 0.2 * np.random.default_rng(0).normal(size=16),
}


@pytest.mark.parametrize("excitation", EXCITATIONS.values(), ids=EXCITATIONS.keys())
def test_orders_are_sums_over_the_frequency_responses(excitation):
    """Products in time against sums over combinations of lines: only rounding may differ."""
    orders = output_orders(model(), excitation, 4, operating_input=OPERATING)
    for n, by_products in enumerate(orders, start=1):
        direct = direct_output(model(), excitation, n, operating_input=OPERATING)
        assert (
            (direct.order, direct.symbol, direct.unit)
            == (n, "Y", "m")
            == (by_products.order, by_products.symbol, by_products.unit)
        )
        np.testing.assert_array_equal(direct.omega, by_products.omega)
        size = np.abs(direct.values).max()
        np.testing.assert_allclose(by_products.values, direct.values, rtol=0, atol=1e-12 * size)
        size = np.abs(direct.gradient).max()
        np.testing.assert_allclose(by_products.gradient, direct.gradient, rtol=0, atol=1e-12 * size)


def test_a_square_of_two_tones_by_hand():
    """u^2 of A cos(wt) + B cos(vt): A^2/2 + B^2/2, A^2/2 cos 2wt, B^2/2 cos 2vt, AB cos (v+w)t, AB cos (v-w)t."""
    k = np.arange(20)
    excitation = 0.5 * np.cos(2 * np.pi * 2 * k / 20) + 2.0 * np.cos(2 * np.pi * 5 * k / 20)
    square = NarxModel.from_terms({"u(k)^2": 1.0}, sample_time=0.5)
    for response in (output_orders(square, excitation, 2)[1], direct_output(square, excitation, 2)):
        expected = np.zeros(11)
        expected[[0, 4, 10, 7, 3]] = [0.125 + 2.0, 0.0625, 2.0, 0.5, 0.5]  # cos 10 at half the rate is not halved
        np.testing.assert_allclose(response.values, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(response.frequency_Hz, np.arange(11) / 10.0, rtol=1e-14)


def test_gradient_against_differences():
    theta = np.array(list(TERMS.values()))
    excitation = EXCITATIONS["three lines"]
    response = output_spectrum(model(), excitation, 3, operating_input=OPERATING)
    slopes = differences(
        lambda t: output_spectrum(model(t), excitation, 3, operating_input=OPERATING).values, theta, 1e-5
    )
    sizes = np.abs(response.gradient).max(axis=0)
    np.testing.assert_allclose(response.gradient / sizes, slopes / sizes, rtol=0, atol=1e-7)


def test_no_input_no_output():
    response = output_spectrum(model(), np.zeros(8), 3)
    assert response.values.shape == (5,) and not response.values.any() and not response.gradient.any()


HOSTILE = {"a number": 1.0, "one sample": [1.0], "empty": [], "two rows": np.ones((2, 4))}


@pytest.mark.parametrize("compute", [output_spectrum, output_orders])
def test_what_is_no_period_is_said(compute):
    for excitation in HOSTILE.values():
        with pytest.raises(ModelError, match=r"shape .* one period of at least two samples"):
            compute(model(), excitation, 2)
    for wrong in (np.nan, np.inf):
        with pytest.raises(ModelError, match=f"sample 2 of the excitation is {wrong}; all must be finite"):
            compute(model(), [1.0, 2.0, wrong, 3.0], 2)
    for excitation in (np.ones(4) * 1j, "abc", [True, False]):
        with pytest.raises(ModelError, match="the excitation must be real numbers"):
            compute(model(), excitation, 2)
    for order in (0, 2.5, True, "2"):
        with pytest.raises(ModelError, match="must be an integer"):
            compute(model(), np.ones(4), order)
    with pytest.raises(ModelError, match=r"of shape \(2, n_samples\)"):
        compute(NarxModel.from_terms({"u1(k)": 1.0, "u2(k)": 1.0}, sample_time=1.0), np.ones(4), 1)


@pytest.mark.parametrize("compute", [output_spectrum, output_orders, tv_nofrf])
def test_an_excitation_of_another_sample_time_is_refused(compute):
    n, known = 3, model()
    constant = trajectory_of(known, SAMPLE_TIME * np.arange(n), np.repeat(known.theta[:, None], n, axis=1))
    signal = design_excitation((0.0, 5.0), 0.02, amplitude=1.0, period=0.2)
    with pytest.raises(ModelError, match=r"sample time of 0.02 s, the model one of 0.1 s"):
        compute(constant if compute is tv_nofrf else known, signal, 2)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("compute", [output_spectrum, output_orders])
def test_orders_that_overflow_are_said(compute):
    with pytest.raises(ModelError, match="so large that order 2 of the output overflows"):
        compute(model(), 1e200 * np.array([1.0, -1.0, 0.5, 0.0]), 2)
