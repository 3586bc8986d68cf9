"""Rules that drop candidate terms."""

import pytest

from deatwin.ident.narx import Frols, generate_terms
from deatwin.ident.narx.rules import AtMost
from deatwin.plant.errors import ModelError


def texts(rule):
    return [str(term) for term in generate_terms(2, 1, 2, rule=rule)]


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


def test_a_rule_that_leaves_nothing_and_one_that_prints():
    with pytest.raises(ModelError, match="leaves none of 10"):
        texts(lambda term: False)
    assert "AtMost(output=1, input=None)" in repr(Frols(rule=AtMost(output=1)))
