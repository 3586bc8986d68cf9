"""Whether a crossover lies where the recording excited the plant."""

from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.subject import judge_band
from deatwin.ident.narx import Excitation

HOLED = Excitation(bands=((0.25, 0.5), (1.5, 2.0)))


def test_a_crossover_in_a_hole_is_marginal_and_told_what_would_settle_it() -> None:
    assert judge_band([0.3, 1.6], HOLED).verdict is Verdict.PASS
    found = judge_band([0.3, 1.0, 1.6], HOLED)
    assert (found.verdict, found.value, found.subject) == (Verdict.MARGINAL, 1.0, "excitation")
    assert "a crossover frequency is 1 Hz, but the input of the recording has no power from 0.5 to 1.5 Hz" in found.text
    assert "such as noise up to 2 Hz" in found.text
    assert judge_band([0.1], HOLED).verdict is Verdict.MARGINAL
    beyond = judge_band([1.0, 3.0], HOLED)  # the worse of the two is told
    assert beyond.value == 3.0 and "record with an input up to 6 Hz" in beyond.text
