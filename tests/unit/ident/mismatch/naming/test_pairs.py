"""A second effect beside one that suffices, on residuals of given sizes: 2 µm of noise, 1.2 µm of model error."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming import name
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.pairs import _doubted, with_a_second
from deatwin.ident.mismatch.naming.sets import Search

CLIP, CREEP, PAIR = ("amplifier_saturation",), ("creep",), ("amplifier_saturation", "creep")


@pytest.fixture
def leaving(candidate):
    """``leaving(base, clip, creep, pair)``: what leaves so much, or so much of the fitted and of the unseen part."""

    def make(*left: float | tuple[float, float]) -> list[Candidate]:
        sizes = [size if isinstance(size, tuple) else (size, size) for size in left]
        named = zip(((), CLIP, CREEP, PAIR), sizes, strict=True)
        return [candidate(*names, rms=fitted, unseen=unseen) for names, (fitted, unseen) in named]

    return make


class Known(Search):
    """A search that finds what is given: a pair beside the first effect, others in that one's place, better fits."""

    def __init__(
        self, *candidates: Candidate, replaced: tuple[Candidate, ...] = (), better: tuple[Candidate, ...] = ()
    ) -> None:
        super().__init__(SimpleNamespace(effects=(), jobs=1), candidates[0], ())
        self.tried.update({c.effects: c for c in (*candidates, *replaced)})
        self.pair, self.asked = PAIR, 0
        self.others, self.better = [c.effects for c in replaced], {c.effects: c for c in better}

    def with_distances(self, naming, competing):
        return naming

    def beside(self, names, finished=None):
        self.asked += 1
        return [PAIR]

    def fit_from(self, full, several):
        assert full == self.pair
        self.tried.update({rest: self.better.get(rest, self.tried[rest]) for rest in several if rest in self.tried})

    def replacing(self, before, best):
        assert (before, best) == (CLIP, self.pair)
        return self.others


def first_alone(search: Search) -> Naming:
    """The decision for the clipping, over all that was tried."""
    best = search.tried[CLIP]
    return Naming(
        candidates=tuple(search.tried.values()), best=best, rivals=(), probabilities={CLIP: 1.0}, noise=best.noise
    )


def decided(search: Search) -> Naming:
    """The same after a look for a second effect."""
    return with_a_second(search, first_alone(search))


def test_a_second_effect_with_a_part_of_its_own_is_named_beside_one_that_suffices(leaving):
    # of 5² - 2² = 21 creep takes 3² - 2.2² = 4.2: more than a tenth, and more than 1.2²; alone 3.8, far from most
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    naming = decided(search)
    assert naming.best is search.tried[PAIR]
    assert naming.rivals == ()


def test_two_that_take_most_alone_are_two_where_less_than_half_of_it_is_in_common(leaving):
    # 14.1 and 16 of 21 alone, 20.2 together: 9.9 in common
    search = Known(*leaving(5.0, 3.0, 3.3, 2.2))
    assert decided(search).best is search.tried[PAIR]


def test_one_that_counts_for_less_than_the_floor_leaves_the_first_alone_a_rival(leaving):
    # of 3.5² - 2² = 8.25 it takes 2.4² - 2.15² = 1.14: more than a tenth and half of 1.2², less than the whole
    search = Known(*leaving(3.5, 2.4, 3.3, 2.15))
    naming = decided(search)
    assert naming.best is search.tried[PAIR]
    assert naming.rivals == (search.tried[CLIP],)
    assert naming.probabilities[CLIP] == naming.probabilities[PAIR]


def test_what_acts_as_well_in_the_place_of_the_second_is_a_rival(leaving, candidate):
    other = candidate("amplifier_saturation", "dielectric_absorption", rms=2.205)
    lost = candidate("amplifier_saturation", "sensor_drift", rms=2.9)
    search = Known(
        *leaving(5.0, 3.0, 4.6, 2.2),
        candidate("dielectric_absorption", rms=4.6),
        candidate("sensor_drift", rms=4.6),
        replaced=(other, lost),
    )
    assert decided(search).rivals == (other,)


