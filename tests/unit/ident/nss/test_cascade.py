"""Cascades against blocks that are known."""

import numpy as np
import pytest
from new_readings import require_hold, require_share
from scipy.signal import lfilter

from deatwin.ident.narx import register_function
from deatwin.ident.nss import Cascade
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

FIRST, SECOND = ([0.3, 0.2], [1.0, -1.2, 0.6]), ([0.5, 0.1], [1.0, -0.7])


def bent(v):
    return v + 0.4 * v**2 - 0.1 * v**3


MADE = {
    "NL": lambda u: lfilter(*FIRST, bent(u)),
    "LN": lambda u: bent(lfilter(*FIRST, u)),
    "NLN": lambda u: bent(0.5 * lfilter(*FIRST, bent(u))),
    "LNL": lambda u: lfilter(*SECOND, bent(lfilter(*FIRST, u))),
}


@pytest.mark.parametrize("structure", MADE)
def test_a_known_cascade_is_recovered(structure):
    rng = np.random.default_rng(1)
    u, other = rng.normal(size=(2, 1000))
    states = 3 if structure == "LNL" else 2
    fitted = Cascade(structure=structure, states=states).fit(Recording.from_arrays(u, MADE[structure](u), 0.1))
    y = MADE[structure](other)
    assert fitted.model_.simulate(Recording.from_arrays(other, y, 0.1)).rms_error < 1e-6 * y.std()
    poles = np.roots(FIRST[1]) if states == 2 else [*np.roots(FIRST[1]), 0.7]
    np.testing.assert_allclose(np.sort_complex(fitted.model_.poles), np.sort_complex(poles), atol=1e-6)
    assert fitted.error_ < 1e-6 < 0.1 * fitted.linear_error_


def noisy(rng, structure, n):
    u = rng.normal(size=n)
    return Recording.from_arrays(u, MADE[structure](u) + 0.1 * rng.normal(size=n), 0.1)


@pytest.mark.parametrize("structure", MADE)
@pytest.mark.parametrize("sets", [8, pytest.param(200, marks=pytest.mark.study)])
def test_bands_and_intervals_hold_what_they_say(structure, sets):
    # The coefficients of the characteristic polynomial do not depend on the coordinates of the states.
    rng, bands, held = np.random.default_rng(5), [], []
    known = [FIRST[1], SECOND[1]] if structure == "LNL" else [FIRST[1]]
    true = np.poly(np.concatenate([np.roots(poles) for poles in known])).real[1:]
    for _ in range(sets):
        model = Cascade(structure=structure, states=true.size).fit(noisy(rng, structure, 300)).model_
        bands.append(model.free_run_band(noisy(rng, structure, 100)))
        found, deviations = characteristic(model)
        held.append(np.abs(found - true) < 1.959964 * deviations)
    require_hold(bands)
    print(f"intervals {100 * np.mean(held):.1f} %")
    for count in np.sum(held, axis=0):
        require_share(count, sets)


def characteristic(model, step=1e-6):
    """Return the coefficients of the characteristic polynomial and their standard deviations, to first order."""
    theta = model.theta

    def at(theta):
        return np.poly(model.system.with_theta(theta).linear_parts[0]).real[1:]

    slopes = np.array([at(theta + shift) - at(theta - shift) for shift in step * np.eye(theta.size)]).T / (2 * step)
    return at(theta), np.sqrt(np.diag(slopes @ model.theta_cov @ slopes.T))


def test_equal_lags_before_and_behind_the_function_are_divided():
    # A double pole of the best linear approximation is estimated as two real poles or as a conjugate pair.
    rng = np.random.default_rng(3)
    for _ in range(6):
        u = rng.normal(size=500)
        y = lfilter([0.3], [1.0, -0.7], bent(lfilter([0.5, 0.1], [1.0, -0.7], u)))
        noise = 0.02 * y.std()
        fitted = Cascade(structure="LNL", states=2).fit(Recording.from_arrays(u, y + noise * rng.normal(size=500), 0.1))
        assert fitted.error_[0] < 1.2 * noise  # 500 readings tell a deviation within 3 %


def test_a_static_function_may_be_a_spline():
    u = np.random.default_rng(2).normal(size=800)
    y = np.maximum(lfilter(*FIRST, u), 0.0)
    fitted = Cascade(structure="LN", shape=["hinge(v,-0.5)", "hinge(v,0)", "hinge(v,0.5)", "|v|"])
    assert fitted.fit(Recording.from_arrays(u, y, 0.1)).error_ < 0.05 * fitted.linear_error_


def test_a_function_with_the_letter_of_the_signal_in_its_name_keeps_its_name():
    register_function("overbent", np.tanh)
    u = np.random.default_rng(3).normal(size=200)
    y = np.tanh(lfilter([0.5], [1.0, -0.6], u))
    fitted = Cascade(structure="LN", states=1, shape=["overbent(v)"] * 2).fit(Recording.from_arrays(u, y, 0.1))
    assert fitted.model_.terms.count("overbent(s1)") == 1  # a term that is given twice is one term


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"structure": "LL"}, "one of NL, LN, NLN, LNL"),
        ({"structure": "LNL", "states": 1}, "at least 2"),
        ({"shape": ["u^2"]}, "must hold v"),
        ({"shape": ["curved(u)"]}, "must hold v"),
        ({"shape": [3]}, "the term 3 of a static function must hold v"),
        ({"shape": "v^2"}, "give a list"),
        ({"shape": None}, "give a list"),
    ],
)
def test_what_is_no_cascade_is_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        Cascade(**arguments).fit(Recording.from_arrays(np.sin(np.arange(100.0)), np.cos(np.arange(100.0)), 0.1))


def test_two_inputs_are_refused():
    with pytest.raises(ModelError, match="use Pnlss"):
        Cascade().fit(Recording.from_arrays(np.random.default_rng(0).normal(size=(2, 90)), np.arange(90.0), 0.1))
