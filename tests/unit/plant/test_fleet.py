"""The fleet: six fabrications within their tolerances, six histories, and the ridge that makes the first one rough."""

from dataclasses import replace

import numpy as np
import pytest
from slopes import slope_errors

from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.fleet import HISTORIES, TOLERANCES, GreaseRidge, fleet, specification

STEP = 0.02

pytestmark = pytest.mark.usefixtures("uncompiled")


def experiment(commands: np.ndarray, start: float = 0.0) -> Experiment:
    return Experiment(recordings=(Recording.from_arrays(commands, np.zeros_like(commands), STEP, start=start),))


def departures(plant: Plant) -> dict[str, float]:
    """Relative departure of each quantity from the specification."""
    wished = specification()
    found = {}
    for name in TOLERANCES:
        of = (lambda p: p.parameters[name].value) if name in wished.parameters else (lambda p: getattr(p.rig, name))  # noqa: B023
        found[name] = of(plant) / of(wished) - 1
    return found


def test_each_fabrication_lies_within_its_tolerances_and_beside_the_others() -> None:
    all_of_them = [departures(actuator.plant) for actuator in fleet(3)]
    assert len(all_of_them) == 6
    for name, tolerance in TOLERANCES.items():
        shares = [d[name] for d in all_of_them]
        assert max(abs(s) for s in shares) <= tolerance.share * (1 + 1e-12), name
        assert len(set(shares)) == 6, name


def test_many_fabrications_fill_their_tolerances() -> None:
    # Of 60 uniform draws the extremes come within 10 % of both ends but for a chance of 2 * 0.95**60 < 0.1.
    shares = [departures(a.plant)["thickness"] / TOLERANCES["thickness"].share for s in range(10) for a in fleet(s)]
    assert min(shares) < -0.9 and max(shares) > 0.9
    assert abs(np.mean(shares)) < 4 * np.sqrt(1 / 3 / 60)  # four standard errors of a uniform mean


def test_thickness_and_mass_reach_the_equations() -> None:
    for actuator in fleet(0):
        assert actuator.plant.parameters["thickness"].value == actuator.plant.rig.thickness  # type: ignore[attr-defined]
        assert actuator.plant.parameters["mass"].value == actuator.plant.rig.mass  # type: ignore[attr-defined]


def test_the_same_seed_makes_the_same_fleet_and_another_seed_another() -> None:
    first, again, other = (fleet(seed)[4] for seed in (7, 7, 8))
    assert first.plant.to_dict() == again.plant.to_dict()
    assert departures(first.plant) != departures(other.plant)
    u = [a.excitation(60.0).recordings[0].inputs for a in (first, again, other)]
    assert np.array_equal(u[0], u[1]) and not np.array_equal(u[0], u[2])


def test_each_is_driven_by_its_own_noise_for_the_thesis_time() -> None:
    records = [actuator.excitation().recordings[0] for actuator in fleet(0)]
    for record in records:
        assert record.n_samples == 55_000 and record.sample_time == 0.02
        assert record.inputs.min() == 1.1 and record.inputs.max() == 3.75
    correlation = np.corrcoef([record.inputs[0] for record in records])
    # 1 Hz for 1100 s is about 2200 independent values: 4 / sqrt(2200) is 0.085.
    assert np.abs(correlation - np.eye(6)).max() < 0.085


def test_histories_differ_in_their_physics() -> None:
    effects = [{type(e) for e in history.effects} for history in HISTORIES]
    assert all(a != b for k, a in enumerate(effects) for b in effects[:k])
    assert all("hysteresis" in actuator.plant.effect_names for actuator in fleet(0))


def test_a_record_has_passed_the_measuring_chain() -> None:
    actuator = fleet(0)[1]
    chain = actuator.plant.rig.chain
    assert chain is not None
    short = actuator.excitation(4.0)
    y = actuator.record(short).recordings[0].outputs[0]
    codes = y / chain.reading_step
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-6)
    assert np.array_equal(y, actuator.record(short).recordings[0].outputs[0])
    free = actuator.plant.simulate(short).outputs[0][0]
    other = actuator.record(short, np.random.default_rng(1)).recordings[0].outputs[0]
    lag = 4e-6  # 1.6 ms at up to 2.5 mm/s
    for readings in (y, other):
        assert 0.1 * chain.noise < np.std(readings - free) < chain.noise + lag
    assert not np.array_equal(y, other)


