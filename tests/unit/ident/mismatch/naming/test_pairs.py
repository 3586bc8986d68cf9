"""A second effect beside one that suffices, on residuals of given sizes: 2 µm of noise, 1.2 µm of model error."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import FitStatus
from deatwin.ident.mismatch.naming import name
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.pairs import with_a_second
from deatwin.ident.mismatch.naming.sets import Search

NOISE, RIG = 2.0, SimpleNamespace(model_error=1.2)
CLIP, CREEP, PAIR = ("amplifier_saturation",), ("creep",), ("amplifier_saturation", "creep")


@pytest.fixture(autouse=True)
def no_simulation(monkeypatch):
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)


def candidate(effects: tuple[str, ...], rms: float, unseen: float | None = None) -> Candidate:
    """An explanation that leaves residuals of exactly these sizes on the fitted and on the unseen part."""
    fitted, late = np.tile([rms, -rms], 3500), np.tile([unseen or rms, -(unseen or rms)], 1500)
    calibration = SimpleNamespace(
        plant=SimpleNamespace(rig=RIG, effects=()), residuals=fitted, names=("a",) * (7 + len(effects)),
        status=FitStatus.SETTLED, rms=rms,
    )  # fmt: skip
    does = np.full(fitted.size, np.inf)
    return Candidate(effects=effects, calibration=calibration, unseen=late, noise=NOISE, contribution=does)


class Known(Search):
    """A search that finds what is given: a pair beside the first effect, others in that one's place, better fits."""

    def __init__(
        self, *candidates: Candidate, replaced: tuple[Candidate, ...] = (), better: tuple[Candidate, ...] = ()
    ) -> None:
        super().__init__(SimpleNamespace(effects=(), jobs=1), candidates[0], ())
        self.tried.update({c.effects: c for c in (*candidates, *replaced)})
        self.pair, self.asked = PAIR, 0
        self.others, self.better = [c.effects for c in replaced], {c.effects: c for c in better}

    def beside(self, names, finished=None):
        self.asked += 1
        return [PAIR]

    def fit_from(self, full, rest):
        assert full == self.pair
        self.tried[rest] = self.better.get(rest, self.tried[rest])

    def replacing(self, before, best):
        assert (before, best) == (CLIP, self.pair)
        return self.others


def decided(search: Search) -> Naming:
    """The decision over the clipping alone, and over a second effect beside it."""
    first = search.tried[CLIP]
    alone = Naming(
        candidates=tuple(search.tried.values()), best=first, rivals=(), probabilities={CLIP: 1.0}, noise=NOISE
    )
    return with_a_second(search, alone)


def test_a_second_effect_with_a_part_of_its_own_is_named_beside_one_that_suffices():
    # of 5² - 2² = 21 creep takes 3² - 2.2² = 4.2: more than a tenth, and more than 1.2²; alone 3.8, far from most
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(PAIR, 2.2))
    naming = decided(search)
    assert naming.best is search.tried[PAIR]
    assert naming.rivals == ()


def test_two_that_take_most_alone_are_two_where_less_than_half_of_it_is_in_common():
    # 14.1 and 16 of 21 alone, 20.2 together: 9.9 in common
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 3.3), candidate(PAIR, 2.2))
    assert decided(search).best is search.tried[PAIR]


def test_one_that_counts_for_less_than_the_floor_leaves_the_first_alone_a_rival():
    # of 3.5² - 2² = 8.25 it takes 2.4² - 2.15² = 1.14: more than a tenth and half of 1.2², less than the whole
    search = Known(candidate((), 3.5), candidate(CLIP, 2.4), candidate(CREEP, 3.3), candidate(PAIR, 2.15))
    naming = decided(search)
    assert naming.best is search.tried[PAIR]
    assert naming.rivals == (search.tried[CLIP],)
    assert naming.probabilities[CLIP] == naming.probabilities[PAIR]


def test_what_acts_as_well_in_the_place_of_the_second_is_a_rival():
    other = candidate(("amplifier_saturation", "dielectric_absorption"), 2.205)
    lost = candidate(("amplifier_saturation", "sensor_drift"), 2.9)
    search = Known(
        candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(("dielectric_absorption",), 4.6),
        candidate(("sensor_drift",), 4.6), candidate(PAIR, 2.2), replaced=(other, lost),
    )  # fmt: skip
    assert decided(search).rivals == (other,)


@pytest.mark.parametrize(
    ("base", "clip", "creep", "pair", "why"),
    [
        (5.0, (3.0, 3.0), 3.1, (2.2, 2.2), "15.4 and 16 of 21 alone, 20.2 together: 11.2 in common"),
        (5.0, (2.55, 2.55), 4.6, (2.2, 2.2), "it takes 1.7 of 21: a term that the first one's law lacks"),
        (5.0, (2.5, 3.5), 4.6, (2.2, 2.2), "of the fitted part it takes 1.4 of 21: it mends the tail of the first"),
        (5.0, (3.0, 2.6), 4.6, (2.2, 2.55), "of the unseen part it takes 0.26, less than half of 1.2²: luck"),
        (5.0, (3.0, 3.0), 4.6, (2.4, 2.4), "the two leave 1.3 of the fitted part, more than 1.2: no explanation"),
        (5.0, (3.0, 3.0), 4.6, (2.2, 3.2), "the unseen part refutes the two"),
    ],
)
def test_otherwise_the_first_stands_as_it_did(base, clip, creep, pair, why):
    search = Known(candidate((), base), candidate(CLIP, *clip), candidate(CREEP, creep), candidate(PAIR, *pair))
    naming = decided(search)
    assert search.asked == 1
    assert (naming.best, naming.rivals) == (search.tried[CLIP], ()), why


