"""What linear models, families, margins and limit cycles look like as datasets, and that NetCDF files keep them."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import linear_model

from deatwin.control import StaticCurve
from deatwin.control.linear.family import LinearFamily
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.schedule import GainSchedule, VaryingLinear
from deatwin.control.stability.bands import band_margins
from deatwin.control.stability.limit_cycles import limit_cycles

pytest.importorskip("xarray")
LAG = linear_model(
    [0.0, 0.3],
    [1.0, -0.7],
    covariance=np.diag([0.0, 1e-4, 4e-4]),
    operating_input=2.0,
    operating_output=5e-4,
    input_name="command",
    output_name="displacement",
    input_unit="V",
    output_unit="m",
)


def with_pole(pole: float, level: float) -> LinearModel:
    """Of static gain ``level`` m/V and one pole."""
    return replace(LAG, numerator=[0.0, level * (1 - pole)], denominator=[1.0, -pole], operating_input=level)


@pytest.fixture(scope="module")
def family() -> LinearFamily:
    """Two operating points; the model itself and two samples."""
    return LinearFamily.of([[with_pole(p, g) for p in (0.7, 0.6, 0.8)] for g in (1.0, 2.0)])


def test_a_linear_model_keeps_coefficients_and_covariance(kept):
    back = kept(LAG.to_xarray())
    assert back["numerator"].values.tolist() == [0.0, 0.3] and back["numerator"].attrs["units"] == "m/V"
    assert back["denominator"].values.tolist() == [1.0, -0.7]
    assert float(back["covariance"].sel(coefficient="a_1", other_coefficient="a_1")) == 4e-4
    assert float(back["covariance"].sel(coefficient="b_1", other_coefficient="b_1")) == 1e-4
    assert back.attrs["status"] == "OK" and back.attrs["operating_output"] == 5e-4


def test_a_linear_model_without_equilibrium_is_kept_too(kept):
    nowhere = LinearModel.without_equilibrium("none there", sample_time=0.02, operating_input=9.0)
    back = kept(nowhere.to_xarray())
    assert back.attrs["status"] == "NO_EQUILIBRIUM" and "operating_output" not in back.attrs


def test_a_gain_schedule_stands_over_the_operating_input(family, kept):
    back = kept(GainSchedule(family=family).to_xarray())
    assert back["operating_input"].values.tolist() == [1.0, 2.0] and back["operating_input"].attrs["units"] == "V"
    np.testing.assert_allclose(back["static_gain"], [1.0, 2.0])
    assert back["static_gain"].attrs == {"units": "m/V", "long_name": "G(1)"}
    # The time constants -T/ln(p) of the poles 0.7 (the model), 0.6 and 0.8 (the samples).
    for name, pole in (("slowest", 0.7), ("slowest_low", 0.6), ("slowest_high", 0.8)):
        np.testing.assert_allclose(back[name], -0.02 / np.log(pole))
    np.testing.assert_allclose(back["pole_real"][:, 0], 0.7)
    np.testing.assert_allclose(back["damping"][:, 0], 1.0)
    assert back["stable"].values.all() and back["stable_share"].values.tolist() == [1.0, 1.0]
    assert back.attrs["n_samples"] == 2 and back.attrs["input_name"] == "command"


def test_a_varying_model_stands_over_time_and_has_holes_where_its_equilibrium_ended(family, kept):
    exists = np.array(family.exists)
    exists[1] = False
    ended = replace(
        family,
        exists=exists,
        stable=exists,
        has_gain=exists,
        operating_outputs=np.where(exists, family.operating_outputs, np.nan),
    )
    back = kept(VaryingLinear(family=ended, timepts=np.array([10.0, 20.0])).to_xarray())
    assert float(back["static_gain"].sel(time=10.0)) == pytest.approx(1.0)
    assert np.isnan(float(back["static_gain"].sel(time=20.0))) and back["stable"].values.tolist() == [True, False]
    assert back["time"].attrs["units"] == "s" and back["operating_input"].values.tolist() == [1.0, 2.0]


def test_a_static_curve_has_its_points_and_slopes(kept):
    inputs = np.linspace(1.0, 3.0, 5)
    back = kept(StaticCurve(inputs=inputs, outputs=2.0 * inputs, input_unit="V", output_unit="m").to_xarray())
    assert float(back["output"].sel(input=2.0)) == 4.0 and back["output"].attrs["units"] == "m"
    np.testing.assert_allclose(back["slope"], 2.0)
    assert back["slope"].attrs["units"] == "m/V"


def test_margins_have_their_units_and_the_loop_its_frequencies(kept):
    gain = 0.5
    back = kept(band_margins(LAG, [gain], [1.0]).to_xarray())
    # -1 is reached at z = -1, where L = -gain 0.3/1.7.
    assert float(back["value"].sel(margin="gain")) == pytest.approx(1.7 / (0.3 * gain))
    assert back["unit"].values.tolist() == ["", "deg", "s", ""]
    loop = back["loop_real"].values + 1j * back["loop_imaginary"].values
    delayed = np.exp(-1j * back["omega"].values * 0.02)
    np.testing.assert_allclose(loop, gain * 0.3 * delayed / (1 - 0.7 * delayed), rtol=1e-9)
    assert back["omega"].attrs["units"] == "rad/s" and back.attrs["level"] == 0.95
    assert float(back["low"].sel(margin="gain")) < float(back["value"].sel(margin="gain"))


def relay(amplitude, omega):
    """Describing function of a relay of height 1."""
    return 4 / (np.pi * amplitude) + 0j * omega


@pytest.mark.parametrize("describing", [relay, lambda amplitude, omega: 1e-9 + 0j * amplitude * omega])
def test_limit_cycles_are_a_table_also_where_there_are_none(describing, kept):
    found = limit_cycles([0.0, 0.3], [1.0, -0.7], 0.02, describing, np.geomspace(1e-3, 10, 80), np.linspace(1, 157, 90))
    back = kept(found.to_xarray())
    assert back.attrs["n_cycles"] == len(found) == back["cycle_amplitude"].size
    assert back["cycle_amplitude"].values.tolist() == [one.amplitude for one in found]
    shift = np.exp(-1j * back["omega"].values * 0.02)
    np.testing.assert_allclose(back["loop_imaginary"], (0.3 * shift / (1 - 0.7 * shift)).imag, rtol=1e-9)
    expected = describing(back["amplitude"].values, np.zeros(back["amplitude"].size)).real
    np.testing.assert_allclose(back["describing_real"], expected)
