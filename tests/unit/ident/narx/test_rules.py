"""Rules that drop candidate terms."""

import pytest

from deatwin.ident.narx import Frols, generate_terms
from deatwin.ident.narx.rules import AtMost
from deatwin.plant.errors import ModelError


def texts(rule, degree=2, **lags):
    return [str(term) for term in generate_terms(2, 1, degree, rule=rule, **lags)]


@pytest.mark.parametrize(
    ("rule", "dropped"),
    [
        (AtMost(output=1), {"y(k-1)^2", "y(k-1)y(k-2)", "y(k-2)^2"}),
        (AtMost(input=0), {"u(k-1)", "y(k-1)u(k-1)", "y(k-2)u(k-1)", "u(k-1)^2"}),
    ],
)
def test_a_rule_drops_what_it_says(rule, dropped):
    every, kept = texts(None), texts(rule)
    assert set(every) - set(kept) == dropped and kept == [text for text in every if text not in dropped]


def test_noise_of_low_degree_only():
    kept = texts(AtMost(noise=1), noise_lags=1)
    assert "y(k-1)e(k-1)" in kept and "e(k-1)^2" not in kept


def test_a_rule_that_leaves_nothing_and_one_that_prints():
    with pytest.raises(ModelError, match="leaves none of 10"):
        texts(lambda term: False)
    assert "AtMost(output=1, input=None, noise=None)" in repr(Frols(rule=AtMost(output=1)))