def test_a_second_effect_is_looked_for_where_more_than_the_floor_is_left_though_not_for_certain(leaving):
    """All that the clip leaves of the unseen part beyond the noise is in one block: that may be chance, and is 1.7²."""
    base, clip, creep, pair = leaving(3.5, 2.3, 3.3, 2.05)
    burst = np.where(np.arange(clip.unseen.size) < 50, np.sqrt(1.7**2 * clip.unseen.size / 50), 0.0)
    clip = replace(clip, unseen=np.sign(clip.unseen) * np.hypot(2.0, burst))
    assert clip.adequate and not clip.unseen_test.within_floor
    search = Known(base, clip, creep, pair)
    assert decided(search).best is search.tried[PAIR]


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
def test_otherwise_the_first_stands_as_it_did(leaving, base, clip, creep, pair, why):
    search = Known(*leaving(base, clip, creep, pair))
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
def test_nothing_is_tried_beside_one_that_leaves_no_room(leaving, base, clip, why):
    search = Known(*leaving(base, clip, 4.6, 2.05))
    assert decided(search).best is search.tried[CLIP]
    assert search.asked == 0, why


def test_what_was_given_up_alone_is_fitted_from_the_pair_before_it_counts(leaving, candidate):
    # given up at 4.6 creep takes 3.8 of 21 alone; carried to its minimum of 3.1 it does mostly what the first does
    known = leaving(5.0, 3.0, 4.6, 2.2)
    assert decided(Known(*known)).best.effects == PAIR
    assert decided(Known(*known, better=(candidate(*CREEP, rms=3.1),))).best.effects == CLIP
    # and so is the first: at 2.25 it leaves little of which the second could be a part
    better = candidate(*CLIP, rms=2.25)
    assert decided(Known(*known, better=(better,))).best is better


def test_a_better_fit_of_the_first_that_fails_on_unseen_data_is_not_taken(leaving, candidate):
    known = leaving(5.0, 2.9, 4.6, 2.2)
    search = Known(*known, better=(candidate(*CLIP, rms=2.7, unseen=4.5), candidate(*CREEP, rms=2.5)))
    assert decided(search).best is known[1]


def test_two_of_which_one_cannot_be_fitted_alone_are_not_known_to_be_two(candidate):
    search = Known(candidate(rms=5.0), candidate(*CLIP, rms=3.0), candidate(*PAIR, rms=2.2))
    search.lost = ["creep"]
    assert decided(search).best.effects == CLIP


def test_a_pair_that_was_tried_before_a_single_effect_was_found_to_do_counts(leaving, candidate):
    other = ("amplifier_saturation", "hysteresis")
    search = Known(*leaving(5.0, 3.0, 4.6, 2.8), candidate("hysteresis", rms=4.6), candidate(*other, rms=2.2))
    search.pair = other  # what is tried beside the first now leaves too much
    naming = decided(search)
    assert naming.best is search.tried[other]


def test_an_answer_that_stands_knows_all_that_was_tried_since(leaving):
    search = Known(*leaving(5.0, 3.0, 3.1, 2.2))
    first = replace(first_alone(search), candidates=())
    search.tried = {names: replace(c, noise=1.9) for names, c in search.tried.items()}
    naming = with_a_second(search, first)
    assert naming.candidates == tuple(search.tried.values())
    assert naming.best is search.tried[CLIP]
    assert naming.noise == 1.9


def test_an_answer_of_two_and_none_are_left_as_they_are(leaving):
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    for best in (None, search.tried[PAIR]):
        naming = replace(first_alone(search), best=best)
        assert with_a_second(search, naming) is naming
    assert search.asked == 0


@pytest.mark.parametrize(("parameters", "found"), [(21, PAIR), (23, CLIP)])
def test_the_pair_must_be_likelier_by_far(leaving, parameters, found):
    """100 ln(3²/2.2²) = 62 nats, of which each parameter more costs half of ln 200 = 2.65; ln 20 = 3.0 are strong."""
    *known, pair = leaving(5.0, 3.0, 4.6, 2.2)
    names = (*known[1].calibration.names, *("b",) * parameters)
    pair = replace(pair, calibration=SimpleNamespace(**vars(pair.calibration) | {"names": names}))
    search = Known(*known, pair)
    assert decided(search).best is search.tried[found]


