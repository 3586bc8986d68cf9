"""The table of margins: of the source and of all draws; what is unstable or not there; quantiles."""

import numpy as np
import pytest
from made_models import controller_of

from deatwin.control import LinearController
from deatwin.control.checking.rows import rows_of_family
from deatwin.control.controllers.law import Law
from deatwin.control.design.pid import PidGains
from deatwin.control.linear.family import LinearFamily
from deatwin.control.stability.margins import margins
from deatwin.control.stability.polynomials import in_series

H = 0.02
GAINS = PidGains(proportional=0.4, integral=2.0)


def controller(law: Law | None = None) -> LinearController:
    law = GAINS.law(H) if law is None else law
    windup = GAINS.windup(H) if law.c.size else np.zeros(0)
    return controller_of(law, windup, closed_loop_time=0.5)


def family(numerators, denominators, exists=None) -> LinearFamily:
    numerators, denominators = (np.asarray(c, dtype=float) for c in (numerators, denominators))
    there = np.ones(numerators.shape[:2], dtype=bool) if exists is None else np.asarray(exists)
    return LinearFamily(
        operating_inputs=0.1 * np.arange(len(numerators)),
        operating_outputs=np.where(there, 0.0, np.nan),
        numerators=numerators,
        denominators=denominators,
        exists=there,
        stable=there,
        has_gain=there,
        sample_time=H,
    )


@pytest.fixture(scope="module")
def drawn() -> LinearFamily:
    """Two points, 40 draws; second order, with the one sample of delay of a loop."""
    rng = np.random.default_rng(12)
    poles = rng.uniform(0.5, 0.93, (2, 40, 2))
    gains = rng.uniform(0.8, 1.6, (2, 40))
    a1, a2 = -poles.sum(axis=2), poles.prod(axis=2)
    b = gains * (1 + a1 + a2)
    return family(np.stack([np.zeros_like(b), 0.6 * b, 0.4 * b], axis=2), np.stack([np.ones_like(b), a1, a2], axis=2))


def test_a_row_has_the_margins_of_its_source_and_the_low_quantile_of_all(drawn):
    """`margins` is held against python-control in tests/unit/control/stability/test_margins.py."""
    top, bottom = controller().local(0.0).feedback
    rows = rows_of_family("model", drawn, controller())
    assert [row.operating_input for row in rows] == [0.0, 0.1]
    for point, row in enumerate(rows):
        found = margins(in_series(drawn.numerators[point], top), in_series(drawn.denominators[point], bottom), H)
        assert (row.samples, row.stable_share) == (40, 1.0) and found.stable.all()
        assert row.crossover_Hz == pytest.approx(found.crossover[0] / (2 * np.pi), rel=1e-12)
        for name in ("gain", "phase_deg", "delay", "disk"):
            values, low = getattr(found, name), name.replace("phase", "phase_low") if "phase" in name else f"{name}_low"
            assert getattr(row, name) == pytest.approx(values[0], rel=1e-12)
            # Of 40 draws the 2.5 % quantile is between the least and the next; the lower one is taken.
            assert getattr(row, low) == pytest.approx(values.min(), rel=1e-12)


def test_what_is_unstable_or_not_there_counts_as_unstable(drawn):
    numerators, exists = np.array(drawn.numerators), np.ones((2, 40), dtype=bool)
    numerators[0, 5:9] *= 4e3  # beyond any gain margin of these
    numerators[1, 7], exists[1, 7] = 0.0, False
    denominators = np.array(drawn.denominators)
    denominators[1, 7] = [1.0, 0.0, 0.0]
    first, second = rows_of_family("model", family(numerators, denominators, exists), controller())
    assert first.stable_share == pytest.approx(0.9)
    assert second.stable_share == pytest.approx(39 / 40)
    assert first.gain_low == first.phase_low_deg == first.delay_low == first.disk_low == 0.0
    assert second.gain_low == 0.0  # one of 40 is 2.5 %
    assert first.gain > 1.0


def test_a_source_that_is_itself_unstable_has_no_share(drawn):
    numerators = np.array(drawn.numerators)
    numerators[0, 0] *= 4e3
    row = rows_of_family("model", family(numerators, drawn.denominators), controller())[0]
    assert row.stable_share == row.gain == row.phase_deg == row.delay == row.disk == row.gain_low == 0.0


def test_infinite_margins_have_quantiles():
    """A loop gain below one at all frequencies bounds neither phase nor delay."""
    plain = controller(Law.of_error(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0))
    weak = np.tile([0.0, 0.5, 0.0], (1, 100, 1))
    still = np.tile([1.0, 0.0, 0.0], (1, 100, 1))
    row = rows_of_family("plant", family(weak, still), plain)[0]
    assert row.phase_deg == row.phase_low_deg == row.delay == row.delay_low == np.inf
    assert row.gain == row.gain_low == pytest.approx(2.0)  # -0.5 at half the sampling rate
    assert row.crossover_Hz == 0.0
    some = weak.copy()
    some[0, 10:12, 1] = 0.9  # two of a hundred are below the 2.5 % quantile of the gain margin
    assert rows_of_family("plant", family(some, still), plain)[0].gain_low == pytest.approx(2.0)
    some[0, 12, 1] = 0.9
    assert rows_of_family("plant", family(some, still), plain)[0].gain_low == pytest.approx(1 / 0.9)
    nothing = rows_of_family("plant", family(0.0 * weak, still), plain)[0]
    assert nothing.gain == nothing.gain_low == np.inf
    assert nothing.stable_share == 1.0


def test_the_low_quantile_is_never_above_the_source_itself(drawn):
    numerators = np.array(drawn.numerators)
    numerators[:, 0] *= 3.0
    for row in rows_of_family("model", family(numerators, drawn.denominators), controller()):
        assert row.gain_low <= row.gain
