"""Loss of the electrode's rim."""

import numpy as np
import pytest

from deatwin.plant import Diaphragm, ElectrodeRC, Planar, Plant, Supply
from deatwin.plant.effects.electrode_loss import ElectrodeLoss
from deatwin.plant.effects.sensor_jump import SensorJump

HOLDS = np.concatenate([np.full(100, 1.2), np.zeros(100), np.full(100, 1.2), np.zeros(100)])

pytestmark = pytest.mark.usefixtures("uncompiled")


@pytest.fixture
def damped():
    # No branch and no ringing, so that each hold of 2 s ends in equilibrium.
    return Plant(rig=Diaphragm(), values={"damping": 0.5, "branch_modulus": 1.0})


def run(plant, experiment, commands):
    done = plant.simulate(experiment(commands)).require()
    return done.outputs[0][0], done.watched[0]


def test_a_loss_takes_its_area_off_the_capacitance(base, experiment):
    at_rest = np.zeros(60)
    whole = run(base, experiment, at_rest)[1]["capacitance"]
    left = run(base.with_effects(ElectrodeLoss(share=0.3, at=0.5)), experiment, at_rest)[1]["capacitance"]
    np.testing.assert_allclose(left[:20], whole[:20], rtol=1e-9)  # 20 widths before
    # a flat film is uniform; the sag of 1 mm over 40 mm stretches it by less than 0.1 % more near the ball
    assert 1 - left[-1] / whole[-1] == pytest.approx(0.3, rel=0.005)


def test_a_loss_leaves_rest_and_a_jump_does_not(damped, experiment):
    before, after = slice(195, 200), slice(395, 400)
    loss, _ = run(damped.with_effects(ElectrodeLoss(share=0.5, at=4.0)), experiment, HOLDS)
    jump, _ = run(damped.with_effects(SensorJump(change=-5e-6, at=4.0)), experiment, HOLDS)
    # the ball has settled, and the two zones of the reduced film meet elsewhere: 1e-5 of the sag of 1 mm
    np.testing.assert_allclose(loss[before], 0.0, atol=1e-8)
    np.testing.assert_allclose(loss[after], 0.0, atol=1e-8)
    np.testing.assert_allclose(jump[after], -5e-6, atol=1e-9)
    assert loss[299] < 0.95 * loss[99]


def test_it_is_even_and_takes_a_sample(base, experiment):
    plant = base.with_effects(ElectrodeLoss(share=0.5, at=1.01))
    up, signals = run(plant, experiment, np.full(100, 2.0))
    down, _ = run(plant, experiment, np.full(100, -2.0))
    np.testing.assert_allclose(up, down, atol=1e-12)
    steps = np.abs(np.diff(signals["capacitance"]))
    assert steps[47:53].sum() > 10 * steps[40:46].sum()


def test_it_starts_where_the_motion_falls():
    times = 0.02 * np.arange(3000)
    rng = np.random.default_rng(9)
    residual = 2e-6 * rng.standard_normal(3000) + np.where(times < 33.0, 3e-6, -4e-6)
    starts = ElectrodeLoss(share=0.3).starts(times, residual)
    assert starts[0].at == pytest.approx(33.0, abs=0.02)
    assert {s.share for s in starts} == {0.3}
    assert ElectrodeLoss().starts(times, 1e-6 * (times > 20.0)) == ()  # a motion that grows is no loss


def charged(experiment, commands, effects=(), supply=None):
    """Voltage and capacitance of a film whose capacitance has grown to 2.5 of that at rest, and half of which is lost
    after 1 s. It is damped so strongly that it hardly moves in a second.
    """
    rig = Planar(damping=3e3, gain=1000.0, start_ramp=50.0, start_hold=250.0, supply=supply)
    plant = Plant(rig=rig, effects=(*effects, ElectrodeLoss(share=0.5, at=1.01)), values={"branch_modulus": 1.0})
    watched = plant.simulate(experiment(commands)).require().watched[0]
    return watched["film_voltage"], watched["capacitance"]


@pytest.mark.parametrize("film_share", [0.0, 1.0])
def test_a_lost_part_takes_its_charge_along(experiment, film_share):
    volts, capacitance = charged(experiment, np.full(60, 2.5), (ElectrodeRC(time=0.5, film_share=film_share),))
    assert capacitance[59] == pytest.approx(capacitance[40] / 2, rel=0.01)
    # Nothing but the film's slow contraction, of 0.5 % here, moves charge through the resistance.
    np.testing.assert_allclose(volts, 2500.0, rtol=0.005)


def test_a_lost_part_does_not_serve_the_source(experiment):
    beside = 100e-9
    supply = Supply(sink_current=0.0, parallel_capacitance=beside)
    commands = np.r_[np.full(60, 2.5), np.zeros(200)]
    volts, capacitance = charged(experiment, commands, supply=supply)
    np.testing.assert_allclose(volts[:60], 2500.0, rtol=1e-3)  # the nodes of a step take the loss to a part in 1000
    # Without a bleeder, what has contact keeps its charge while the film contracts; LEAST_SUNK takes 4 pC.
    charge = (volts * (capacitance + beside))[62:]
    assert np.ptp(capacitance[62:]) > 0.02 * capacitance[62]
    np.testing.assert_allclose(charge, charge[0], rtol=1e-6)
