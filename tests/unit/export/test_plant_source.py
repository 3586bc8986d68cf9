"""One sample of a plant as C, against deatwin's own simulation."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from deatwin.plant import (
    Coupon,
    Creep,
    Delay,
    Diaphragm,
    Experiment,
    PeriodicDisturbance,
    Plant,
    Reading,
    ReadingTime,
    Recording,
    StartProcedure,
)
from deatwin.plant.effects import effect_named
from deatwin.plant.errors import ModelError
from deatwin.plant.export.plant_step import plant_source
from deatwin.plant.rigs.planar import Planar

LOOSE = ("-std=c99",)
"""CasADi's code has unused variables."""
STRIP = Plant(rig=Coupon(sample_time=0.1)).with_effects(Creep(modulus=60e3, time=25.0))
SHEET = Plant(rig=Planar(sample_time=0.02)).with_effects(Delay(time=0.03), effect_named("sensor_drift"))
LEAK = Plant(
    rig=Planar(
        sample_time=0.02,
        further=(Reading(name="current", noise=5e-9, series_resistance=1e8), Reading(name="capacitance", noise=1e-12)),
    )
).with_effects(effect_named("leakage"))
WARM = Plant(rig=Planar(sample_time=0.02)).with_effects(effect_named("thermal_stiffness"))


