"""Where the response of recordings is not that of a plant: known changes, noise alone, and a concealed effect."""

import json
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
from runs import blank

from deatwin.ident.mismatch.locate.response import TERMS, locate_response
from deatwin.ident.narx import NarxModel
from deatwin.plant import Diaphragm, ElectrodeRC, Plant, Recording
from deatwin.plant.excitation import band_limited_noise

STEP = 0.02
SYSTEM = {"1": 2e-5, "y(k-1)": 0.97, "u(k-1)": 1e-6, "u(k-1)^2": 1e-6, "u(k-1)^3": 1e-7}
NOISE = 2e-6


def commands(seed: int, duration: float = 120.0) -> np.ndarray:
    return band_limited_noise(np.random.default_rng(seed), duration, STEP)


def run(u: np.ndarray, **changed: float) -> np.ndarray:
    """Free run of a first-order system with a polynomial of the input, m; terms are changed by a factor."""
    terms = {name: value * changed.get(name, 1.0) for name, value in SYSTEM.items()}
    start = sum(value for name, value in terms.items() if name.startswith("u")) / 0.03 + terms["1"] / 0.03
    model = NarxModel.from_terms(terms, sample_time=STEP)
    return model.simulate(Recording.from_arrays(u, np.full(u.size, start), STEP)).outputs[0]


def measured(u: np.ndarray, y: np.ndarray, seed: int) -> Recording:
    return Recording.from_arrays(u, y + NOISE * np.random.default_rng((seed, 7)).standard_normal(y.size), STEP)


def test_noise_alone_is_no_difference():
    """Twenty recordings, at 5 % each: more than four with a finding come once in four hundred times."""
    found = 0
    for seed in range(20):
        u = commands(seed)
        y = run(u)
        found += bool(locate_response([measured(u, y, seed)], [y], 0.0))
    assert found <= 4


def test_a_change_shows_in_the_orders_that_it_makes():
    u = commands(1, 240.0)
    plant = run(u)
    gain = locate_response([measured(u, run(u, **{key: 1.1 for key in SYSTEM if "u" in key}), 1)], [plant], 0.0)
    assert {d.order for d in gain} >= {1, 2}
    for d in gain:
        if d.order == 1:
            assert d.size == pytest.approx(0.1, abs=0.02)  # all of the input's terms are larger by a tenth
    # the cubic term alone changes the slope at the operating point by less, but the curvature too
    biased = locate_response([measured(u, run(u, **{"u(k-1)^3": 2.0}), 1)], [plant], 0.0)
    assert {d.order for d in biased} >= {1, 3}
    sizes = {d.order: d.size for d in biased}
    assert sizes[3] > 3 * sizes[1]


def test_what_the_model_error_allows_does_not_count():
    u = commands(2, 240.0)
    plant, actuator = run(u), run(u, **{key: 1.1 for key in SYSTEM if "u" in key})
    apart = float(np.std(actuator - plant))
    assert locate_response([measured(u, actuator, 2)], [plant], 0.2 * apart)
    # the error is taken to be spread over frequencies as the input is: a low-pass differs by more at low ones,
    # 1 / 0.03 against the root mean square over the input's band, half of that
    assert not locate_response([measured(u, actuator, 2)], [plant], 2.5 * apart)


def test_a_lag_of_the_film_voltage_is_found_and_clean_readings_are_not():
    plant = Plant(rig=Diaphragm())
    u = commands(3)
    unread = blank(u)
    own = plant.simulate(unread).outputs[0][0]
    clean = plant.record(unread, np.random.default_rng(1)).recordings
    lagging = plant.with_effects(ElectrodeRC()).record(unread, np.random.default_rng(1)).recordings
    assert locate_response(clean, [own], 1e-6) == ()
    found = locate_response(lagging, [own], 1e-6)
    assert {d.order for d in found} >= {1}
    highest = max(found, key=lambda d: (d.order == 1, d.from_Hz))
    lowest = min(found, key=lambda d: (d.order != 1, d.from_Hz))
    assert highest.size > lowest.size  # a lag turns fast motion more than slow motion


def test_short_records_are_left_out_and_poor_ones_say_nothing():
    u = commands(4)
    y = run(u)
    with_short = locate_response([measured(u, 1.5 * y, 4), measured(u[:100], y[:100], 5)], [y, y[:100]], 0.0)
    assert with_short == locate_response([measured(u, 1.5 * y, 4)], [y], 0.0)
    assert with_short
    few = slice(0, 40 * len(TERMS))
    assert locate_response([measured(u[few], y[few], 4)], [y[few]], 0.0) is None
    assert locate_response([measured(u, y, 4)], [np.zeros_like(y)], 0.0) is None


def test_the_file_may_say_that_nothing_could_be_tested():
    schema = json.loads((files("deatwin.ident") / "schemas" / "diagnosis.schema.json").read_text(encoding="utf-8"))
    for response in (None, []):
        jsonschema.validate(response, schema["properties"]["locate"]["properties"]["response"])
