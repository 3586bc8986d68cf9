"""What the results of the frequency domain share: copies, some of their points, one law of bands, files, errors."""

import copy
import math
import pickle
import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_narx import trajectory_of
from scipy import stats

from deatwin.ident.frequency import frequency_grid, gfrf, output_orders, output_spectrum
from deatwin.ident.frequency.uncertainty.beside_draws import sample
from deatwin.ident.frequency.uncertainty.propagate import UncertaintyStatus, propagate
from deatwin.ident.frequency.varying.along_time import tv_gfrf, tv_nofrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.linear import LinearModel
from deatwin.plant.errors import ModelError

OMEGA = 2 * np.pi * np.array([0.5, 1.5, 4.0])
TERMS = {"y(k-1)": 0.5, "y(k-2)^2": -0.2, "y(k-1)u(k-1)": 0.15, "u(k-1)": 0.4, "u(k-2)^3": 0.1}
ROOT = 1e-3 * np.random.default_rng(3).normal(size=(5, 5))
MODEL = NarxModel.from_terms(TERMS, sample_time=0.02, theta_cov=ROOT @ ROOT.T, input_units=("V",), output_units=("m",))
LINEAR = LinearModel(a=[1, -0.4], b=[[0, 0.3, 0.2]], sample_time=0.02, theta_cov=1e-4 * np.eye(4))
PERIOD = np.cos(2 * np.pi * np.arange(16) * 2 / 16)
H_1, CUBE = partial(gfrf, order=1, omega=OMEGA), partial(gfrf, order=3, omega=frequency_grid(OMEGA, OMEGA, OMEGA))
TRAJECTORY = trajectory_of(
    MODEL,
    np.arange(4.0),
    MODEL.theta[:, None] * (1 + 0.01 * np.arange(4.0)),
    theta_cov=np.stack([MODEL.theta_cov] * 4),
    log_likelihood=None,
)


def held(model):
    return CUBE(model).at_points(np.arange(1, 27, 3))


def made():
    """One result of each kind."""
    return {
        "H": H_1(MODEL),
        "slice": held(MODEL),
        "Y": output_spectrum(MODEL, PERIOD, 2),
        "some lines of Y": output_spectrum(MODEL, PERIOD, 2).at_points(np.arange(3)),
        "propagated": propagate(MODEL, H_1),
        "sampled": sample(MODEL, H_1, np.random.default_rng(0), 20),
        "H along time": tv_gfrf(TRAJECTORY, 2, np.c_[OMEGA, OMEGA]),
        "G along time": tv_nofrf(TRAJECTORY, PERIOD, 2),
    }


@pytest.mark.parametrize("again", [copy.deepcopy, lambda result: pickle.loads(pickle.dumps(result))])
def test_a_copy_says_the_same_and_is_as_read_only(again):
    for name, result in made().items():
        found = again(result)
        for item in ("values", "covariance", "omega", "frozen_correction", "draws", "nonlinearity", "timepts"):
            if hasattr(result, item):
                array = getattr(found, item)
                np.testing.assert_array_equal(array, getattr(result, item), err_msg=f"{item} of {name}")
                assert not array.flags.writeable, f"{item} of {name}"
        assert found.band is not None if hasattr(result, "band") else found.gain_band() is not None


# Some of the points


@pytest.mark.parametrize(
    "quantity", [CUBE, partial(output_spectrum, excitation=PERIOD, order=3), lambda m: output_orders(m, PERIOD, 2)[1]]
)
def test_some_points_are_those_of_all(quantity):
    whole, chosen = quantity(MODEL), np.array([True, False, True] * 3)
    chosen = np.resize(chosen, whole.values.size)
    some, thetas = whole.at_points(chosen), MODEL.theta * np.array([[1.0], [1.01]])
    np.testing.assert_array_equal(some.values, whole.values[chosen])
    np.testing.assert_array_equal(some.omega, whole.omega[chosen])
    np.testing.assert_allclose(some.gradient, whole.gradient[chosen], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        some.evaluate(thetas).values, whole.evaluate(thetas).values[:, chosen], rtol=1e-12, atol=1e-15
    )
    twice = some.at_points(slice(1, None))
    np.testing.assert_allclose(twice.gradient, whole.gradient[chosen][1:], rtol=1e-12, atol=1e-15)


def test_a_slice_derives_at_its_own_points_only():
    cube = CUBE(MODEL)
    plane = cube.at_points(np.arange(1, 27, 3))
    assert plane.gradient.shape == (9, 5) and plane.covariance.shape == (9, 2, 2)
    assert "gradient" not in vars(cube)  # where it is kept once it is known


def test_an_evaluation_at_other_points_is_one_clear_error():
    wrong = replace(H_1(MODEL), evaluate=CUBE(MODEL).evaluate)
    with pytest.raises(ModelError, match=r"has 3 points, but at 64 parameters .* \(64, 27\); .* at_points"):
        propagate(MODEL, lambda model: wrong)


# One law for one question