RIG = Diaphragm(contact_radius=1.5e-3, ball="sliding")
PLAIN = Plant(rig=RIG, values={"damping": 0.5})


@pytest.fixture(scope="module")
def rest() -> float:
    """Where the ball rests at 3.1 V, m."""
    return float(PLAIN.simulate(experiment(np.full(600, 3.1))).require().outputs[0][0, -1])


def test_a_ridge_of_no_force_is_none() -> None:
    wave = 2.9 + 0.5 * np.sin(2 * np.pi * 0.5 * STEP * np.arange(1000))
    plants = (PLAIN, PLAIN.with_effects(GreaseRidge(force=0.0)))
    without, none = (plant.simulate(experiment(wave)).outputs[0] for plant in plants)
    np.testing.assert_allclose(none, without, rtol=0, atol=1e-12)


def test_a_weak_ridge_shifts_the_ball_as_its_stiffness_has_it(rest: float) -> None:
    # k = m g / z for a ball on a film (f0 = sqrt(g / z) / 2 pi), where z counts from the flat film.
    force = 5e-6  # 2 pi F / p is 0.6 N/m, far below k: no snap
    ridge = GreaseRidge(force=force, lower=rest - 1e-4, upper=rest + 1e-4, built=0.0, worn=100.0)
    shifted = float(PLAIN.with_effects(ridge).simulate(experiment(np.full(600, 3.1))).require().outputs[0][0, -1])
    sag = 0.966e-3 * 25e3 / PLAIN.parameters["shear_modulus"].value  # closed form for 25 kPa and a 1.5 mm contact
    stiffness = RIG.mass * 9.80665 / (sag + rest)
    expected = -force * np.sin(2 * np.pi * shifted / ridge.pitch) / stiffness
    assert abs(expected) > 20e-9
    assert shifted - rest == pytest.approx(expected, rel=0.15)  # the closed form is for small slopes


def test_the_ridge_is_felt_between_its_deflections_and_times_only(rest: float) -> None:
    wave = 3.0 + 0.3 * np.sin(2 * np.pi * 0.2 * STEP * np.arange(2000))
    without = PLAIN.simulate(experiment(wave)).require().outputs[0][0]
    ridge = GreaseRidge(lower=rest - 5e-5, upper=rest + 5e-5, built=10.0, worn=25.0)
    ripple = PLAIN.with_effects(ridge).simulate(experiment(wave)).require().outputs[0][0] - without
    timepts = STEP * np.arange(wave.size)
    inside = np.abs(without - rest) < 5e-5
    acting = (timepts > 12.0) & (timepts < 23.0)
    assert np.abs(ripple[acting & inside]).max() > 5e-6
    assert np.abs(ripple[timepts < 5.0]).max() < 1e-8  # ten growth times of 0.5 s before
    assert np.abs(ripple[timepts > 32.0]).max() < 1e-6
    far = acting & (np.abs(without - rest) > 2e-4)
    assert np.abs(ripple[far]).max() < 0.2 * np.abs(ripple[acting & inside]).max()


@pytest.mark.parametrize(
    ("name", "step"), [("force", 1e-3), ("lower", 1e-6), ("upper", 1e-6), ("built", 2e-4), ("worn", 2e-4)]
)
def test_sensitivities_agree_with_central_differences(name: str, step: float, rest: float) -> None:
    ridge = GreaseRidge(force=1e-5, lower=rest - 5e-6, upper=rest + 8e-6, built=4.3, worn=5.2)
    commands = 3.1 + 0.01 * np.sin(2 * np.pi * STEP * np.arange(300))
    (error,) = slope_errors(PLAIN.with_effects(ridge), commands, step, names=[f"grease_ridge.{name}"]).values()
    assert error < 1e-4


def test_the_specification_is_the_thesis_plant_without_its_drift() -> None:
    wished = specification()
    assert wished.effect_names == ("hysteresis",)
    assert wished.rig.noise == wished.rig.chain.noise  # type: ignore[union-attr]
    assert replace(wished.rig, chain=None, noise=RIG.noise) == RIG
