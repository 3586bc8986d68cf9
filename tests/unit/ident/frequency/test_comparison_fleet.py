"""Summaries of the responses of a fleet on numbers whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_bands import mean

from deatwin.ident.frequency.comparison.compare import Agreement
from deatwin.ident.frequency.comparison.fleet import contrast, share_of, spread_of_means


def test_a_measured_difference_beside_the_true_one() -> None:
    # The true one is 0.3j; the measured one has 0.36 of it along, and 0.02 across: 0.06 beside it of 0.0632 in all.
    true = mean(1.0 + 0.3j), mean(1.0)
    apart = contrast((mean(1.02 + 0.36j, 5e-4), mean(1.0, 5e-4)), true)
    assert (apart.true, apart.measured) == pytest.approx((0.15, 0.18))
    assert apart.error == pytest.approx(np.sqrt(1e-3) / 2)
    # The squared distance is 0.004 / 0.001 = 4 < 5.99; with half the variance it is 8.
    assert apart.inside
    assert not contrast((mean(1.02 + 0.36j, 2.5e-4), mean(1.0, 2.5e-4)), true).inside


def test_agreements_are_counted_by_column() -> None:
    kinds = ("DIFFERENT", "ALIKE", "DRIFT", "DIFFERENT", "DIFFERENT", "ALIKE")
    table = SimpleNamespace(
        differences=[SimpleNamespace(agreement=Agreement[kind]) for kind in kinds],
        pairs=("ab", "ac", "bc"),
        columns=(1, 2),
    )
    shares = share_of(table, Agreement.DIFFERENT)  # type: ignore[arg-type]
    np.testing.assert_allclose(shares, [2 / 3, 1 / 3])


def test_the_spread_of_a_group_leaves_out_the_scatter_of_the_estimates() -> None:
    # Each part has the variance 0.04/3 about its mean; each estimate scatters by 0.004 in both parts.
    group = [(mean(value, 0.004),) for value in (2.0, 2.2, 2.0 + 0.2j, 2.2 + 0.2j)]
    gain = np.sqrt(np.mean([each.gain**2 for (each,) in group]))
    np.testing.assert_allclose(spread_of_means(group), np.sqrt(0.08 / 3 - 2 * 0.004) / gain)
    assert spread_of_means([(mean(value, 1.0),) for value in (2.0, 2.001)]) == [0.0]