def commands(plant: Plant, low: float, high: float, count: int = 60) -> np.ndarray:
    return np.repeat(np.random.default_rng(3).uniform(low, high, count // 5), 5)


@pytest.mark.parametrize(("plant", "low", "high"), [(STRIP, 1.0, 2.0), (SHEET, 0.0, 3.0)], ids=["strip", "sheet"])
def test_the_source_steps_as_the_simulation_does(plant: Plant, low: float, high: float, run_c: Any) -> None:
    held = commands(plant, low, high)
    expected = plant.simulator.run(
        held,
        start=0.0,
        sample_time=plant.rig.sample_time,
        rest_command=plant.rig.start.rest_command,
        values=plant.free_values,
    )
    source = plant_source(plant, name="rig")
    found, status = run_c(source, held[:, None], *LOOSE)
    size = np.ptp(expected.outputs)
    assert not status.any() and size > 0.0
    # The same arithmetic, compiled with other flags: Newton's method leaves 1e-10 of each unknown's scale.
    np.testing.assert_allclose(found[:, 0], expected.outputs[1:], rtol=0, atol=1e-9 * size)
    assert [s.name for s in source.outputs[1:]] == [f"signal.{s}" for s in plant.equations.signals]
    np.testing.assert_allclose(found[:, 1:], expected.watched.T, rtol=1e-8, atol=1e-12)


def test_further_readings_are_outputs_behind_the_first(run_c: Any) -> None:
    """The current is a mean over the sample, so the source remembers the charge."""
    held = commands(LEAK, 0.0, 3.0)
    expected = LEAK.simulator.run(held, start=0.0, sample_time=0.02, rest_command=0.0, values=LEAK.free_values)
    source = plant_source(LEAK)
    assert [(s.name, s.unit) for s in source.outputs[1:3]] == [("current", "A"), ("capacitance", "F")]
    found, _ = run_c(source, held[:, None], *LOOSE)
    further = expected.further[1:]
    np.testing.assert_allclose(found[:, 1:3], further, rtol=0, atol=1e-8 * np.ptp(further, axis=0).min(initial=1e-4))
    np.testing.assert_allclose(found[:, 3:], expected.watched.T, rtol=1e-8, atol=1e-12)


class Ramped(Planar):
    """A strip whose first command is ramped on and held before time 0."""

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=2.0, hold=3.0)


def test_the_start_procedure_played_on_its_clock_gives_what_simulate_does(run_c: Any) -> None:
    """A tone shakes the film before time 0 already: 5 s, in which it goes through 9.5 periods."""
    tone = replace(PeriodicDisturbance().placed("force"), amplitude=0.05, frequency=1.9)
    plant = Plant(rig=Ramped(sample_time=0.02)).with_effects(tone)
    held = commands(plant, 0.0, 2.0)
    experiment = Experiment(recordings=(Recording.from_arrays(held, np.zeros((0, held.size)), 0.02),))
    expected = plant.simulate(experiment).require().outputs[0][0]
    before = plant.timeline(experiment)
    assert before.start == pytest.approx(-5.0)
    given = before.commands[:, None]
    found, _ = run_c(plant_source(plant, name="film"), given, *LOOSE, start=before.start)
    assert found[-held.size :, 0] == pytest.approx(expected, abs=1e-9 * np.ptp(expected))


def test_an_unknown_start_is_exported_with_the_distance_from_rest_that_was_fitted(run_c: Any) -> None:
    """The first command is held for a second before the first sample; the film is then still not at rest."""
    rest = Plant(rig=Diaphragm(start_is_known=False)).with_effects(Creep())
    plant = rest.with_values({"branch_at_start": 0.1, "creep.at_start": -0.05})
    held = commands(plant, 1.0, 3.0)
    expected = plant.simulate(Recording.from_arrays(held, np.zeros(held.size), 0.02)).require().outputs[0][0]
    source = plant_source(plant, name="film")
    found, _ = run_c(source, np.r_[np.full(50, held[0]), held][:, None], *LOOSE, start=-1.0)
    assert found[-held.size :, 0] == pytest.approx(expected, abs=1e-9 * np.ptp(expected))
    assert "/* The plant starts at rest under a command of 0.0, apart from branch_at_start and creep.at_start. */" in (
        source.text
    )
    assert "/* The plant starts at rest under a command of 0.0. */" in plant_source(rest).text


def test_readings_at_the_start_of_the_hold_are_those_of_the_row_before(run_c: Any) -> None:
    plant = Plant(rig=Planar(sample_time=0.02, reading=ReadingTime.START_OF_HOLD, start_ramp=0.0, start_hold=0.0))
    held = np.r_[0.0, commands(plant, 0.0, 2.0)]
    expected = plant.simulate(Recording.from_arrays(held, np.zeros(held.size), 0.02)).require().outputs[0][0]
    found, _ = run_c(plant_source(plant, name="film"), held[:, None], *LOOSE)
    assert found[:-1, 0] == pytest.approx(expected[1:], abs=1e-9 * np.ptp(expected))


def test_a_measured_channel_is_an_input_and_a_sample_that_cannot_be_solved_leaves_the_state(run_c: Any) -> None:
    held = commands(WARM, 0.0, 3.0)
    warmth = np.linspace(20.0, 45.0, held.size)
    expected = WARM.simulator.run(
        held,
        start=0.0,
        sample_time=0.02,
        rest_command=WARM.rig.start.rest_command,
        values=WARM.free_values,
        channels={"temperature": warmth},
    )
    source = plant_source(WARM)
    assert [s.name for s in source.inputs] == ["command", "temperature"]
    given = np.column_stack([held, warmth])
    unsolved = 30  # at a megavolt no equilibrium is in reach
    found, status = run_c(source, np.insert(given, unsolved, [1000.0, 20.0], axis=0), *LOOSE)
    np.testing.assert_array_equal(np.flatnonzero(status), [unsolved])
    np.testing.assert_array_equal(found[unsolved], found[unsolved - 1])
    found = np.delete(found[:, 0], unsolved)
    np.testing.assert_allclose(found, expected.outputs[1:], rtol=0, atol=1e-9 * np.ptp(expected.outputs))


def test_a_plant_without_rest_is_refused() -> None:
    with pytest.raises(ModelError, match="cannot be exported: no state of rest"):
        plant_source(Plant(rig=Diaphragm(mass=1.0)))  # a kilogramme on half a millimetre of VHB
