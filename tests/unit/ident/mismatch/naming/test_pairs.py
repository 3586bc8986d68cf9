"""A second effect beside one that suffices, on residuals of given sizes: 2 µm of noise, 1.2 µm of model error."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from made_fits import made_problem
from tests.unit.ident.mismatch.naming.conftest import Nominal

from deatwin.ident.mismatch.naming import name
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.pairs import _doubted, with_a_second, with_doubt
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.thresholds import STRONG

CLIP, CREEP, PAIR = ("amplifier_saturation",), ("creep",), ("amplifier_saturation", "creep")


@pytest.fixture
def leaving(candidate):
    """``leaving(base, clip, creep, pair)``: what leaves so much, or so much of the fitted and of the held-out part."""

    def make(*left: float | tuple[float, float]) -> list[Candidate]:
        sizes = [size if isinstance(size, tuple) else (size, size) for size in left]
        named = zip(((), CLIP, CREEP, PAIR), sizes, strict=True)
        return [candidate(*names, rms=fitted, unseen=unseen) for names, (fitted, unseen) in named]

    return make


class Known(Search):
    """A search that finds what is given: others in the place of a pair's effects, better fits."""

    def __init__(
        self, *candidates: Candidate, replaced: tuple[Candidate, ...] = (), better: tuple[Candidate, ...] = ()
    ) -> None:
        super().__init__(SimpleNamespace(effects=(), jobs=1), candidates[0], ())
        self.tried.update({c.effects: c for c in candidates})
        self.replaced, self.better = {c.effects: c for c in replaced}, {c.effects: c for c in better}
        self.asked: dict[tuple[str, ...], list[str]] = {}
        self.screened: list[tuple[str, ...]] = []

    def with_distances(self, naming, competing):
        return naming

    def beside(self, names, finished=None):
        return [PAIR]

    def with_each(self, chosen):
        self.asked = chosen

    def screen(self, names):
        self.screened.append(names)

    def refit(self, plants):
        self.tried.update(self.better)

    def fit_from(self, full, several):
        self.tried.update({rest: self.better[rest] for rest in several if rest in self.better})

    def replacing(self, before, best):
        assert before == best  # either of the two may be another one
        self.tried.update(self.replaced)
        return list(self.replaced)


class GivenScale:
    """Two are likelier by `odds` than either alone, and less so by what a better fit of one leaves less, in nats."""

    odds, promised, bends = STRONG + 1.0, {}, {}

    def __init__(self, *, problem, base, noise):
        self.tried = (problem, base, noise)

    def weight(self, candidate):
        return -candidate.calibration.rms

    def biased(self, candidate):
        return self.bends.get(candidate.effects, 0.0)

    def of_two(self, pair, alone, others):
        return self.odds - 1e6 * (alone.calibration.rms < 2.6)

    def promises(self, alone, known):
        return self.promised.get(alone.effects, {})


@pytest.fixture(autouse=True)
def scale(monkeypatch):
    monkeypatch.setattr("deatwin.ident.mismatch.naming.tried.Scale", GivenScale)
    return lambda **known: [monkeypatch.setattr(GivenScale, name, value) for name, value in known.items()]


def first_alone(search: Search) -> Naming:
    """The decision for the clipping, over all that was tried."""
    best = search.tried[CLIP]
    return Naming(
        candidates=tuple(search.tried.values()), best=best, alternatives=(), probabilities={CLIP: 1.0}, noise=best.noise
    )


def decided(search: Search) -> Naming:
    """The same after a look for a second effect."""
    return with_a_second(search, first_alone(search))


def test_a_pair_that_is_likelier_by_far_and_explains_is_named(leaving):
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    naming = decided(search)
    assert naming.best is search.tried[PAIR]
    assert naming.alternatives == ()


