"""Jobs that tell how far they are."""

import operator

from deatwin.studies.parallel import between, run_told


def test_jobs_tell_their_share_of_the_whole_work():
    told: list[tuple[float, str]] = []
    part = between(lambda share, text: told.append((share, text)), 0.5, 0.9)
    assert run_told(operator.add, [(1, 2), (3, 4)], 1, part, "adding") == [3, 7]
    assert told == [(0.5, "adding"), (0.7, "adding"), (0.9, "adding")]
