"""The solver on problems with holes, where a plant could not be simulated."""

import numpy as np
import pytest

from deatwin.ident.greybox.minimum import minimise


class Bowl:
    """Residuals x - target from a start, over 0 to 1; None where a hole says so."""

    def __init__(self, start, hole):
        self._start, self._hole = np.array(start), hole

    def start(self):
        return self._start

    def bounds(self):
        return np.zeros_like(self._start), np.ones_like(self._start)

    def evaluate(self, x):
        return None if self._hole(x) else (0.4 - x, np.eye(x.size))  # derivative of the readings x


def test_the_least_squares_of_a_bowl_are_its_bottom():
    found = minimise(Bowl([0.9, 0.1], lambda x: False))
    assert found is not None and found.settled
    assert found.coordinates == pytest.approx(0.4, abs=1e-6)


def test_a_hole_beside_the_way_is_walked_around():
    found = minimise(Bowl([0.9], lambda x: bool(np.any(x > 0.95))))
    assert found is not None
    assert found.coordinates == pytest.approx(0.4, abs=1e-6)


def test_a_start_on_a_bound_with_nothing_inside_is_no_start():
    """The solver begins strictly inside the bounds: there the plant fails, though on the bound it did not."""
    assert minimise(Bowl([1.0], lambda x: bool(np.any(x < 1.0)))) is None


def test_a_start_that_fails_is_none():
    assert minimise(Bowl([0.5], lambda x: True)) is None
