"""The records of a fleet, and the choice of sampling time, lags and degree, on made-up numbers."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_fleet import NOISE, of_second_degree

from deatwin.ident.narx.fleet.orders import DEGREES, LAGS, Orders, as_good, make_plan, order_errors
from deatwin.ident.narx.fleet.records import FILM, HELD_OUT, RECORDED, STEADY, Prepared, as_variant
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
