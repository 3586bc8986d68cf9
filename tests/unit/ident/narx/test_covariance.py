"""What is taken for a covariance of parameters, and what is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deatwin.ident.narx import NarxModel, OperatingRange, ThetaTrajectory
from deatwin.ident.narx.covariance import covariance_root, transformed
from deatwin.ident.narx.estimate import Ridge
from deatwin.ident.narx.linear import LinearModel
from deatwin.plant.errors import ModelError

EPS = np.finfo(float).eps
SEEDS = st.integers(0, 2**32 - 1)
TWO = NarxModel.from_terms({"y(k-1)": 0.6, "u(k-1)": 0.3}, sample_time=0.1)


def model_of(theta_cov, **details):
    n = len(theta_cov)
    return NarxModel.from_terms({f"u(k-{i})": 0.1 for i in range(n)}, sample_time=0.1, theta_cov=theta_cov, **details)


def normal_matrix(rng, n, condition):
    """P'P of that condition; its columns are of units 12 decades apart."""
    u = np.linalg.qr(rng.standard_normal((100, n)))[0] * np.geomspace(1.0, condition**-0.5, n)
    p = u @ np.linalg.qr(rng.standard_normal((n, n)))[0] * 10.0 ** rng.uniform(-6, 6, n)
    return p.T @ p


@settings(deadline=None)
@given(SEEDS, st.integers(1, 12), st.floats(0, 12))
def test_the_inverse_of_an_ill_conditioned_normal_matrix_is_one(seed, n, decades):
    rng = np.random.default_rng(seed)
    cov = np.linalg.inv(normal_matrix(rng, n, 10.0**decades))
    kept = model_of(cov).theta_cov
    np.testing.assert_array_equal(kept, kept.T)
    sizes = np.sqrt(np.diag(cov))
    np.testing.assert_allclose(kept / np.outer(sizes, sizes), cov / np.outer(sizes, sizes), rtol=0, atol=1e-3)


@settings(deadline=None)
@given(SEEDS, st.integers(1, 12), st.integers(1, 12))
def test_what_is_symmetric_stays_to_the_last_bit_and_through_the_file(tmp_path_factory, seed, n, rank):
    rng = np.random.default_rng(seed)
    root = 10.0 ** rng.uniform(-9, 9, (n, 1)) * rng.standard_normal((n, rank))
    model = model_of(root @ root.T)  # singular, if the rank is below n
    np.testing.assert_array_equal(model.theta_cov, root @ root.T)
    path = tmp_path_factory.getbasetemp() / "covariance.json"
    model.save(path)
    np.testing.assert_array_equal(NarxModel.load(path).theta_cov, model.theta_cov)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ([[1.0, 0.2], [0.1, 1.0]], "holds 0.2 for y(k-1) and u(k-1), but 0.1 for u(k-1) and y(k-1)"),
        ([[1.0, 0.0], [0.0, -1e-30]], "the variance of u(k-1) is -1e-30"),
        ([[0.0, 1e-9], [1e-9, 1.0]], "holds 1e-09 for y(k-1) and u(k-1), one of which has the variance 0"),
        ([[1.0, 1.5], [1.5, 1.0]], "its matrix of correlations has the negative eigenvalue -0.5 "),
        ([[1e-12, 2e-6], [2e-6, 1.0]], "its matrix of correlations has the negative eigenvalue -1 "),
    ],
)
def test_the_offender_is_named(wrong, says):
    with pytest.raises(ModelError) as caught:
        replace(TWO, theta_cov=np.array(wrong))
    assert says in str(caught.value)
    padded = np.zeros((3, 3))
    padded[:2, :2] = wrong
    with pytest.raises(ModelError, match="theta_cov is not a covariance"):
        LinearModel(a=[1.0, -0.6], b=[[0.0, 0.3]], sample_time=0.1, theta_cov=padded)


@pytest.mark.parametrize("name", ["noise_variance", "sample_time", "theta_dof"])
@pytest.mark.parametrize("value", [np.nan, -1.0, -np.inf, np.inf, "a", None, 1j, [1.0, 2.0]])
def test_other_numbers_that_cannot_be(name, value):
    if (name, value) == ("theta_dof", np.inf):  # those of a normal law
        return
    with pytest.raises(ModelError, match=name):
        replace(TWO, **{name: value})
    if name != "theta_dof":
        with pytest.raises(ModelError, match=name):
            LinearModel(a=[1.0, -0.6], b=[[0.0, 0.3]], **({"sample_time": 0.1} | {name: value}))


@settings(deadline=None)
@given(SEEDS, st.floats(0, 15))
def test_a_map_that_cancels_leaves_a_covariance(seed, decades):
    """As that to deviations from an operating point: the product J C J' itself is indefinite there."""
    rng = np.random.default_rng(seed)
    cov = np.linalg.inv(normal_matrix(rng, 4, 1e6))
    cov = 0.5 * (cov + cov.T)
    q = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    jacobian = q * np.geomspace(1.0, 10.0**-decades, 4) @ np.linalg.inv(covariance_root(cov))
    found = transformed(jacobian, cov)
    model_of(found)
    exact = q * np.geomspace(1.0, 10.0**-decades, 4)
    np.testing.assert_allclose(found, exact @ exact.T, atol=1e4 * 4**2 * EPS)  # the root is known to eps sqrt(kappa)


def test_ridge_that_leaves_nothing_for_the_noise_is_refused():
    rng = np.random.default_rng(2)
    with pytest.raises(ModelError, match="3 samples leave no freedom for noise at penalty = 1e-18"):
        Ridge(penalty=1e-18)(rng.standard_normal((5, 3)), rng.standard_normal(3))


@pytest.mark.parametrize(
    ("field", "wrong", "says"),
    [
        ("equations", (0, "a"), r"equations\[1\] = 'a'; it must be an integer of at least 0"),
        ("equations", 3, "equations must be a list or a tuple; got an int"),
        ("operating", 2.4, "operating must be an OperatingRange; got a float"),
        ("output_names", None, r"names and units of outputs must be texts; got \(None,\)"),
    ],
)
def test_fields_of_another_kind_are_refused(field, wrong, says):
    with pytest.raises(ModelError, match=says):
        replace(TWO, **{field: wrong})


RANGE = OperatingRange(
    input_min=-1.0, input_max=1.0, input_centre=0.0, output_min=[-2.0], output_max=[2.0], output_centre=[0.0]
)
TRAJECTORY = ThetaTrajectory(
    model=TWO, timepts=[0.0, 0.1], theta=np.ones((2, 2)), theta_cov=np.zeros((2, 2, 2)), drift_variance=[0.0, 0.0]
)


@pytest.mark.parametrize("wrong", ["a", 1j, [[1.0, 2.0], [1.0]], None])
@pytest.mark.parametrize(
    ("right", "field"),
    [(RANGE, "input_min"), (RANGE, "output_centre")]
    + [(TRAJECTORY, name) for name in ("timepts", "theta", "theta_cov", "drift_variance")],
)
def test_arrays_of_other_things_than_numbers_are_refused(right, field, wrong):
    with pytest.raises(ModelError, match=f"{field} must be (real numbers|an array of real numbers)"):
        replace(right, **{field: wrong})
