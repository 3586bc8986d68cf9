"""What the plant cannot follow of finer equations belongs to the floor, wherever those can be simulated."""

from types import SimpleNamespace

import pytest

from deatwin.ident.mismatch.model_error import model_error_of
from deatwin.plant import SimulationError


class Followed:
    """A plant that leaves so much of finer equations on each experiment; of some they say nothing."""

    def __init__(self, *left: float | None) -> None:
        self.left, self.rig = left, SimpleNamespace(finer=lambda: None)

    def without_effects(self) -> "Followed":
        return self

    def model_error(self, experiment: int) -> SimpleNamespace:
        found = self.left[experiment]
        if found is None:
            raise SimulationError("the film lost tension")
        return SimpleNamespace(rms=found)


# Three and four make five: what is expected of a rig and what it cannot follow are independent. A plant that leaves
# five of four expected has been biased by what is missing: six is half as much again.
@pytest.mark.parametrize(
    ("left", "floor"),
    [
        ((3.0,), 5.0),
        ((1.0, 3.0), 5.0),
        ((None, 3.0), 5.0),
        ((3.0, None), 5.0),
        ((None,), 4.0),
        ((), 4.0),
        ((5.0,), 6.0),
    ],
)
def test_the_most_that_is_left_of_any_experiment_counts(left, floor):
    parts = [SimpleNamespace(experiment=k, reading="") for k in range(len(left))]
    problem = SimpleNamespace(everything=parts, expected_error=4.0)
    assert model_error_of(Followed(*left), problem) == pytest.approx(floor)


def test_finer_equations_are_simulated_once_for_all_readings_of_an_experiment():
    asked: list[int] = []

    class Counted(Followed):
        def model_error(self, experiment: int) -> SimpleNamespace:
            asked.append(experiment)
            return super().model_error(experiment)

    parts = [SimpleNamespace(experiment=k, reading=name) for name in ("", "current", "charge") for k in (0, 1)]
    problem = SimpleNamespace(everything=parts, expected_error=4.0)
    assert model_error_of(Counted(1.0, 3.0), problem) == pytest.approx(5.0)
    assert asked == [0, 1]


def test_where_no_error_is_expected_there_is_none():
    problem = SimpleNamespace(everything=[SimpleNamespace(experiment=0, reading="")], expected_error=0.0)
    assert model_error_of(Followed(3.0), problem) == 0.0