@pytest.mark.parametrize(
    ("pair", "odds"),
    [((2.2, 2.2), 1.0), ((2.4, 2.4), 10.0), ((2.2, 3.2), 10.0)],
    ids=["likelier, but not by far", "too much is left for an explanation", "the held-out part refutes the two"],
)
def test_a_pair_that_is_likelier_but_cannot_lead_is_a_alternative(leaving, scale, pair, odds):
    """A single effect is not named alone where two are likelier."""
    scale(odds=odds)
    search = Known(*leaving(5.0, 3.0, 4.6, pair))
    naming = decided(search)
    assert naming.best is search.tried[CLIP]
    assert naming.alternatives == (search.tried[PAIR],)
    assert naming.probabilities[CLIP] == naming.probabilities[PAIR]


def test_the_first_stands_alone_where_no_pair_is_likelier(leaving, scale):
    scale(odds=-1.0)
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    naming = decided(search)
    assert (naming.best, naming.alternatives) == (search.tried[CLIP], ())


def test_what_acts_as_well_in_the_place_of_the_second_is_a_alternative(leaving, candidate):
    other = candidate("amplifier_saturation", "dielectric_absorption", rms=2.205)
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2), candidate("dielectric_absorption", rms=4.6), replaced=(other,))
    assert decided(search).alternatives == (other,)


def test_a_single_effect_is_fitted_from_the_pair_before_the_pair_is_likelier(leaving, candidate):
    known = leaving(5.0, 3.0, 4.6, 2.2)
    better = candidate(*CREEP, rms=2.5)
    assert decided(Known(*known, better=(better,))).best.effects == CLIP


def test_a_better_fit_of_the_first_that_fails_on_unseen_data_is_not_taken(leaving, candidate):
    known = leaving(5.0, 2.9, 4.6, 2.2)
    search = Known(*known, better=(candidate(*CLIP, rms=2.55, unseen=4.5),))
    assert decided(search).best is known[1]


def test_the_pairs_that_promise_most_are_tried_beside_the_likeliest_single_effects(leaving, candidate, scale):
    """Odds are promised over what is there: an effect that weighs half a nat less is as much behind."""
    others = [candidate(f"effect_{k}", rms=4.0 + k) for k in range(4)]
    search = Known(*leaving(5.0, 3.0, 3.5, 2.2), *others)
    scale(
        promised={
            CLIP: {"creep": 9.0, "sensor_drift": 3.0, "mullins": -1.0},
            CREEP: {"sensor_drift": 8.0, "amplifier_saturation": 9.0, "leakage": 2.0, "delay": 1.0, "end_stop": 0.5},
            ("effect_3",): {"sensor_drift": 99.0},
        }
    )
    decided(search)  # the pair of clip and creep is known, the last one beside creep is the fifth
    assert search.asked == {CREEP: ["sensor_drift", "leakage", "delay"], CLIP: ["sensor_drift"]}


@pytest.mark.parametrize(("left", "asked"), [(70.0, {CLIP: ["sensor_lag"]}), (4.0, {})])
def test_what_lets_the_rig_be_nearer_to_its_nominal_values_is_tried(leaving, candidate, scale, left, asked):
    """A lag bends the damping of the plant without it, where its response then promises nothing. Beside an effect with
    which the damping is nearly nominal, a lag can bring it no nearer.
    """
    search = Known(*leaving(5.0, 3.0, 3.5, 2.2), candidate("sensor_lag", rms=4.9))
    bends = {(): 70.0, CLIP: left, CREEP: 71.0, ("sensor_lag",): 1.0}
    scale(promised={CLIP: {"sensor_lag": -5.0, "mullins": -1.0}}, bends=bends)
    decided(search)
    assert search.asked == asked


@pytest.mark.parametrize(
    ("left", "screened"), [(3.0, [CLIP]), (2.2, [])], ids=["2.2 µm too much", "0.9 µm beyond noise"]
)
def test_what_an_effect_leaves_beyond_noise_and_model_error_is_looked_at_in_its_own_plant(leaving, left, screened):
    search = Known(*leaving(5.0, left, 4.6, 2.1))
    decided(search)
    assert search.screened == screened


