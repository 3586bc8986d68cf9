"""How far a finding is from its limit, and which one is named where all pass."""

from math import inf

import pytest

from deatwin.control import Limit, Verdict
from deatwin.control.checking.verdict import Finding, worst


@pytest.mark.parametrize(
    ("good", "poor", "unit", "value", "room"),
    [
        (2.0, 1.5, "", 2.0, 0.0),
        (2.0, 1.5, "", 4.0, 0.5),
        (2.0, 1.5, "", inf, 1.0),
        (2.0, 1.5, "", 1.0, -1.0),
        (2.0, 1.5, "", 0.0, -inf),
        (0.1, 0.3, "%", 0.1, 0.0),
        (0.1, 0.3, "%", 0.0, 1.0),
        (0.1, 0.3, "%", 0.2, -1.0),
        (0.0, 0.1, "%", 0.0, 1.0),
        (0.0, 0.1, "%", 0.05, -inf),
        (0.9, 0.5, "%", 1.0, 1.0),
        (0.9, 0.5, "%", 0.9, 0.0),
        (1.0, 0.9, "%", 1.0, 1.0),
        (1.0, 0.9, "%", 0.95, -inf),
    ],
)
def test_room_is_the_share_of_the_way_to_the_best(
    good: float, poor: float, unit: str, value: float, room: float
) -> None:
    assert Limit(good=good, poor=poor, unit=unit).room(value) == pytest.approx(room, abs=1e-12)


def test_where_all_pass_the_one_nearest_its_limit_is_named() -> None:
    def finding(subject: str, verdict: Verdict, room: float | None) -> Finding:
        return Finding(subject=subject, value=None, verdict=verdict, text=subject, room=room)

    calm = [finding("stability", Verdict.PASS, 1.0), finding("excitation", Verdict.PASS, None)]
    near = finding("disk margin", Verdict.PASS, 0.1)
    assert worst([*calm, near]) is near
    assert worst(calm[1:]) is calm[1]
    first, second = finding("a", Verdict.MARGINAL, -0.1), finding("b", Verdict.MARGINAL, -0.9)
    assert worst([near, first, second]) is first
