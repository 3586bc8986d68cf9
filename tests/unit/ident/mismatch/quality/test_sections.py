"""Recordings are divided where the command changes its kind, and nowhere else."""

import numpy as np
import pytest
from scipy.stats import binom

from deatwin.ident.mismatch.quality.quality import check_quality, split
from deatwin.ident.mismatch.quality.sections import FEWEST, LEVEL, WINDOWS, changes, in_sections
from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.excitation import band_limited_noise, linear_chirp, random_holds


def recorded(*commands: np.ndarray) -> Experiment:
    command = np.concatenate(commands)
    return Experiment(recordings=(Recording.from_arrays(command, 0 * command, 0.02, start=3.0),))


@pytest.mark.parametrize("seed", range(5))
def test_noise_before_steps_is_divided_where_it_ends(seed):
    """To within a few windows: noise may move slowly just before."""
    rng = np.random.default_rng(seed)
    noise, steps = band_limited_noise(rng, 40.0, 0.02), random_holds(rng, 25.0, 0.02, 1.2, 3.2)
    whole = recorded(noise, steps)
    first, second = in_sections(whole).recordings
    assert abs(first.n_samples - noise.size) <= 5 * whole.recordings[0].n_samples / WINDOWS
    assert second.start == pytest.approx(first.end)
    assert np.array_equal(np.concatenate([first.inputs, second.inputs], axis=1), whole.recordings[0].inputs)


def test_a_measured_command_is_divided_in_spite_of_its_noise():
    rng = np.random.default_rng(6)
    noise, steps = band_limited_noise(rng, 40.0, 0.02), random_holds(rng, 25.0, 0.02, 1.2, 3.2)
    command = np.concatenate([noise, steps])
    assert len(in_sections(recorded(command + 1e-3 * rng.normal(size=command.size))).recordings) == 2


def test_each_kind_is_fitted_and_held_out():
    rng = np.random.default_rng(7)
    plant = Plant(rig=Diaphragm())
    blank = recorded(band_limited_noise(rng, 40.0, 0.02), random_holds(rng, 40.0, 0.02, 1.2, 3.2))
    fitted, unseen, _ = split(check_quality(plant, plant.record(blank, rng)))
    for part, share in ((fitted[0], 0.7), (unseen[0], 0.3)):
        assert [mask.mean() for mask in part.masks] == pytest.approx([share, share], abs=0.01)


def test_one_kind_is_not_divided():
    """Pettitt's test at a level of 0.1 %, for windows that depend on each other a little: at most 2 of 200."""
    rng = np.random.default_rng(8)
    kinds = [lambda: band_limited_noise(rng, 120.0, 0.02), lambda: random_holds(rng, 120.0, 0.02, 1.2, 3.2)]
    assert sum(len(in_sections(recorded(kind())).recordings) > 1 for kind in kinds for _ in range(100)) <= 2


def test_a_chirp_shows_all_its_frequencies_to_the_fit():
    chirp = recorded(linear_chirp(120.0, 0.02, 0.1, 3.0, 1.2, 3.2))
    assert len(in_sections(chirp).recordings) >= 2


def test_few_samples_are_one_section():
    assert len(in_sections(recorded(np.arange(30.0) % 7)).recordings) == 1


def test_changes_by_chance_are_as_rare_as_the_level_says():
    rng = np.random.default_rng(9)
    found = sum(bool(changes(rng.normal(size=WINDOWS))) for _ in range(2000))
    assert found <= binom.ppf(0.999, 2000, LEVEL)


def test_each_of_two_changes_is_found():
    rng = np.random.default_rng(10)
    for _ in range(50):
        values = rng.normal(size=60) + np.repeat([0.0, 12.0, 6.0], 20)
        assert changes(values) == [20, 40]


def test_no_section_is_shorter_than_the_test_needs():
    assert changes(np.r_[np.zeros(3), np.ones(57)]) == []
    assert min(np.diff([0, *changes(np.arange(60.0)), 60])) >= FEWEST
