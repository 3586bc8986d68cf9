"""The records of a fleet, and the choice of sampling time, lags and degree, on made-up numbers."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_fleet import GAINS, NOISE, STEP, made_fleet, made_up, of_second_degree, plan_of

from deatwin.ident.frequency import gfrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx import fleet as module
from deatwin.ident.narx.fleet import (
    DEGREES,
    FILM,
    HELD_OUT,
    LAGS,
    OPERATING_INPUT,
    RECORDED,
    STEADY,
    Fleet,
    Orders,
    Prepared,
    as_good,
    as_variant,
    choose_structure,
    fit,
    make_plan,
    order_errors,
)
from deatwin.plant.fleet import fleet


def test_less_physics_leaves_fabrication_commands_and_noise() -> None:
    made = fleet(0)[5]
    steady, film = as_variant(made, STEADY), as_variant(made, FILM)
    assert as_variant(made, RECORDED).plant is made.plant
    assert steady.plant.effect_names == ("hysteresis",) and film.plant.effect_names == ()
    for name in film.plant.parameters:
        assert len({one.plant.parameters[name].value for one in (made, steady, film)}) == 1
    assert steady.plant.parameters["hysteresis.force"].value == made.plant.parameters["hysteresis.force"].value
    # Until its electrode loses contact at 45 s the sixth is as it would be without: equal readings, noise included.
    commands = made.excitation(50.0)
    whole, without = (one.record(commands).recordings[0].outputs[0] for one in (made, steady))
    before, after = slice(0, round(44 / 0.02)), slice(round(46 / 0.02), None)
    step = made.plant.rig.chain.reading_step  # type: ignore[union-attr]
    assert np.abs(whole - without)[before].max() <= 1.01 * step
    assert np.abs(whole - without)[after].max() > 10 * step


def test_the_held_out_section_is_the_end_of_the_stretch() -> None:
    record = of_second_degree(20_000)  # 400 s
    stretch = SimpleNamespace(first=5000, last=15_000)
    one = Prepared(
        actuator=fleet(0)[0],
        recordings={RECORDED: record},
        sections=SimpleNamespace(stretches=[stretch]),  # type: ignore[arg-type]
        sampling=None,
        findings=(),  # type: ignore[arg-type]
    )
    training, held_out = one.split(RECORDED, 4)
    assert (training.start, held_out.end) == pytest.approx((100.0, 300.0))
    assert held_out.duration == pytest.approx(HELD_OUT) and held_out.start == pytest.approx(training.end)


def test_what_is_as_good_by_the_one_standard_error_rule() -> None:
    # Differences of standard deviation 0.02 over six have a standard error of 0.00816; between the six there is more.
    spread = 0.02 * np.array([-1, 1, -1, 1, -1, 1]) * np.sqrt(5 / 6)
    least = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert as_good(least + spread + 0.0081, least) and not as_good(least + spread + 0.0083, least)
    assert as_good(least, least) and not as_good(least + 1e-6, least)
    assert not as_good(np.append(least[:5], np.inf), least)


def test_of_equally_good_orders_those_with_the_fewest_candidates() -> None:
    noise = 1e-3 * np.array([-1, 1, -1, 1, -1, 1])
    errors = np.full((6, len(LAGS), len(DEGREES)), 0.5)
    errors[:, 5, 4] = 0.1
    errors[:, 1, 3] = 0.1002 + noise
    errors[:, 1, 2] = 0.11
    assert Orders(factor=2, errors=errors).best == (1, 3)
    errors[:, 0, 4] = 0.1002 + noise  # fewer lags of a higher degree: 11 candidates instead of 25
    assert Orders(factor=2, errors=errors).best == (0, 4)
    errors[0, 0, 4] = np.inf  # one of the six diverges
    assert Orders(factor=2, errors=errors).best == (1, 3)


def test_the_longest_sampling_time_of_those_that_are_as_good() -> None:
    noise = 0.02 * np.array([-1, 1, -1, 1, -1, 1])[:, None, None]
    shape = (6, len(LAGS), len(DEGREES))
    means = {2: np.full(shape, 0.1), 4: np.full(shape, 0.105) + noise, 6: np.full(shape, 0.12) + noise}
    assert make_plan({factor: list(each) for factor, each in means.items()}).factor == 4


def test_free_run_errors_find_the_degree() -> None:
    errors = order_errors(of_second_degree(900))
    scale = float(of_second_degree(900).outputs.std())
    place = LAGS.index((1, 1))
    # With all terms among the candidates what is left is the noise, amplified by the loop, 1 / sqrt(1 - 0.65^2).
    assert errors[place, DEGREES.index(2)] < 2 * NOISE / scale
    assert errors[place, 0] > 0.02
    assert errors[LAGS.index((1, 0)), DEGREES.index(2)] > 5 * errors[place, DEGREES.index(2)]


made = pytest.fixture(scope="module")(made_fleet)


def test_a_common_structure_holds_the_law(made: Fleet) -> None:
    truth = {"y(k-1)", "u(k)^2", "u(k-1)^2", "u(k)u(k-1)"}
    assert truth <= {str(term) for term in made.structure}
    assert all(one.model.terms == made.structure for one in made.actuators)
    # The free run's error is the noise through the loop, 1 / sqrt(1 - 0.55^2) = 1.2 of it at the mean command.
    for one, error in zip(made.actuators, made.errors, strict=True):
        assert error < 2 * NOISE / one.sections[0].outputs.std()
        assert one.sections[1].duration == pytest.approx(HELD_OUT, abs=STEP) and one.fit_percent > 95


def test_the_shortest_of_equally_good_structures(monkeypatch: pytest.MonkeyPatch) -> None:
    records = [made_up(gain, 600, seed) for seed, gain in enumerate(GAINS)]
    passed = [[("a", "b", "c")], [("a", "b"), ("a",)], [("a", "d")]]
    # Least: three terms. Two terms are worse by half a standard error of the paired differences, one by far.
    least, noise = np.array([0.1, 0.2, 0.3]), 0.01 * np.array([-1.0, 0.0, 1.0])
    errors = {("a", "b", "c"): least, ("a", "b"): least + noise + 0.003, ("a",): least + 0.1, ("a", "d"): least + 0.05}
    calls = iter(passed)
    monkeypatch.setattr(module, "_passed", lambda *_: next(calls))
    rows = iter(range(3))
    monkeypatch.setattr(
        module, "_free_run_errors", lambda structures, *_: [errors[s][i] for i in [next(rows)] for s in structures]
    )
    structure, chosen, tried = choose_structure(records, plan_of())
    assert structure == ("a", "b") and tried == 4  # type: ignore[comparison-overlap]
    np.testing.assert_allclose(chosen, errors["a", "b"])


def test_a_fit_has_a_covariance_that_the_scatter_bears_out() -> None:
    terms = ["y(k-1)", "u(k)^2", "u(k-1)^2", "u(k)u(k-1)"]
    models = [
        fit(NarxModel.from_terms(dict.fromkeys(terms, 1.0), sample_time=1.0).terms, made_up(1.0, 600, seed))
        for seed in range(40)
    ]
    gains = [gfrf(m, 1, [0.5], operating_input=OPERATING_INPUT) for m in models]
    scatter = np.std([float(g.gain[0]) for g in gains], ddof=1)
    stated = np.sqrt(np.mean([float(g.gain_deviation[0]) ** 2 for g in gains]))
    # The scatter of 40 is known to 11 %; the robust variance of 600 samples (28 cosines) has 19 % and is averaged.
    assert scatter / stated == pytest.approx(1.0, abs=0.35)
