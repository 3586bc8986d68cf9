"""Do actuators differ in the frequency domain? Repeats of one that is steady do not; drift is told from difference.

A few repeats and a few actuators: the scenario frequency-uncertainty does the same with many repeats and all six.
"""

from dataclasses import replace

import numpy as np
from needs import COMPILED

from deatwin.ident.frequency.comparison.compare import Agreement
from deatwin.ident.frequency.comparison.records import compare_records
from deatwin.ident.narx import generate_terms
from deatwin.ident.narx.fleet import RECORDED, STEADY, as_variant, thinned
from deatwin.ident.narx.terms import AtMost
from deatwin.plant import Recording
from deatwin.plant.fleet import Actuator, fleet

pytestmark = COMPILED
TERMS = generate_terms(1, (0, 1), 3, rule=AtMost(output=1))
ORDERS = (1, 2, 3)
BANDS = ((0.0, 0.1), (0.1, 0.3), (0.3, 0.6), (0.6, 1.0))
AT = 2.4  # V, the mean of the thesis' noise
SETTLED = 20.0  # s; then the start of the recording is forgotten


def recorded(actuator: Actuator, variant: str, seed: tuple[int, ...], duration: float) -> Recording:
    """An actuator under noise of its own seed, every sixth sample."""
    other = replace(as_variant(actuator, variant), seed=seed)
    record = other.record(other.excitation(SETTLED + duration)).recordings[0]
    return thinned(record.section(round(SETTLED / record.sample_time), record.n_samples), 6)


def compared(recordings: dict[str, Recording]):
    return compare_records(recordings, TERMS, ORDERS, BANDS, operating_input=AT)


def test_repeats_of_a_steady_actuator_differ_in_at_most_one_test_of_twenty():
    """Six repeats, 180 tests: corrected for their number even one finding is to come once in twenty such tables."""
    one = fleet()[0]
    table = compared({f"repeat {k}": recorded(one, STEADY, (700, k), 300.0) for k in range(6)})
    assert len(table.differences) == 15 * 12
    assert table.share <= 0.05
    assert np.mean([d.drifts for d in table.drifts]) <= 0.05


def test_two_fabrications_differ_and_an_actuator_that_drifts_does_not_from_itself():
    second, third = fleet()[1:3]
    table = compared(
        {
            "second": recorded(second, STEADY, (710, 1), 1080.0),
            "third": recorded(third, STEADY, (710, 2), 1080.0),
            "third, drifting": recorded(third, RECORDED, (710, 3), 1080.0),
        }
    )
    found = {pair: [d.agreement for d in table.differences if (d.first, d.second) == pair] for pair in table.pairs}
    # different films: their difference needs no drift
    assert found["second", "third"].count(Agreement.DIFFERENT) >= 6
    assert {d.name for d in table.drifts if d.drifts} == {"third, drifting"}
    # it began as the same actuator: what differs on average must be the drift's
    assert Agreement.DIFFERENT not in found["third", "third, drifting"]
    assert found["third", "third, drifting"].count(Agreement.DRIFT) >= 6
