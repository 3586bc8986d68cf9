"""Stretches in which a reading is noisier: what is marked, and what is not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.mismatch.quality.bursts import noisier
from deatwin.ident.mismatch.quality.compared import without_faults
from deatwin.ident.mismatch.quality.quality import Soundness, check_quality, split
from deatwin.ident.mismatch.quality.suspects import spikes
from deatwin.plant import Experiment, Planar, Plant, Reading, Recording

STRETCH = slice(600, 800)
PLANT = Plant(rig=Planar(noise=2e-6, further=(Reading(name="capacitance", noise=1e-12),)))


def marked(added: np.ndarray, command: np.ndarray | None = None, seed: int = 0) -> np.ndarray:
    """Samples that are marked in white noise of unit variance with something added in the stretch."""
    residual = np.random.default_rng(seed).standard_normal(1500)
    residual[STRETCH] += added
    (mask,) = noisier([residual], [np.zeros(1500) if command is None else command], 1.0)
    return mask


@pytest.mark.parametrize("seed", range(5))
def test_a_burst_is_marked_to_a_window(seed):
    mask = marked(4.0 * np.random.default_rng(100 + seed).standard_normal(200), seed=seed)
    assert mask[STRETCH].mean() > 0.9
    assert mask.sum() <= 200 + 2 * 50


@pytest.mark.parametrize(
    "added",
    [
        30.0 * np.sin(np.linspace(0.0, np.pi, 200)),
        6.0 * np.sin(2 * np.pi * 0.2 * np.arange(200)),
        6.0 * np.sin(2 * np.pi * 0.45 * np.arange(200)),
        6.0 * np.sin(2 * np.pi * 0.33 * np.arange(200)),
        lfilter([4.0], [1.0, 0.9, 0.81], np.random.default_rng(4).standard_normal(200)),
        100.0 * (np.arange(200) == 77),
        100.0 * (np.arange(200) % 40 == 7) + 3.0 * (np.arange(200) % 40 == 8),
        30.0 * np.exp(-(np.arange(200) % 50) / 8) * np.cos(2 * np.pi * 0.15 * np.arange(200)),
    ],
    ids=["a hump", "a tone", "a fast tone", "a tone as white as noise", "a mode", "one value", "peaks", "ringing"],
)
def test_what_is_no_white_noise_is_no_burst(added):
    assert not marked(added).any()


@pytest.mark.parametrize("size", [10.0, 20.0, 100.0])
def test_a_loud_burst_is_no_heap_of_outliers(size):
    """Of normal noise hardly a value is usual then: none of ten draws has an outlier, and each stretch is a burst."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        residual = rng.standard_normal(1500)
        residual[STRETCH] += size * rng.standard_normal(200)
        assert not spikes(residual).any()
        assert noisier([residual], [np.zeros(1500)], 1.0)[0][STRETCH].all()


@pytest.mark.parametrize(("many", "least"), [(1, 1.0), (5, 0.9)])
def test_outliers_are_no_burst(many, least):
    """Of values fifty deviations off, so many in 200 and none within five samples of another, nearly all are found."""
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        residual = rng.standard_normal(1500)
        off = rng.choice(np.arange(600, 800, 6), many, replace=False)
        residual[off] += 50.0 * rng.choice([-1.0, 1.0], many)
        found.append(spikes(residual)[off].mean())
        assert spikes(residual).sum() <= many
        assert not noisier([np.where(spikes(residual), np.nan, residual)], [np.zeros(1500)], 1.0)[0].any()
    assert np.mean(found) >= least


def test_noise_that_goes_with_the_command_may_be_the_plants_own():
    """A plant that lacks a dead time leaves noise where its command is noise, and nothing where that rests."""
    command = np.zeros(1500)
    command[STRETCH] = np.random.default_rng(1).standard_normal(200)
    added = 4.0 * np.random.default_rng(2).standard_normal(200)
    assert not marked(added, command).any()
    assert marked(added, np.random.default_rng(1).standard_normal(1500)).any()


def test_white_noise_has_no_bursts():
    rng = np.random.default_rng(3)
    found = [noisier([rng.standard_normal(3000)], [np.zeros(3000)], 1.0)[0].any() for _ in range(100)]
    assert sum(found) <= 1


@pytest.mark.parametrize("row", [0, 1])
def test_a_burst_is_said_and_left_out_of_its_own_reading(row):
    rng = np.random.default_rng(4)
    command = np.repeat(rng.uniform(0.5, 1.5, 40), 25)
    blank = Experiment(recordings=(Recording.from_arrays(command, np.zeros((0, 1000)), PLANT.rig.sample_time),))
    (record,) = PLANT.record(blank, rng).recordings
    spoilt = np.array(record.outputs)
    spoilt[row, STRETCH] += 8.0 * PLANT.rig.readings[row].noise * rng.standard_normal(200)
    checked = without_faults(check_quality(PLANT, Experiment(recordings=(replace(record, outputs=spoilt),))), PLANT)
    assert checked.soundness is Soundness.SOUND
    assert f"the {('reading', 'capacitance')[row]} is much noisier than elsewhere" in checked.notes[0]
    parts = split(checked, weights={"capacitance": 1.0})[2]
    left = [not part.masks[0][650:750].any() for part in parts]
    assert left == [row == 0, row == 1]
    assert parts[row].size > 700 and parts[1 - row].size == 1000


@pytest.mark.parametrize("seed", range(5))
def test_a_burst_is_found_beside_missing_physics_many_times_as_large(seed):
    """What a plant lacks is slow, and lies in the other windows as well: here filtered noise of forty deviations."""
    rng = np.random.default_rng(20 + seed)
    slow = lfilter([1.0], np.poly([0.97, 0.97]), rng.standard_normal(1500))
    missing = slow * 40.0 / np.std(slow)
    residual = missing + rng.standard_normal(1500)
    assert not noisier([residual], [np.zeros(1500)], 1.0)[0].any()
    residual[STRETCH] += 6.0 * rng.standard_normal(200)
    (mask,) = noisier([residual], [np.zeros(1500)], 1.0)
    assert mask[STRETCH].mean() > 0.9
    assert mask.sum() <= 200 + 2 * 50
    residual = missing + rng.standard_normal(1500)
    residual[STRETCH] += 8.0 * np.sin(2 * np.pi * 0.33 * np.arange(200))
    assert not noisier([residual], [np.zeros(1500)], 1.0)[0].any()