def undecided(search: Search) -> Naming:
    """The decision after a look for a second effect, if no single effect was adequate."""
    return with_a_second(search, replace(first_alone(search), best=None, probabilities={}))


@pytest.mark.parametrize("odds", [1.0, 10.0])
def test_beside_an_effect_that_leaves_little_but_too_much_a_likelier_pair_is_the_answer(leaving, scale, odds):
    """Of 21 units of power the clipping leaves 2.3, which its law may; the model error is 1.44."""
    scale(odds=odds)
    search = Known(*leaving(5.0, (2.7, 3.2), 4.6, 2.2))
    assert undecided(search).best is search.tried[PAIR]
    assert search.screened == [CLIP]


@pytest.mark.parametrize(
    ("clip", "pair", "odds"),
    [((2.7, 3.2), 2.2, -1.0), ((2.7, 3.2), (2.6, 4.0), 9.0), (3.2, 2.2, 9.0)],
    ids=["the pair is less likely", "the pair leaves too much", "the clipping leaves more than its law may"],
)
def test_otherwise_there_is_no_answer_as_before(leaving, scale, clip, pair, odds):
    scale(odds=odds)
    search = Known(*leaving(5.0, clip, 4.6, pair))
    assert undecided(search).best is None


def as_built(candidate: Candidate) -> Candidate:
    """The same with a plant that takes other values."""
    plant = Nominal()
    plant.rig, plant.effects, plant.parameters = candidate.calibration.plant.rig, (), {}
    return replace(candidate, calibration=SimpleNamespace(**vars(candidate.calibration) | {"plant": plant}))


def test_a_pair_that_leaves_more_than_one_of_its_effects_is_fitted_again(leaving, candidate):
    """The likelihood counts a pair's fit only if it is at its minimum, which leaves no more than either effect."""
    search = Known(*map(as_built, leaving(5.0, 3.0, 4.6, 3.01)), better=(candidate(*PAIR, rms=2.2),))
    assert decided(search).best is search.tried[PAIR]
    assert search.tried[PAIR].calibration.rms == pytest.approx(2.2)
    kept = Known(*leaving(5.0, 3.0, 4.6, 2.9), better=(candidate(*PAIR, rms=2.2),))
    kept.no_worse([PAIR])
    assert kept.tried[PAIR].calibration.rms == pytest.approx(2.9)


def test_an_answer_that_stands_knows_all_that_was_tried_since(leaving, scale):
    scale(odds=-1.0)
    search = Known(*leaving(5.0, 3.0, 3.1, 2.2))
    first = replace(first_alone(search), candidates=())
    search.tried = {names: replace(c, noise=1.9) for names, c in search.tried.items()}
    naming = with_a_second(search, first)
    assert naming.candidates == tuple(search.tried.values())
    assert naming.best is search.tried[CLIP]
    assert naming.noise == 1.9


def test_a_pair_has_the_single_effects_as_rivals_that_it_is_not_far_likelier_than(leaving, candidate, scale):
    """The likeliest one, whose law lies between those of the two, may do what both do; what explains little may not."""
    third, fourth = candidate("dielectric_absorption", rms=2.62), candidate("sensor_drift", rms=2.9)
    search = Known(*leaving(5.0, 2.7, 4.6, 2.2), third, fourth)
    both = replace(first_alone(search), best=search.tried[PAIR], probabilities={PAIR: 1.0})
    assert with_doubt(search, both) is both
    scale(odds=STRONG - 0.1)
    doubted = with_doubt(search, both)
    assert doubted.best is search.tried[PAIR]
    assert {alternative.effects for alternative in doubted.alternatives} == {CLIP, third.effects}
    assert doubted.probabilities[CLIP] == pytest.approx(1 / 3)
    alone = first_alone(search)
    assert with_doubt(search, alone) is alone


