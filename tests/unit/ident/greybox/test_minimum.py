"""The solver on problems with holes, where a plant could not be simulated."""

import numpy as np
import pytest

from deatwin.ident.greybox import FitStatus
from deatwin.ident.greybox.minimum import CLOSE, LOOKS, minimise


class Bowl:
    """Residuals x - target from a start, over 0 to 1; None where a hole says so."""

    def __init__(self, start, hole):
        self._start, self._hole = np.array(start), hole

    def start(self):
        return self._start

    def bounds(self):
        return np.zeros_like(self._start), np.ones_like(self._start)

    def smooth(self):
        return np.ones(self._start.size, dtype=bool)

    def evaluate(self, x):
        return None if self._hole(x) else (0.4 - x, np.eye(x.size))  # derivative of the readings x


def test_the_least_squares_of_a_bowl_are_its_bottom():
    found = minimise(Bowl([0.9, 0.1], lambda x: False))
    assert found is not None and found.status is FitStatus.SETTLED
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


class Tray(Bowl):
    """Two residuals that no parameter can lower stand beside those of the bowl: a least rms is known."""

    LEFT = np.array([3.0, -4.0])

    def evaluate(self, x):
        left, jacobian = super().evaluate(x)
        return np.concatenate([left, self.LEFT]), np.vstack([jacobian, np.zeros((2, x.size))])


def test_a_fit_is_given_up_where_its_linearised_minimum_is_too_high():
    least = np.sqrt(25.0 / 4)
    tray = Tray([0.9, 0.1], lambda x: False)
    lost = minimise(tray, hopeless=0.99 * least)
    assert lost.status is FitStatus.GIVEN_UP and lost.evaluations == LOOKS
    # What is handed back is a point of the fit, the better one of those looked at.
    residuals, jacobian = tray.evaluate(lost.coordinates)
    np.testing.assert_array_equal(lost.residuals, residuals)
    np.testing.assert_array_equal(lost.jacobian, jacobian)
    start = tray.evaluate(tray.start())[0]
    assert lost.residuals @ lost.residuals <= start @ start


def test_a_fit_with_hope_goes_on_as_if_nobody_had_looked():
    least = np.sqrt(25.0 / 4)
    free, watched = (minimise(Tray([0.9, 0.1], lambda x: False), hopeless=h) for h in (np.inf, 1.01 * least))
    assert watched.status is FitStatus.SETTLED
    np.testing.assert_array_equal(watched.coordinates, free.coordinates)
    assert watched.evaluations == free.evaluations


def test_a_start_on_a_bound_counts_as_one_look():
    least = np.sqrt(25.0 / 3)
    lost = minimise(Tray([1.0], lambda x: False), hopeless=0.99 * least)
    assert lost.status is FitStatus.GIVEN_UP
    assert lost.evaluations == 3  # on the bound, off it by a hair, and one step on
    assert lost.coordinates == pytest.approx(0.4, abs=0.5)


def test_a_fit_ends_where_two_linear_models_foresee_its_minimum():
    tray = Tray([0.9, 0.1], lambda x: False)
    ended = minimise(tray, foreseen=0.01)
    assert ended.status is FitStatus.STOPPED and ended.evaluations == LOOKS < minimise(tray).evaluations
    assert np.mean(ended.residuals**2) <= CLOSE * 25.0 / 4


class Steep(Tray):
    """A tray in which the distance from the target counts a hundred times as much, and the target is out of bounds."""

    def bounds(self):
        return np.full_like(self._start, 0.6), np.ones_like(self._start)

    def evaluate(self, x):
        left, jacobian = super().evaluate(x)
        weights = np.append(np.full(x.size, 10.0), np.ones(2))
        return weights * left, weights[:, None] * jacobian


def test_no_minimum_is_foreseen_beyond_a_bound():
    """Both models predict 25 / 4, but at the bounds 2 * 2**2 / 4 remain in addition."""
    ended = minimise(Steep([0.9, 0.7], lambda x: False), foreseen=0.01)
    assert ended.status is FitStatus.SETTLED
    assert ended.coordinates == pytest.approx(0.6, abs=1e-6)