@pytest.fixture
def explained_alone(leaving, monkeypatch):
    """A search in which a clip explains the recordings, and its decision."""
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    alone = first_alone(search)
    monkeypatch.setattr(name, "Search", lambda *_: search)
    monkeypatch.setattr(search, "judge_by_the_best", lambda stage: None)
    monkeypatch.setattr(name, "decided", lambda search, stage: alone)
    monkeypatch.setattr(name, "on_everything", lambda search, naming: [naming])
    monkeypatch.setattr(name, "_with_more", lambda *_: (search, alone))
    monkeypatch.setattr(name, "with_fewer", lambda search, naming, forms: (search, naming))
    return search, alone


def test_a_search_for_causes_ends_with_the_look_for_a_second_one(explained_alone):
    search, _ = explained_alone
    found = name.name_causes(search.bench, search.tried[()], ())
    assert found.best.effects == PAIR


def answers(search) -> list[tuple[str, ...] | None]:
    found = name.explanations(search.bench, search.tried[()], ())
    return [None if naming.best is None else naming.best.effects for naming in found]


def test_after_a_single_effect_comes_what_pairs_explain(explained_alone, monkeypatch):
    """Those that were tried before, too, and those that only suffice: each effect is left out once more."""
    search, _ = explained_alone
    monkeypatch.setattr(name, "with_a_second", lambda search, naming: naming)
    for module in ("name", "answers"):
        over_a_stage = f"deatwin.ident.mismatch.naming.{module}.decided"
        monkeypatch.setattr(over_a_stage, lambda search, stage: asked.append(stage) or nothing)
    monkeypatch.setattr(search, "with_one_more", lambda stage: asked.append(stage) or [])
    monkeypatch.setattr(search, "replacing", lambda before, best: asked.append(best) or [])
    monkeypatch.setattr(search, "fit_fewer", lambda full: asked.append(("fewer than", *full)) or [])
    monkeypatch.setattr(search, "alike", lambda full: asked.append(("as one of", *full)) or [])
    asked, nothing = (
        [],
        Naming(candidates=(search.tried[()],), best=None, rivals=(), probabilities={}, noise=search.noise),
    )
    pairs = [names for names in search.tried if len(names) == 2]
    assert PAIR in pairs
    alone = [names for names in search.tried if len(names) == 1]
    monkeypatch.setattr(name, "_with_more", lambda *_: (search, replace(nothing, best=search.tried[CLIP])))
    assert answers(search) == [CLIP, PAIR]
    looked = [("fewer than", *PAIR), ("as one of", *PAIR)]
    assert asked[1:] == [alone, PAIR, pairs, *looked, pairs]  # the first one was over single effects
    search.is_possible = lambda c: not c.effects
    assert answers(search) == [CLIP, None]


def test_nothing_comes_after_a_pair(explained_alone, monkeypatch):
    search, _ = explained_alone
    monkeypatch.setattr(name, "of_two", None)
    assert answers(search) == [PAIR]


def test_after_an_answer_of_another_form_comes_that_of_the_form_before(explained_alone, leaving, monkeypatch):
    search, alone = explained_alone
    other = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    monkeypatch.setattr(name, "with_fewer", lambda search, naming, forms: (other, alone))
    assert answers(search) == [CLIP, PAIR]
    # where there was none, a single one there may have imitated two there
    nothing, pair = replace(alone, best=None), replace(alone, best=search.tried[PAIR])
    monkeypatch.setattr(name, "_with_more", lambda *_: (search, nothing))
    monkeypatch.setattr(name, "of_two", {other: pair}.get)
    assert answers(search) == [CLIP, PAIR]


@pytest.mark.parametrize(("cost", "rivals"), [(1.4, [CLIP]), (1.5, [])])  # the floor is 1.2² = 1.44
def test_what_would_do_alone_but_for_the_ranges_of_the_plant_is_no_rival_of_a_pair(leaving, held, cost, rivals):
    """Without its second effect the pair leaves little more; in the one case only a film that is none does so."""
    base, clip, creep, pair = leaving(5.0, 2.3, 4.6, 2.1)
    search = Known(base, held(clip, cost, "damping"), creep, pair)
    assert [rival.effects for rival in _doubted(search, [PAIR]).rivals] == rivals
