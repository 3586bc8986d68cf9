"""Cascades against blocks that are known."""

import numpy as np
import pytest
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


def test_a_static_function_may_be_a_spline():
    u = np.random.default_rng(2).normal(size=800)
    y = np.maximum(lfilter(*FIRST, u), 0.0)
    fitted = Cascade(structure="LN", shape=["hinge(v,-0.5)", "hinge(v,0)", "hinge(v,0.5)", "|v|"])
    assert fitted.fit(Recording.from_arrays(u, y, 0.1)).error_ < 0.05 * fitted.linear_error_


def test_a_function_with_the_letter_of_the_signal_in_its_name_keeps_its_name():
    register_function("overbent", np.tanh)
    u = np.random.default_rng(3).normal(size=400)
    y = np.tanh(lfilter([0.5], [1.0, -0.6], u))
    fitted = Cascade(structure="LN", states=1, shape=["overbent(v)"]).fit(Recording.from_arrays(u, y, 0.1))
    assert "overbent(s1)" in fitted.model_.terms


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"structure": "LL"}, "one of NL, LN, NLN, LNL"),
        ({"structure": "LNL", "states": 1}, "at least 2"),
        ({"shape": ["u^2"]}, "must hold v"),
        ({"shape": ["curved(u)"]}, "must hold v"),
    ],
)
def test_what_is_no_cascade_is_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        Cascade(**arguments).fit(Recording.from_arrays(np.sin(np.arange(100.0)), np.cos(np.arange(100.0)), 0.1))


def test_two_inputs_are_refused():
    with pytest.raises(ModelError, match="use Pnlss"):
        Cascade().fit(Recording.from_arrays(np.random.default_rng(0).normal(size=(2, 90)), np.arange(90.0), 0.1))