@pytest.mark.parametrize(
    ("left", "alternatives"), [(2.7, (CLIP,)), (3.0, ())], ids=["nearly all is taken", "too much is left"]
)
def test_a_law_is_to_blame_only_for_what_laws_err_by(leaving, scale, left, alternatives):
    """Of 21 - 1 units of power that are neither noise nor the plant's error one effect leaves 2.3, another one 4."""
    search = Known(*leaving(5.0, left, 4.6, 2.2))
    scale(odds=-19.0)
    both = replace(first_alone(search), best=search.tried[PAIR], probabilities={PAIR: 1.0})
    assert tuple(alternative.effects for alternative in with_doubt(search, both).alternatives) == alternatives


def test_rivals_of_another_form_stay_among_what_was_tried(leaving, candidate, scale):
    scale(odds=-1.0)
    search, other = Known(*leaving(5.0, 3.0, 4.6, 2.2)), candidate(*CREEP, rms=3.1)
    naming = with_a_second(search, replace(first_alone(search), alternatives=(other,)))
    assert naming.alternatives == (other,)
    assert naming.candidates == (*search.tried.values(), other)


def test_an_answer_of_two_and_none_are_left_as_they_are(leaving):
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    for best in (None, search.tried[PAIR]):
        naming = replace(first_alone(search), best=best)
        assert with_a_second(search, naming) is naming
    assert search.asked == {}


@pytest.fixture
def explained_alone(leaving, monkeypatch):
    """A search in which a clip explains the recordings, and its decision."""
    search = Known(*leaving(5.0, 3.0, 4.6, 2.2))
    alone = first_alone(search)
    monkeypatch.setattr(name, "Search", lambda *_: search)
    monkeypatch.setattr(search, "judge_by_the_best", lambda stage: None)
    monkeypatch.setattr(search, "more_finely", lambda stage: None)
    monkeypatch.setattr(name, "decided", lambda search, stage: alone)
    monkeypatch.setattr(name, "on_everything", lambda search, naming: [naming])
    monkeypatch.setattr(name, "_with_more", lambda *_: (search, alone))
    monkeypatch.setattr(name, "with_fewer", lambda search, naming, forms: (search, naming))
    return search, alone


def test_a_search_for_causes_ends_with_the_look_for_a_second_one(explained_alone):
    search, _ = explained_alone
    found = name.name_causes(made_problem(), search.tried[()], ())
    assert found.best.effects == PAIR


def answers(search) -> list[tuple[str, ...] | None]:
    found = name.explanations(search.problem, search.tried[()], ())
    return [None if naming.best is None else naming.best.effects for naming in found]


def test_after_a_single_effect_comes_what_pairs_explain(explained_alone, monkeypatch):
    """Those that were tried before, too, and those that only suffice."""
    search, _ = explained_alone
    nothing = Naming(candidates=(search.tried[()],), best=None, alternatives=(), probabilities={}, noise=search.noise)
    monkeypatch.setattr(name, "with_a_second", lambda search, naming: naming)
    for module in ("name", "decisions"):
        over_a_stage = f"deatwin.ident.mismatch.naming.{module}.decided"
        monkeypatch.setattr(over_a_stage, lambda search, stage: nothing)
    for look in ("with_one_more", "fit_fewer", "alike"):
        monkeypatch.setattr(search, look, lambda names: [])
    monkeypatch.setattr(name, "_with_more", lambda *_: (search, replace(nothing, best=search.tried[CLIP])))
    assert answers(search) == [CLIP, PAIR]
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


@pytest.mark.parametrize(("cost", "alternatives"), [(1.4, [CLIP]), (1.5, [])])  # the floor is 1.2² = 1.44
def test_what_would_do_alone_but_for_the_ranges_of_the_plant_is_no_rival_of_a_pair(leaving, held, cost, alternatives):
    """Without its second effect the pair leaves little more; in the one case only a film that is none does so."""
    base, clip, creep, pair = leaving(5.0, 2.3, 4.6, 2.1)
    search = Known(base, held(clip, cost, "damping"), creep, pair)
    assert [alternative.effects for alternative in _doubted(search, [PAIR]).alternatives] == alternatives