@pytest.mark.parametrize(
    ("base", "clip", "why"),
    [
        (5.0, (2.4, 2.4), "it leaves 1.8 of 21, less than a tenth"),
        (5.0, (3.0, 2.3), "it leaves 1.3 of 21 on the unseen part"),
        (3.0, (2.3, 2.3), "it leaves 1.3 of 5, but no more than the plant's own error of 1.2"),
    ],
)
def test_nothing_is_tried_beside_one_that_leaves_no_room(base, clip, why):
    search = Known(candidate((), base), candidate(CLIP, *clip), candidate(CREEP, 4.6), candidate(PAIR, 2.05))
    assert decided(search).best is search.tried[CLIP]
    assert search.asked == 0, why


def test_what_was_given_up_alone_is_fitted_from_the_pair_before_it_counts():
    # given up at 4.6 creep takes 3.8 of 21 alone; carried to its minimum of 3.1 it does mostly what the first does
    known = candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(PAIR, 2.2)
    assert decided(Known(*known)).best.effects == PAIR
    assert decided(Known(*known, better=(candidate(CREEP, 3.1),))).best.effects == CLIP
    # and so is the first: at 2.25 it leaves little of which the second could be a part
    better = candidate(CLIP, 2.25)
    assert decided(Known(*known, better=(better,))).best is better


def test_a_better_fit_of_the_first_that_fails_on_unseen_data_is_not_taken():
    known = candidate((), 5.0), candidate(CLIP, 2.9), candidate(CREEP, 4.6), candidate(PAIR, 2.2)
    search = Known(*known, better=(candidate(CLIP, 2.7, 4.5), candidate(CREEP, 2.5)))
    assert decided(search).best is known[1]


def test_two_of_which_one_cannot_be_fitted_alone_are_not_known_to_be_two():
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(PAIR, 2.2))
    search.lost = ["creep"]
    assert decided(search).best.effects == CLIP


def test_a_pair_that_was_tried_before_a_single_effect_was_found_to_do_counts():
    other = ("amplifier_saturation", "hysteresis")
    search = Known(
        candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(("hysteresis",), 4.6),
        candidate(PAIR, 2.8), candidate(other, 2.2),
    )  # fmt: skip
    search.pair = other  # what is tried beside the first now leaves too much
    naming = decided(search)
    assert naming.best is search.tried[other]


def test_an_answer_that_stands_knows_all_that_was_tried_since():
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 3.1), candidate(PAIR, 2.2))
    first = Naming(candidates=(), best=search.tried[CLIP], rivals=(), probabilities={CLIP: 1.0}, noise=NOISE)
    search.tried = {names: replace(c, noise=1.9) for names, c in search.tried.items()}
    naming = with_a_second(search, first)
    assert naming.candidates == tuple(search.tried.values())
    assert naming.best is search.tried[CLIP]
    assert naming.noise == 1.9


def test_an_answer_of_two_and_none_are_left_as_they_are():
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(PAIR, 2.2))
    for best in (None, search.tried[PAIR]):
        naming = Naming(candidates=(), best=best, rivals=(), probabilities={}, noise=NOISE)
        assert with_a_second(search, naming) is naming
    assert search.asked == 0


def test_the_pair_must_be_likelier_by_far(monkeypatch):
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(PAIR, 2.2))
    gain = search.tried[PAIR].evidence - search.tried[CLIP].evidence
    for strong, found in ((0.9 * gain, PAIR), (1.1 * gain, CLIP)):
        monkeypatch.setattr("deatwin.ident.mismatch.naming.pairs.STRONG", strong)
        assert decided(search).best is search.tried[found]


def test_a_search_for_causes_ends_with_the_look_for_a_second_one(monkeypatch):
    search = Known(candidate((), 5.0), candidate(CLIP, 3.0), candidate(CREEP, 4.6), candidate(PAIR, 2.2))
    alone = Naming(
        candidates=tuple(search.tried.values()), best=search.tried[CLIP], rivals=(), probabilities={CLIP: 1.0},
        noise=NOISE,
    )  # fmt: skip
    monkeypatch.setattr(name, "Search", lambda *_: search)
    monkeypatch.setattr(search, "judge_by_the_best", lambda stage: None)
    monkeypatch.setattr(search, "decided", lambda stage: alone)
    monkeypatch.setattr(search, "on_everything", lambda naming: naming)
    monkeypatch.setattr(name, "_with_more", lambda *_: (search, alone))
    monkeypatch.setattr(name, "with_fewer", lambda search, naming, forms: (search, naming))
    found = name.name_causes(search.bench, search.tried[()], ())
    assert found.best.effects == PAIR
