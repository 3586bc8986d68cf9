"""One explanation after another is verified until one stands; what verification says is given here."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.verify import verify as verifying


def known(*effects: str, rms: float, given_up: bool = False) -> SimpleNamespace:
    fit = SimpleNamespace(given_up=given_up, at_bound=())
    return SimpleNamespace(effects=effects, calibration=fit, losses=np.full(200, rms**2), noise=2.0)


BASE, PAIR = known(rms=10.0), known("creep", "delay", rms=2.1)
OTHER = known("delay", "hysteresis", rms=2.1)


@pytest.mark.parametrize(
    ("alone", "alternatives", "doubted", "spared"),
    [
        (known("creep", rms=3.0), (), ["delay"], True),
        (known("creep", rms=3.0), (), [], False),
        (known("creep", rms=3.0, given_up=True), (OTHER,), ["delay"], False),  # how well it does is not known
        (known("creep", rms=8.0), (OTHER,), ["delay"], False),  # of 10^2 - 2^2 it takes 36: not most
        (known("hysteresis", rms=3.0), (OTHER,), ["delay"], False),
        (known("creep", rms=3.0), (), ["delay", "creep"], False),  # delay alone was not tried
    ],
)
def test_what_stands_without_an_effect_that_unseen_data_do_not_show(alone, alternatives, doubted, spared):
    naming = Naming(
        candidates=(BASE, alone, PAIR, OTHER),
        best=PAIR,
        alternatives=alternatives,
        probabilities={PAIR.effects: 1.0},
        noise=2.0,
    )
    found = verifying._without_doubted(naming, SimpleNamespace(doubted=doubted, perhaps_absent=()))
    assert found == [alone] * spared


def test_a_rival_that_the_naming_has_already_stands_whatever_it_takes():
    alone = known("creep", rms=8.0)
    naming = Naming(candidates=(BASE, alone, PAIR), best=PAIR, alternatives=(alone,), probabilities={}, noise=2.0)
    assert verifying._without_doubted(naming, SimpleNamespace(doubted=["delay"], perhaps_absent=())) == [alone]
    assert verifying._without_doubted(replace(naming, best=None), SimpleNamespace(doubted=[], perhaps_absent=())) == []


def test_without_an_effect_that_may_be_absent_any_values_of_the_rig_are_possible(monkeypatch):
    """Where removal of the effect hardly raises the error, values beyond the rig's ranges refute what is left."""
    alone = known("creep", rms=3.0)
    naming = Naming(candidates=(BASE, alone, PAIR), best=PAIR, alternatives=(), probabilities={}, noise=2.0)
    monkeypatch.setattr(verifying, "held_back_by", lambda candidate: ("shear_modulus",))
    for absent, spared in ((("delay",), [alone]), ((), [])):
        assert verifying._without_doubted(naming, SimpleNamespace(doubted=["delay"], perhaps_absent=absent)) == spared


ALONE = known("creep", rms=2.2)


def first_that_stands(monkeypatch, several: list[Naming], **said: list) -> tuple[Naming, SimpleNamespace, bool]:
    """What verification says of one explanation after another is given."""
    each = zip(*said.values(), strict=True)
    verified = iter([SimpleNamespace(perhaps_absent=(), **dict(zip(said, one, strict=True))) for one in each])
    monkeypatch.setattr(verifying, "verify", lambda *_: next(verified))
    return verifying.first_that_stands(iter(several), None, np.random.default_rng(0), lambda text: None)


def named_by(best: SimpleNamespace | None, *alternatives: SimpleNamespace) -> Naming:
    chances = {c.effects: 0.5 for c in (best, *alternatives) if c is not None}
    return Naming(
        candidates=(BASE, ALONE, PAIR), best=best, alternatives=alternatives, probabilities=chances, noise=2.0
    )


@pytest.mark.parametrize(("stand", "answer"), [([True], ALONE), ([False, True], PAIR), ([False, False], ALONE)])
def test_where_an_explanation_is_refuted_the_next_one_is_verified(monkeypatch, stand, answer):
    """And where that is refuted, too, the first one is what was found."""
    several = [named_by(ALONE), named_by(PAIR)]
    naming, verification, stands = first_that_stands(monkeypatch, several, holds=stand, doubted=[()] * len(stand))
    assert naming.best is answer
    assert verification.holds is stands is stand[stand.index(True) if True in stand else 0]


def test_what_was_refuted_is_no_rival_of_the_next_and_nothing_that_it_could_be_spared_for(monkeypatch):
    several = [named_by(ALONE), named_by(PAIR, ALONE, OTHER)]
    naming, _, stands = first_that_stands(monkeypatch, several, holds=[False, True], doubted=[(), ()])
    assert stands and naming.alternatives == (OTHER,)
    assert naming.probabilities == {PAIR.effects: 0.5, OTHER.effects: 0.5}
    # without the delay, of which held-out data are not certain, the refuted creep is left
    assert verifying._without_doubted(several[1], SimpleNamespace(doubted=["delay"], perhaps_absent=())) == [ALONE]
    _, _, stands = first_that_stands(monkeypatch, several, holds=[False, False], doubted=[(), ("delay",)])
    assert not stands
    # what was refuted in one form of the plant was not in another one
    elsewhere = [replace(several[0], candidates=(known(rms=9.0), ALONE)), several[1]]
    assert first_that_stands(monkeypatch, elsewhere, holds=[False, True], doubted=[(), ()])[0] is several[1]


def test_what_was_tried_since_a_refuted_explanation_is_known(monkeypatch):
    """Also where it was in vain, but of the same form of the plant only."""
    first = replace(named_by(ALONE), candidates=(BASE, known("creep", rms=2.3), OTHER), failed=("mullins", "leakage"))
    later = replace(named_by(None), failed=("mullins",))  # another look at the leakage was not in vain
    naming, _, stands = first_that_stands(monkeypatch, [first, later], holds=[False], doubted=[()])
    assert not stands and naming.best is ALONE
    assert naming.candidates == (BASE, ALONE, PAIR, OTHER)  # the creep as it was fitted last
    assert naming.failed == ("mullins",)
    elsewhere = replace(later, candidates=(known(rms=9.0), PAIR))
    assert first_that_stands(monkeypatch, [first, elsewhere], holds=[False], doubted=[()])[0] is first


def test_what_stands_without_a_doubted_effect_is_as_likely_as_with_it(monkeypatch):
    """The evidence of the one with both says nothing of which law is right."""
    naming, _, stands = first_that_stands(monkeypatch, [named_by(PAIR)], holds=[False], doubted=[("delay",)])
    assert stands
    assert naming.alternatives == (ALONE,)
    assert naming.probabilities[PAIR.effects] == naming.probabilities[ALONE.effects]
