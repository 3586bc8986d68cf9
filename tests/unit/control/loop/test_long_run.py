"""A run that is kept nowhere against one that is kept as a whole."""

import tracemalloc

import numpy as np
import pytest

from deatwin.control.loop.sine_response import LongRun
from deatwin.plant import Diaphragm, Plant
from deatwin.plant.integrator import march
from deatwin.plant.sample import SHORTER_STEPS

H = 0.02


def as_a_whole(plant, commands, start=0.0):
    """Readings before each command, as far as the plant lived."""
    run = plant.simulator.run(
        commands, start=start, sample_time=H, rest_command=plant.rig.start.rest_command, values=plant.free_values
    )
    return run.outputs[: commands.size]


def in_pieces(plant, commands, sizes, start=0.0):
    run, ends = LongRun(plant, start), np.cumsum(sizes)
    return [run.readings(piece) for piece in np.split(commands, ends) if piece.size]


@pytest.fixture
def noise():
    return np.random.default_rng(3).uniform(-1.0, 1.0, 700)


def test_pieces_of_any_size_are_one_run(late, noise):
    """Of a plant that asks for past commands and for the clock."""
    whole = as_a_whole(late, noise, start=-3.0)
    for sizes in ([700], [1, 1, 198, 1, 200, 201], [350]):
        found = np.concatenate(in_pieces(late, noise, sizes, start=-3.0))
        np.testing.assert_allclose(found, whole, rtol=1e-12, atol=1e-14)


def test_a_sample_that_the_march_does_not_solve_is_taken_in_shorter_steps(late, noise, monkeypatch):
    """Of each whole piece 0, 7 or 14 samples count as solved. Under a held command shorter steps change little."""
    calls = []

    def few(errors, levels, count):
        if count in SHORTER_STEPS:
            return count
        calls.append(count)
        return min(count, 7 * (len(calls) % 3))

    monkeypatch.setattr(march, "solved", few)
    found = np.concatenate(in_pieces(late, noise, [333]))
    assert len(calls) > 70
    monkeypatch.undo()
    np.testing.assert_allclose(found, as_a_whole(late, noise), rtol=0.0, atol=1e-12)  # of a range of 1


def test_a_plant_that_failed_says_nothing_more():
    """The film pulls in far below 12 V."""
    soft = Plant(rig=Diaphragm())
    commands = np.repeat([1.0, 12.0, 1.0], 100)
    first, *others = in_pieces(soft, commands, [100, 100])
    np.testing.assert_allclose(first, as_a_whole(soft, commands)[:100], rtol=1e-12)
    assert others == [None, None]
    restless = soft.with_values({"mass": 1.0})
    assert in_pieces(restless, commands, []) == [None]


def test_nothing_is_kept(curve):
    run, piece = LongRun(curve(lag=0.1), 0.0), np.ones(2000)
    tracemalloc.start()
    run.readings(piece)
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(10):
        run.readings(piece)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < piece.nbytes  # of the ten pieces' readings alone there are ten times as much