class Saturating(Bowl):
    """Away from 30 the reading hardly answers, so that a full step goes to where it answers less still."""

    def __init__(self):
        super().__init__([33.0], lambda x: False)
        self.seen = []

    def bounds(self):
        return np.array([0.0]), np.array([100.0])

    def evaluate(self, x):
        away = x[0] - 30.0
        self.seen.append(float(np.arctan(away) ** 2 + 1e-4))
        return np.array([-np.arctan(away), 0.01]), np.array([[1 / (1 + away**2)], [0.0]])


def test_a_step_that_is_taken_back_is_no_reason_to_give_up():
    """A full step from 33 ends at 33 - 10 arctan 3 = 20.5, where more is left: two points, and nothing learned."""
    lost = minimise(Saturating(), hopeless=0.005)  # a residual of 0.01 stays, to first order and in truth
    first = minimise(problem := Saturating(), evaluations=2)
    assert problem.seen[1] > problem.seen[0] and first.coordinates == pytest.approx([33.0])
    assert lost.status is FitStatus.GIVEN_UP and lost.evaluations > LOOKS
    assert lost.residuals @ lost.residuals < problem.seen[0]


class Notch(Bowl):
    """A narrow valley beside the way: trial points in it are worse than where they come from, and are taken back."""

    def __init__(self):
        super().__init__([0.9, 0.1], lambda x: False)
        self.seen = []

    def evaluate(self, x):
        self.seen.append(x.copy())
        return np.array([1 - x[0], 30 * (x[1] - x[0] ** 2)]), np.array([[1.0, 0.0], [60 * x[0], -30.0]])


@pytest.mark.parametrize("evaluations", range(2, 12))
def test_no_point_is_simulated_twice(evaluations):
    valley = Notch()
    found = minimise(valley, evaluations=evaluations)
    assert found is not None
    assert len({x.tobytes() for x in valley.seen}) == len(valley.seen) == found.evaluations
    np.testing.assert_array_equal(found.residuals, Notch().evaluate(found.coordinates)[0])
    assert np.sum(found.residuals**2) == min(np.sum(Notch().evaluate(x)[0] ** 2) for x in valley.seen)


class Cliff(Bowl):
    """A second coordinate of which one residual knows, and which does nothing beyond the sample it lies in."""

    def __init__(self, start, smooth):
        super().__init__(start, lambda x: False)
        self._smooth = np.array(smooth)

    def smooth(self):
        return self._smooth

    def evaluate(self, x):
        at = np.clip(x[1], 0.495, 0.505)
        left = np.array([0.4 - x[0], 3.0 * (0.4 - x[0]), 1.0 - 100.0 * (at - 0.495)])
        slope = 100.0 if at == x[1] else 0.0
        return left, np.array([[1.0, 0.0], [3.0, 0.0], [0.0, slope]])


def test_what_only_one_sample_knows_of_stays_and_the_rest_is_fitted():
    cliff = Cliff([0.9, 0.499], [True, False])
    found = minimise(cliff, hopeless=10.0)
    assert found.status is FitStatus.SETTLED
    assert found.coordinates == pytest.approx([0.4, 0.499], abs=1e-6)
    residuals, jacobian = cliff.evaluate(found.coordinates)
    np.testing.assert_array_equal(found.residuals, residuals)
    np.testing.assert_array_equal(found.jacobian, jacobian)  # its variance is asked for all the same


def test_what_is_left_where_it_stays_counts_for_giving_up():
    """It could take up a residual of 0.6, to first order; but it stays."""
    rms = 0.6 / np.sqrt(3)
    lost = minimise(Cliff([0.9, 0.499], [True, False]), hopeless=0.9 * rms)
    assert lost.status is FitStatus.GIVEN_UP
    assert lost.coordinates == pytest.approx([0.4, 0.499], abs=0.5) and lost.coordinates[1] == 0.499


def test_where_nothing_may_be_moved_the_start_is_the_minimum():
    cliff = Cliff([0.9, 0.499], [False, False])
    found = minimise(cliff)
    assert (found.status, found.evaluations) == (FitStatus.SETTLED, 1)
    np.testing.assert_array_equal(found.coordinates, [0.9, 0.499])
    np.testing.assert_array_equal(found.residuals, cliff.evaluate(found.coordinates)[0])
