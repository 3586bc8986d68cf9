"""Gaps in which the command changes: what is left out behind them is what nobody can know, and no more."""

import numpy as np
import pytest
from oscillator import MASS, Oscillator

from deatwin.ident.mismatch.quality.compared import without_unknown
from deatwin.ident.mismatch.quality.quality import check_quality, split
from deatwin.plant import Experiment, Planar, Plant, Reading, Recording

PLANT = Plant(rig=Planar(noise=1e-6, model_error=0.0, further=(Reading(name="capacitance", noise=1e-15),)))


def gapped(changes_at: int) -> Experiment:
    """20 s of the plant's readings without those of samples 300 to 350; the command changes within or after these."""
    step, count = PLANT.rig.sample_time, 1000
    command = np.where(np.arange(count) < changes_at, 1.5, 2.5) + 0.2 * np.sin(np.arange(count) / 9.0) * (
        np.abs(np.arange(count) - 325) > 60
    )
    blank = Recording.from_arrays(command, np.zeros((0, count)), step)
    whole = PLANT.rig.with_effects().record(Experiment(recordings=(blank,)), np.random.default_rng(0)).recordings[0]
    return Experiment(recordings=(whole.section(0, 300), whole.section(350, count)))


def test_readings_count_again_where_the_time_of_the_change_no_longer_matters():
    experiment = gapped(330)
    checked = without_unknown(check_quality(PLANT, experiment), PLANT, PLANT.rig.noise)
    before, after = checked.unknown[0]
    assert not before.any()
    first = int(after.sum())
    assert 0 < first < after.size
    assert after[:first].all()
    residual = np.abs(experiment.recordings[1].outputs[0] - PLANT.simulate(experiment).require().outputs[1][0])
    assert residual[:first].max() > 20 * PLANT.rig.noise
    assert residual[first:].max() < 6 * PLANT.rig.noise  # one deviation of the noise's five is the gap's
    assert not (split(checked)[2][0].masks[1] & after).any()
    assert not checked.known("capacitance")[0][1][:first].any()
    assert (
        f"left out because it is unknown when the command changed during a gap in the recording: {first} samples"
        in checked.notes[0]
    )


def behind_a_wander(rate: float, seed: int) -> tuple[float, float]:
    """Time left out behind a second without readings of a swinging mass, and the largest residual after it, in deviations."""
    rig = Oscillator(noise=1e-6)
    plant = Plant(rig=rig).with_values({"damping": 2 * MASS * rate})
    rng = np.random.default_rng(seed)
    command = 5.0 * rng.standard_normal(2000)
    blank = Experiment(recordings=(Recording.from_arrays(command, np.zeros((0, 2000)), rig.sample_time),))
    (whole,) = plant.record(blank, rng).recordings
    gapped = Experiment(recordings=(whole.section(0, 500), whole.section(550, 2000)))
    left_out = without_unknown(check_quality(plant, gapped), plant, rig.noise).unknown[0][1]
    residual = gapped.recordings[1].outputs[0] - plant.simulate(gapped).require().outputs[1][0]
    return left_out.sum() * rig.sample_time, float(np.abs(residual[~left_out]).max() / rig.noise)


@pytest.mark.usefixtures("uncompiled")
def test_behind_a_gap_a_plant_that_swings_is_left_out_as_long_as_it_does():
    """Fifty kicks of 5 mN over 20 ms, at random, leave a motion of 5e-3 * 0.02 / m * sqrt(50) / omega, a thousand deviations,
    which falls to one in 7 decay times; a guess that is wrong by a factor of e is one decay time off. It leaves up to e
    deviations beside the four of the noise: above seven lies one in ten at most.
    """
    found = {rate: np.array([behind_a_wander(rate, seed) for seed in range(5)]) for rate in (0.4, 0.8)}
    times, largest = (np.array([found[rate][:, column] for rate in found]) for column in (0, 1))
    decays = times * np.array(list(found))[:, None]
    assert ((5.5 < decays) & (decays < 8.0)).all()
    assert (largest > 7.0).sum() <= 1


@pytest.mark.parametrize("changes_at", [400, 2000], ids=["after it", "never"])
def test_a_command_that_is_the_same_behind_a_gap_was_held(changes_at):
    checked = check_quality(PLANT, gapped(changes_at))
    assert without_unknown(checked, PLANT, PLANT.rig.noise) is checked


def test_where_hardly_a_reading_would_count_all_do():
    """Without noise or model error a difference counts as long as there is any."""
    before, after = gapped(330).recordings
    checked = check_quality(PLANT, Experiment(recordings=(before.section(260, 300), after)))
    assert without_unknown(checked, PLANT, 0.0) is checked
