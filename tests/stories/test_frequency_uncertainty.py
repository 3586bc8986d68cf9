"""The measures of the story on made-up numbers, and its page on actuators whose law is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_bands import mean
from pages import story_page

from deatwin.ident.frequency.comparison.records import shares_of
from deatwin.ident.frequency.uncertainty import beside_draws
from deatwin.ident.frequency.uncertainty.propagate import propagate
from deatwin.plant.fleet import TOLERANCES, Actuator, specification
from deatwin.plant.recording import Experiment, Recording
from deatwin.scenarios import frequency_uncertainty
from deatwin.scenarios.frequency_uncertainty import study
from deatwin.scenarios.frequency_uncertainty.study import (
    BEGIN,
    BILINEAR,
    CASES,
    FACTOR,
    LINEAR,
    SHARED,
    Consistency,
    Plan,
    actuators,
    recorded,
    spectra,
)

SAMPLE_TIME = 0.12


def test_what_tolerances_predict():
    # A quantity that is uniform within ±a has the standard deviation a/sqrt(3), and independent ones add in squares.
    shares = shares_of((mean(2.0),), {"thickness": (mean(2.3),), "mass": (mean(2.0 + 0.4j),)})
    assert shares["thickness"] == pytest.approx([0.15 / np.sqrt(3)])
    assert shares["mass"] == pytest.approx([0.2 / np.sqrt(3)])
    assert Consistency(tables={}, means={}, shares=shares, responses={}).predicted == pytest.approx([0.25 / np.sqrt(3)])


def test_the_lines_of_an_order_are_those_with_power(monkeypatch):
    monkeypatch.setattr(beside_draws, "DRAWS", 200)
    first, second, third = spectra(CASES[BILINEAR], (0,))
    lines = [np.round(each.propagated.frequency_Hz * 64).astype(int).tolist() for each in (first, second, third)]
    # Harmonics 3 to 8: the first order has these, the second sums and differences, the third sums of three.
    assert lines[0] == list(range(3, 9))
    assert set(lines[1]) == {a + s * b for a in range(3, 9) for b in range(3, 9) for s in (1, -1) if a + s * b > 0}
    assert max(lines[2]) == 24 and min(lines[2]) == 1
    np.testing.assert_allclose(first.propagated.values, first.sampled.values)
    spread_over = np.sqrt(np.trace(second.sampled.covariance, axis1=1, axis2=2))
    predicted = np.sqrt(np.trace(second.propagated.covariance, axis1=1, axis2=2))
    # The standard deviation of 200 draws is known to 1/sqrt(400), or so; four times that.
    np.testing.assert_allclose(spread_over, predicted, rtol=0.2)


def test_who_shares_what():
    found = actuators(3, 4)
    groups = {group: [one for (its, _), one in found.items() if its == group] for group, _ in found}
    assert {group: len(every) for group, every in groups.items()} == {
        "fleet": 6,
        "steady": 6,
        "level": 6,
        "repeats": 4,
        "shared": len(SHARED),
        "tolerances": len(TOLERANCES),
        "specification": 1,
    }
    for one, other in zip(groups["fleet"], groups["steady"], strict=True):
        assert one.seed == other.seed and other.plant.effect_names == ("hysteresis",)
    assert len({one.seed for one in groups["level"]}) == 1
    assert all(one.plant is groups["repeats"][0].plant for one in groups["repeats"])
    assert len({one.seed for one in groups["repeats"]}) == 4
    made = {one.plant.rig.thickness for one in groups["shared"]}
    assert made == {specification().rig.thickness}
    seeds = [one.seed for group in ("fleet", "repeats", "shared") for one in groups[group]]
    assert len(set(seeds)) == len(seeds)


def test_one_quantity_at_the_end_of_its_tolerance():
    wished = specification()
    for (group, name), one in actuators(0, 1).items():
        if group != "tolerances":
            continue
        known = {n: parameter.value for n, parameter in wished.parameters.items() if parameter.value != 0}
        values = {n: one.plant.parameters[n].value / value for n, value in known.items()}
        rig = {n: getattr(one.plant.rig, n) / getattr(wished.rig, n) for n in TOLERANCES if hasattr(wished.rig, n)}
        off = {n: factor for n, factor in (values | rig).items() if abs(factor - 1) > 1e-12}
        assert off == pytest.approx({name: 1 + TOLERANCES[name].share})


def test_what_is_compared_begins_after_the_start():
    class Fake:
        def excitation(self, duration: float) -> float:
            return duration

        def record(self, duration: float) -> Experiment:
            n = round(duration / 0.02)
            return Experiment(recordings=(Recording.from_arrays(np.arange(n), np.arange(n), 0.02),))

    record = recorded(Fake(), 90.0)
    assert record.sample_time == pytest.approx(0.02 * FACTOR)
    assert record.start == pytest.approx(BEGIN)
    np.testing.assert_array_equal(record.inputs[0], np.arange(round(BEGIN / 0.02), 4500, FACTOR))


def polynomial(actuator: Actuator, duration: float) -> Recording:
    """An actuator whose law is among the terms: its gain is that of a thinner film, and histories make it drift."""
    rng = np.random.default_rng(actuator.seed)
    n = round(duration / SAMPLE_TIME)
    u = 2.4 + np.convolve(rng.uniform(-1.4, 1.4, n + 4), np.ones(5) / 2.2, "valid")
    noise = 2e-6 * rng.standard_normal(n)
    thin = specification().rig.thickness / actuator.plant.rig.thickness
    histories = set(actuator.plant.effect_names) - {"hysteresis", "electrode_loss"}
    gain = thin**4 * (1 + (0.4 if histories else 0.0) * np.linspace(-0.5, 0.5, n))
    y = np.zeros(n)
    y[0] = 1.2e-3
    for k in range(1, n):
        y[k] = 0.6 * y[k - 1] + gain[k] * (1e-4 * u[k] ** 2 - 3e-5 * u[k - 1] ** 2 + 1e-5 * u[k] ** 3) + noise[k]
    return Recording.from_arrays(u, y, SAMPLE_TIME, input_units=("V",), output_units=("m",))


@pytest.fixture
def quick(monkeypatch):
    """The story on polynomials, with few draws."""
    monkeypatch.setattr(study, "recorded", polynomial)
    monkeypatch.setattr(frequency_uncertainty, "PLAN", Plan(repeats=3, duration=300.0, data_sets=5))
    for module, name, less in (
        (beside_draws, "DRAWS", 500),
        (beside_draws, "CHUNKS", 3),
        (study, "SURFACE", 9),
        (study, "ORDERS", (1, 2)),
        (study, "BANDS", ((0.0, 0.2), (0.2, 1.0))),
    ):
        monkeypatch.setattr(module, name, less)


@pytest.mark.usefixtures("quick")
def test_the_page_says_who_differs_and_who_drifts(setting, tmp_path):
    told: list[tuple[float, str]] = []
    setting = replace(setting, progress=lambda share, text: told.append((share, text)))
    result = frequency_uncertainty.run(setting)
    page = story_page(tmp_path, "complex plane gain_phase higher_orders spectra fleet spread".split())
    assert json.loads((tmp_path / "frequency-uncertainty.json").read_text(encoding="utf-8")) == result
    rows = {row["measure"]: row["passed"] for row in result["measures"]}
    assert f"{sum(rows.values())} of {len(rows)} goals reached" in page
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and 0 <= shares[0] and shares[-1] <= 1

    steady, recorded_ = result["tables"]["steady"], result["tables"]["fleet"]
    gains = {n: 1 / one.plant.rig.thickness**4 for (g, n), one in actuators(0, 1).items() if g == "steady"}
    first = [d for d in steady["differences"] if d["order"] == 1]
    for d in first:
        # H_1 is proportional to the film's gain; the noise lets 1 % of it be seen.
        expected = abs(gains[d["first"]] - gains[d["second"]]) / np.sqrt(
            (gains[d["first"]] ** 2 + gains[d["second"]] ** 2) / 2
        )
        assert d["size"] == pytest.approx(expected, abs=0.01)
        assert (d["agreement"] == "different") == (d["adjusted"] < steady["level"])
    assert any(d["agreement"] == "different" for d in first)
    assert not any(d["drifts"] for d in steady["drifts"])
    assert {d["name"] for d in recorded_["drifts"] if d["drifts"]} == {f"DEA {n}" for n in range(1, 6)}
    # What the tolerance of the thickness predicts of a gain that goes with its fourth power, to first order.
    share = TOLERANCES["thickness"].share
    assert result["spread"]["predicted"] == pytest.approx([abs((1 + share) ** -4 - 1) / np.sqrt(3)] * 4, rel=0.05)


def test_linear_cases_are_propagated_as_they_are():
    # The response of the linear system is b(z)/a(z); its covariance by finite differences of that.
    model = CASES[LINEAR].identify(np.random.default_rng(0))
    found = propagate(model, CASES[LINEAR].response(1))
    z = np.exp(1j * CASES[LINEAR].omega(1))

    def response(theta: np.ndarray) -> np.ndarray:
        a1, a2, b1, b2 = theta
        return (b1 / z + b2 / z**2) / (1 - a1 / z - a2 / z**2)

    steps = 1e-6 * np.eye(4)
    slopes = np.array([(response(model.theta + s) - response(model.theta - s)) / 2e-6 for s in steps]).T
    parts = np.stack([slopes.real, slopes.imag], axis=1)
    np.testing.assert_allclose(found.covariance, parts @ model.theta_cov @ parts.swapaxes(1, 2), rtol=1e-6, atol=1e-12)
