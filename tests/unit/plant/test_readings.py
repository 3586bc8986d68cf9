"""Further readings of rigs: the current, capacitance and voltage of a film, and any signal of a rig of one's own."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_rigs import Tank

from deatwin.plant import (
    BlockedPlanar,
    ChargeInjection,
    DielectricAbsorption,
    ElectrodeLoss,
    ElectrodeRC,
    Experiment,
    Leakage,
    PermittivityDrift,
    Planar,
    Plant,
    Reading,
    Recording,
    RigError,
)
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY, conduction_density

STEP = 0.02
READINGS = (
    Reading(name="current", noise=5e-9),
    Reading(name="capacitance", noise=1e-12),
    Reading(name="film_voltage", noise=1.0),
)
BLOCKED = BlockedPlanar(further=READINGS)

pytestmark = pytest.mark.usefixtures("uncompiled")


def experiment(commands: np.ndarray) -> Experiment:
    return Experiment(recordings=(Recording.from_arrays(commands, np.zeros((0, commands.size)), STEP),))


def blocked_capacitance(rig: BlockedPlanar) -> float:
    """C = eps eps0 A^2 / volume, with the area A as it is stretched."""
    area, volume = 9.0 * rig.length * rig.width, rig.length * rig.width * rig.thickness
    return Plant(rig=rig).parameters["permittivity"].value * VACUUM_PERMITTIVITY * area**2 / volume


def held(*effects: Any, command: float = 2.0, count: int = 200) -> np.ndarray:
    """Readings of the blocked film from a step of the command on: force, current, capacitance, voltage."""
    return Plant(rig=BLOCKED, effects=effects).simulate(experiment(np.full(count, command))).require().outputs[0]


def test_a_planar_film_has_the_capacitance_of_its_area() -> None:
    rig = Planar(further=READINGS)
    commands = 1.5 + 0.8 * np.sin(0.5 * np.arange(100))
    run = Plant(rig=rig).simulate(experiment(commands)).require()
    _, _, capacitance, voltage = run.outputs[0]
    stretch = rig.prestretch + (run.outputs[0][0]) / rig.length
    area, volume = stretch**2 * rig.length * rig.width, rig.length * rig.width * rig.thickness
    permittivity = Plant(rig=rig).parameters["permittivity"].value
    assert capacitance == pytest.approx(permittivity * VACUUM_PERMITTIVITY * area**2 / volume, rel=1e-9)
    assert voltage == pytest.approx(rig.gain * commands)


def test_a_blocked_film_pulls_with_elastic_stress_less_that_of_the_field() -> None:
    command = 2.0
    pull, _, capacitance, voltage = held(command=command)
    values, stretch = Plant(rig=BLOCKED).parameters, 3.0
    modulus, limit = values["shear_modulus"].value, values["stretch_limit"].value
    # Gent's energy, stretched alike along both sides: nominal stress along one of them
    gent = modulus * limit * (stretch - stretch**-5) / (limit + 3 - 2 * stretch**2 - stretch**-4)
    field = values["permittivity"].value * VACUUM_PERMITTIVITY * (BLOCKED.gain * command / BLOCKED.thickness) ** 2
    expected = BLOCKED.thickness * BLOCKED.width * (gent - field * stretch**3)
    assert pull == pytest.approx(expected, rel=1e-9)
    # The same by virtual work: capacitance goes with the square of the stretch, at a constant stretch across.
    without = held(command=0.0)[0]
    assert without - pull == pytest.approx(voltage**2 * capacitance / (stretch * BLOCKED.length), rel=1e-9)


def test_the_current_balances_the_charge_over_a_cycle() -> None:
    period = 50
    commands = 1.5 + 0.8 * np.sin(2 * np.pi * np.arange(3 * period) / period)
    run = Plant(rig=Planar(further=READINGS)).simulate(experiment(commands)).require()
    _, current, capacitance, voltage = run.outputs[0]
    charge = capacitance * voltage
    flown = STEP * current[period + 1 : 2 * period + 1].sum()
    assert flown == pytest.approx(charge[2 * period] - charge[period], abs=1e-9 * charge.max())
    assert STEP * current.sum() == pytest.approx(charge[-1], rel=1e-9)  # from rest, where there is none


def test_a_series_resistance_delays_the_current() -> None:
    time = 0.05
    _, current, _, voltage = held(ElectrodeRC(time=time, film_share=1.0))
    ends = STEP * np.arange(1, 201)
    assert voltage == pytest.approx(1600.0 * (1 - np.exp(-ends / time)), rel=1e-6)
    expected = blocked_capacitance(BLOCKED) * np.diff(1600.0 * (1 - np.exp(-ends / time)), prepend=0.0) / STEP
    assert current == pytest.approx(expected, abs=1e-6 * expected.max())


def test_a_drifting_permittivity_draws_current_at_a_constant_voltage() -> None:
    _, current, capacitance, _ = held(PermittivityDrift(relative_change=-0.1, time=100.0))
    ends = STEP * np.arange(1, 201)
    drifting = blocked_capacitance(BLOCKED) * (1 - 0.1 * (1 - np.exp(-ends / 100.0)))
    assert capacitance == pytest.approx(drifting, rel=1e-9)
    assert current[1:] == pytest.approx(1600.0 * np.diff(drifting) / STEP, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "missing", "seen"),
    [(DielectricAbsorption, lambda decay: decay, 0.95), (ChargeInjection, lambda decay: 1 - decay, 1.0)],
)
def test_charge_that_is_absorbed_or_injected_flows_late_and_no_bridge_sees_it_go(
    kind: Any, missing: Callable[[np.ndarray], np.ndarray], seen: float
) -> None:
    share, time = 0.05, 1.0
    _, current, capacitance, _ = held(kind(share=share, time=time))
    charge = 1600.0 * blocked_capacitance(BLOCKED) * (1 - share * missing(np.exp(-STEP * np.arange(1, 201) / time)))
    assert capacitance == pytest.approx(seen * blocked_capacitance(BLOCKED), rel=1e-9)
    assert current[1:] == pytest.approx(np.diff(charge) / STEP, rel=1e-6)


def test_the_charge_of_a_lost_electrode_does_not_come_back() -> None:
    _, current, capacitance, _ = held(ElectrodeLoss(share=0.2, at=2.0))
    whole = blocked_capacitance(BLOCKED)
    assert capacitance[[50, -1]] == pytest.approx([whole, 0.8 * whole], rel=1e-9)
    assert np.abs(current[1:]).max() < 1e-9 * current[0]


def test_a_leak_is_read_as_the_drop_over_the_known_resistance() -> None:
    known = 2e8
    rig = replace(BLOCKED, further=(replace(READINGS[0], series_resistance=known), READINGS[2]))
    leak = Leakage(resistance=1e9, field_scale=30e6)
    run = Plant(rig=rig, effects=(leak,)).simulate(experiment(np.full(20, 3.0))).require()
    _, current, voltage = run.outputs[0]
    area = 9.0 * rig.length * rig.width
    density = float(conduction_density(voltage[-1] / rig.thickness * 9.0, field_scale=leak.field_scale))
    assert current[-1] == pytest.approx((2400.0 - voltage[-1]) / known, rel=1e-9)
    assert current[-1] == pytest.approx(leak.resistance / known * density * area, rel=1e-6)
    none = Plant(rig=rig, effects=(replace(leak, resistance=0.0),)).simulate(experiment(np.full(20, 3.0))).require()
    assert none.outputs[0][1, 1:] == pytest.approx(0.0, abs=1e-15)


def test_derivatives_of_readings_are_those_of_differences() -> None:
    plant = Plant(rig=BLOCKED)
    commands = 1.5 + 0.8 * np.sin(0.5 * np.arange(60))
    options = {"start": 0.0, "sample_time": STEP, "rest_command": 0.0}
    values = plant.free_values
    run = plant.simulator.run_with_sensitivities(commands, values=values, **options)
    place = plant.parameters.free.index("permittivity")
    ends = []
    for factor in (1 + 1e-6, 1 - 1e-6):
        moved = values.copy()
        moved[place] *= factor
        ends.append(plant.simulator.run(commands, values=moved, **options).further)
    expected = (ends[0] - ends[1]) / (2e-6 * values[place])
    assert run.further == pytest.approx(plant.simulator.run(commands, values=values, **options).further)
    assert run.further_slopes[:, :, place] == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


def test_a_rig_of_ones_own_has_the_readings_that_it_watches() -> None:
    rig = Tank(
        further=(Reading(name="outflow", unit="m/s", noise=1e-3), Reading(name="filling", unit="m/s", noise=1e-3))
    )
    one = Recording.from_arrays(np.ones(50), np.zeros((0, 50)), 0.1)
    level, outflow, filling = Plant(rig=rig).simulate(Experiment(recordings=(one,))).require().outputs[0]
    ends = 0.1 * np.arange(1, 51)
    assert outflow == pytest.approx(0.5 * level)
    assert level == pytest.approx(2.0 * (1 - np.exp(-0.5 * ends)), rel=1e-9)
    assert filling == pytest.approx(np.diff(level, prepend=0.0) / 0.1)


def test_recordings_hold_every_reading_with_its_noise() -> None:
    plant = Plant(rig=Tank(further=(Reading(name="outflow", unit="m/s", noise=0.1),)))
    one = Recording.from_arrays(np.ones(2000), np.zeros((0, 2000)), 0.1)
    made = plant.record(Experiment(recordings=(one,)), np.random.default_rng(1)).recordings[0]
    exact = plant.simulate(Experiment(recordings=(one,))).outputs[0]
    assert made.output_names == ("level", "outflow")
    assert made.output_units == ("m", "m/s")
    assert np.std(made.outputs - exact, axis=1) == pytest.approx([1e-3, 0.1], rel=0.1)  # 0.016 is one deviation


def test_a_rig_with_further_readings_is_plain_data() -> None:
    again = BlockedPlanar.from_dict(BLOCKED.to_dict())
    assert again == BLOCKED
    assert "further" not in BlockedPlanar().to_dict()
    assert [reading.unit for reading in BLOCKED.readings] == ["N", "A", "F", "V"]


def test_a_reading_of_no_signal_is_refused() -> None:
    plant = Plant(rig=BlockedPlanar(further=(Reading(name="curent", noise=1.0),)))
    with pytest.raises(RigError, match='no reading "curent"; did you mean "current"'):
        plant.equations  # noqa: B018
    with pytest.raises(RigError, match='noise of the reading "current" is 0; it must be a number above 0'):
        Reading(name="current", noise=0)
    with pytest.raises(RigError, match='two readings of the rig are called "current"'):
        Plant(rig=BlockedPlanar(further=(READINGS[0], READINGS[0]))).equations  # noqa: B018
