"""Models of several outputs and of noise terms: prediction, free run, file, and estimators of several outputs."""

import numpy as np
import pytest

from deatwin.ident.narx import Frols, Grow, NarxModel, NarxResponse, Semp, SvbNarx
from deatwin.ident.narx.lasso import Lasso
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

COUPLED = {
    "y1": {"y1(k-1)": 0.5, "y2(k-2)": 0.2, "u(k-1)": 1.0},
    "y2": {"y2(k-1)": -0.3, "y1(k-1)u(k-1)": 0.4, "u(k)^2": 0.2},
}
MOVING_AVERAGE = {"y(k-1)": 0.6, "u(k-1)": 1.0, "e(k-1)": 0.5, "u(k-1)e(k-2)": -0.3}


def coupled(u, noise):
    """Run COUPLED with noise in the equations, written out."""
    y = np.zeros((2, u.size))
    for k in range(2, u.size):
        y[0, k] = 0.5 * y[0, k - 1] + 0.2 * y[1, k - 2] + u[k - 1] + noise[0, k]
        y[1, k] = -0.3 * y[1, k - 1] + 0.4 * y[0, k - 1] * u[k - 1] + 0.2 * u[k] ** 2 + noise[1, k]
    return y


def moving_average(u, e):
    """Run MOVING_AVERAGE, written out."""
    y = np.zeros(u.size)
    for k in range(2, u.size):
        y[k] = 0.6 * y[k - 1] + u[k - 1] + 0.5 * e[k - 1] - 0.3 * u[k - 1] * e[k - 2] + e[k]
    return y


def test_prediction_runs_the_noise_along_and_the_free_run_does_without():
    rng = np.random.default_rng(1)
    u, e = rng.uniform(-1, 1, 400), 0.2 * rng.normal(size=400)
    e[:2] = 0
    recording = Recording.from_arrays(u, moving_average(u, e), 1.0)
    model = NarxModel.from_terms(MOVING_AVERAGE, sample_time=1.0)
    np.testing.assert_allclose(model.predict(recording).residuals[0], e[2:], atol=1e-13)
    quiet = moving_average(u, np.zeros(400))
    np.testing.assert_allclose(model.simulate(recording).outputs[0], quiet, atol=1e-13)
    assert [str(term) for term in model.deterministic.terms] == ["y(k-1)", "u(k-1)"]


@pytest.mark.parametrize("identifier", [Frols(), SvbNarx(), Grow(), Semp(), Lasso()], ids=repr)
def test_estimators_find_every_equation(identifier):
    rng = np.random.default_rng(2)
    u = rng.uniform(-1, 1, 1000)
    noise = 0.01 * rng.normal(size=(2, 1000))
    fitted = identifier.fit(Recording.from_arrays(u, coupled(u, noise), 1.0, output_units=["m", "N"]))
    wanted = NarxModel.from_terms(COUPLED, sample_time=1.0)
    # an input lag of 0 is no candidate here: that term is replaced by others, so that only the first is exact
    first = {str(t) for t, row in zip(fitted.model_.terms, fitted.model_.equations, strict=True) if row == 0}
    assert {"y1(k-1)", "y2(k-2)", "u(k-1)"} <= first
    assert len(fitted.equations_) == 2 and fitted.model_.n_outputs == 2
    again = type(identifier)(input_lags=range(3)).fit(Recording.from_arrays(u, coupled(u, noise), 1.0))
    found = dict(zip(zip(again.model_.equations, again.model_.terms, strict=True), again.model_.theta, strict=True))
    error = np.sqrt(np.diag(again.model_.theta_cov))
    worst = dict(zip(found, error, strict=True))
    for row, term, value in zip(wanted.equations, wanted.terms, wanted.theta, strict=True):
        assert abs(found[row, term] - value) < 5 * worst[row, term]  # five standard deviations: 6e-7 each
    np.testing.assert_allclose(np.sqrt(again.model_.noise_variance), [0.01, 0.01], rtol=0.1)


def test_what_does_not_fit_together_is_refused():
    with pytest.raises(ModelError, match="a mapping of terms for each of y1, y2"):
        NarxModel.from_terms({"y1": {"y1(k-1)": 0.5}, "y(k-1)": 1.0}, sample_time=1.0)
    with pytest.raises(ModelError, match="3 outputs, but 2 are named"):
        NarxModel.from_terms({"y1": {"y3(k-1)": 0.5}, "y2": {"u(k)": 1.0}}, sample_time=1.0)
    with pytest.raises(ModelError, match="noise at the present sample"):
        NarxModel.from_terms({"e(k)": 0.5}, sample_time=1.0)
    one = NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=1.0)
    with pytest.raises(ModelError, match="one model for each output"):
        NarxModel.joined([one, one])
    with pytest.raises(ModelError, match="one output; this one has 2"):
        NarxModel.from_terms(COUPLED, sample_time=1.0).require_one_output("frequency analysis")
    with pytest.raises(ModelError, match="without noise terms"):
        NarxModel.from_terms(MOVING_AVERAGE, sample_time=1.0).require_one_output("frequency analysis")


@pytest.mark.parametrize(("noise", "said"), [(0.05, True), (0.001, False)])
def test_products_of_noisy_outputs_are_warned_of(noise, said):
    """Two coupled oscillators with one true product: at 5 % of noise least squares makes up false ones, at 0.1 % none."""
    rng = np.random.default_rng(3)
    u, y = rng.uniform(-1, 1, 1500), np.zeros((2, 1500))
    for k in range(2, 1500):
        y[0, k] = 1.5 * y[0, k - 1] - 0.8 * y[0, k - 2] + 0.1 * y[1, k - 1] + u[k - 1]
        y[1, k] = 1.2 * y[1, k - 1] - 0.6 * y[1, k - 2] + 0.1 * y[0, k - 1] + 0.05 * y[0, k - 1] * u[k - 1]
    seen = y + noise * y.std(axis=1, keepdims=True) * rng.normal(size=y.shape)
    notes = Frols().fit(Recording.from_arrays(u, seen, 0.1)).notes_
    assert any("may describe the bias" in note for note in notes) is said


def test_an_error_has_one_unit():
    """Residuals of 3 and 4 m, and of 1000 K: the rms in m is the root of 12.5 m²."""
    measured = np.array([[3.0], [1000.0], [4.0]])
    response = NarxResponse(
        outputs=np.zeros((3, 1)), measured=measured, timepts=np.zeros(1), first=0, units=("m", "K", "m")
    )
    assert response.rms_error == pytest.approx(np.sqrt(12.5))
