"""Limits of a voltage source, against the closed forms of a capacitor that is charged."""

import json
from pathlib import Path

import numpy as np
import pytest
from runs import simulation

from deatwin.plant import BlockedPlanar, Diaphragm, Disc, Plant, RigError, Supply, load_plant
from deatwin.plant.files import write_text_atomic

STEP, VOLTS = 2e-3, 2000.0
RISE, FALL = 400, 400
TIMES = STEP * np.arange(1, RISE + 1)

pytestmark = pytest.mark.usefixtures("uncompiled")


def charged(supply: Supply) -> tuple[np.ndarray, float]:
    """Voltage of a film that is held, under a step up to 2 kV and one back to 0 V, and its capacitance."""
    commands = np.r_[np.full(RISE, VOLTS / 800.0), np.zeros(FALL)]
    watched = simulation(Plant(rig=BlockedPlanar(sample_time=STEP, supply=supply)), commands).watched[0]
    return watched["film_voltage"], float(watched["capacitance"][0])


def test_a_series_resistance_with_a_capacitance_beside_the_film() -> None:
    volts, film = charged(Supply(series_resistance=1e7, parallel_capacitance=10e-9))
    time = 1e7 * (film + 10e-9)
    np.testing.assert_allclose(volts[:RISE], VOLTS * -np.expm1(-TIMES / time), rtol=1e-3)
    np.testing.assert_allclose(volts[RISE:], volts[RISE - 1] * np.exp(-TIMES / time), rtol=1e-3)


def test_a_limited_current_charges_evenly_and_then_by_the_resistance() -> None:
    supply = Supply(current_limit=100e-6, sink_current=50e-6, series_resistance=1e6)
    volts, film = charged(supply)
    # Even up to the last volts that the resistance drops at the limit, 100 V, and then exponential.
    turn = film * (VOLTS - 100.0) / 100e-6
    expected = np.where(turn > TIMES, 100e-6 * TIMES / film, VOLTS - 100.0 * np.exp(-(TIMES - turn) / (1e6 * film)))
    np.testing.assert_allclose(volts[:RISE], expected, atol=0.015 * VOLTS)
    np.testing.assert_allclose(volts[20:120], expected[20:120], rtol=1e-6)
    slope = np.diff(volts[RISE : RISE + 100]) / STEP
    np.testing.assert_allclose(slope, -50e-6 / film, rtol=1e-3)  # back it goes half as fast


def test_a_converter_that_cannot_sink_falls_through_its_bleeder() -> None:
    volts, film = charged(Supply(sink_current=0.0, series_resistance=1e4, bleed_resistance=50e6))
    assert volts[RISE - 1] == pytest.approx(VOLTS * 50e6 / (50e6 + 1e4), rel=1e-6)
    np.testing.assert_allclose(volts[RISE:], volts[RISE - 1] * np.exp(-TIMES / (50e6 * film)), rtol=1e-3)


@pytest.mark.parametrize("limit", [200e-6, 20e-6, None])
def test_a_converter_that_cannot_sink_holds_the_peak_of_a_disc(limit: float | None) -> None:
    commands = np.r_[np.linspace(0.0, 1.0, 50), np.zeros(50)]
    rig = Disc(
        sample_time=0.02, gain=1000.0, supply=Supply(current_limit=limit, sink_current=0.0, bleed_resistance=5e9)
    )
    watched = simulation(Plant(rig=rig), commands).watched[0]
    volts, film = watched["film_voltage"], watched["capacitance"]
    # The charging is faster than a sample by far: a step goes a little beyond, and nothing takes that back.
    np.testing.assert_allclose(volts[5:50], 1e3 * commands[5:50], atol=20.0)
    # The charge falls through the bleeder; the film's own leakage takes a little more.
    charge, lost = volts * film, 0.02 * np.cumsum(volts[50:]) / 5e9
    left = charge[50:] / (charge[49] - lost)
    assert np.all((left > 0.9) & (left < 1.0))


def test_the_limits_hold_alike_for_both_polarities() -> None:
    commands = np.r_[np.full(50, 2.5), np.full(50, 1.0)]
    both = []
    for sign in (1.0, -1.0):
        rig = BlockedPlanar(sample_time=STEP, supply=Supply(current_limit=100e-6, sink_current=0.0))
        both.append(sign * simulation(Plant(rig=rig), sign * commands).watched[0]["film_voltage"])
    assert both[0][49] > 500.0
    np.testing.assert_allclose(both[1], both[0], rtol=1e-9, atol=1e-9)


def test_a_supply_without_limits_is_none() -> None:
    volts, _ = charged(Supply())
    np.testing.assert_allclose(volts[[20, RISE - 1, RISE + 20]], [VOLTS, VOLTS, 0.0], atol=0.1)


def test_a_rig_file_describes_it_and_a_model_keeps_it(tmp_path: Path) -> None:
    text = Path(__file__).parents[2].joinpath("shared", "rig.toml").read_text(encoding="utf-8")
    limits = "[drive]\ncurrent_limit_uA = 200\nsink_current_uA = 0\nbleed_resistance_Mohm = 500\n"
    write_text_atomic(tmp_path / "rig.toml", text.replace("[drive]\n", limits))
    plant = load_plant(tmp_path / "rig.toml").plant
    assert plant.rig.supply == Supply(current_limit=200e-6, sink_current=0.0, bleed_resistance=500e6)
    assert Plant.from_dict(json.loads(json.dumps(plant.to_dict()))).rig == plant.rig
    assert "supply" not in Plant(rig=Diaphragm()).to_dict()["rig"]
    own = text.replace("gain = 800.0", 'input = "film voltage"')
    write_text_atomic(tmp_path / "own.toml", own.replace("[drive]\n", "[drive]\ncurrent_limit_uA = 200\n"))
    with pytest.raises(RigError, match="current_limit_uA: the input of this rig is the voltage on the film"):
        load_plant(tmp_path / "own.toml")