@pytest.mark.parametrize("dof", [2.05, 7.0, math.inf])
def test_a_band_is_the_same_whoever_is_asked(dof):
    """Half a width in standard deviations: the quantile of the Student-t law by the root of its variance."""
    model = replace(MODEL, theta_dof=dof)
    law = stats.t(dof) if math.isfinite(dof) else stats.norm()
    half = law.ppf(0.975) / law.std() * H_1(model).gain_deviation
    propagated, along = propagate(model, H_1), tv_gfrf(replace(TRAJECTORY, model=model), 1, OMEGA)
    for band in (H_1(model).band(), propagated.gain_band()):
        np.testing.assert_allclose((band.high - band.low) / 2, half, rtol=1e-6)
    np.testing.assert_allclose(along.band().high[0], H_1(along.models[0]).band().high, rtol=1e-12)
    assert along.models[0].theta_dof == dof


def test_rounding_is_no_bend():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for size in (1e-40, 1e-32, 1e-26, 1e-16):
            for quantity in (H_1, CUBE, partial(output_spectrum, excitation=PERIOD, order=3)):
                found = propagate(replace(MODEL, theta_cov=size * np.eye(5)), quantity)
                assert found.linear_law.all()
    assert found.status is not UncertaintyStatus.LOST


def test_what_needs_too_much_memory_is_refused_with_advice():
    many = partial(gfrf, order=1, omega=np.linspace(0.1, 100.0, 25_001))
    with pytest.raises(ModelError, match=r"7\.45 GiB, more than 2 GiB, .* take fewer, or fewer frequencies"):
        sample(MODEL, many, np.random.default_rng(0), 20_000)


# Errors


def test_raw_errors_are_model_errors():
    found, rng = propagate(MODEL, H_1), np.random.default_rng(0)
    cases = [
        ("LinearModel is not a NarxModel; to_narx", lambda: gfrf(LINEAR, 1, OMEGA)),
        ("LinearModel is not a NarxModel; to_narx", lambda: output_spectrum(LINEAR, PERIOD, 1)),
        ("level must be real numbers; got text", lambda: propagate(MODEL, H_1, level="a")),
        ("level must be real numbers; got text", lambda: H_1(MODEL).band("a")),
        ("level = 95", lambda: propagate(MODEL, H_1, level=95)),
        ("level = 2", lambda: sample(MODEL, H_1, rng, 10).gain_band(2.0)),
        ("level = 0", lambda: found.ellipse(0.0)),
        ("n_points = -3", lambda: found.ellipse(n_points=-3)),
        ("quantity = None", lambda: propagate(MODEL, None)),
        ("ndarray; it must return a FrequencyResponse", lambda: propagate(MODEL, lambda m: H_1(m).values)),
        ("n_draws = 1", lambda: sample(MODEL, H_1, rng, 1)),
        ("n_draws = 2.5", lambda: sample(MODEL, H_1, rng, 2.5)),
        ("n_draws = 'a'", lambda: sample(MODEL, H_1, rng, "a")),
        ("rng = None", lambda: sample(MODEL, H_1, None)),
        ("rng = 0", lambda: sample(MODEL, H_1, 0)),
        ("one for each of the 3 frequencies", lambda: found.contains([1, 2])),
        ("other holds str", lambda: found.contains("a")),
    ]
    for message, act in cases:
        with pytest.raises(ModelError, match=message):
            act()


# Drawings and files


def test_labels_stay_on_the_figure_and_raise_powers():
    axes = H_1(MODEL).plot()
    axes.figure.canvas.draw()
    assert axes.yaxis.label.get_window_extent().x0 >= 0 and axes.xaxis.label.get_window_extent().y0 >= 0
    assert tv_gfrf(TRAJECTORY, 2, np.c_[OMEGA, OMEGA]).plot().figure.axes[1].get_ylabel() == "$|H_2|$ (m/V$^2$)"


def test_points_that_do_not_belong_together_are_not_joined():
    grid = propagate(MODEL, partial(gfrf, order=2, omega=frequency_grid(OMEGA, OMEGA)))
    lines = propagate(MODEL, partial(output_spectrum, excitation=PERIOD, order=2))
    for drawn in (grid.plot(), lines.plot()):
        assert drawn.lines[0].get_linestyle() == "None"
    there = lines.gain > 1e-10 * lines.gain.max()
    assert not there.all() and len(lines.plot().collections[0].get_segments()) == there.sum()


def test_files_keep_what_is_in_them(tmp_path):
    xarray = pytest.importorskip("xarray")
    for name, result in made().items():
        written = result.to_xarray()
        written.to_netcdf(tmp_path / "file.nc", engine="scipy")
        with xarray.open_dataset(tmp_path / "file.nc", engine="scipy") as read:
            xarray.testing.assert_equal(read, written)
            for key, value in written.attrs.items():
                assert type(value)(read.attrs[key]) == value, f"{key} of {name}"
            assert read["frequency_Hz"].attrs["units"] == "Hz"
            np.testing.assert_allclose(2 * np.pi * read["frequency_Hz"], result.omega, rtol=1e-15)
            np.testing.assert_array_equal(read["real"] + 1j * read["imaginary"], result.values, err_msg=name)
            np.testing.assert_array_equal(read["covariance"], result.covariance, err_msg=name)
            if name == "H":
                assert (read["real"].attrs["units"], read["covariance"].attrs["units"]) == ("m/V", "(m/V)^2")
    along = made()["H along time"].to_xarray()
    for key, unit in (("equilibrium", "m"), ("equilibrium_std", "m"), ("operating_input", "V")):
        assert along[key].attrs["units"] == unit
