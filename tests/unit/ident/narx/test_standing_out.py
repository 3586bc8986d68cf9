"""Margins of true terms against brute force."""

from collections.abc import Sequence

import numpy as np
import pytest
from made_regressions import regression

from deatwin.ident.narx.standing_out import full_margin, near_margin


def test_t_values_of_all_candidates() -> None:
    rows, target = regression(1)
    design = rows.T
    theta, (squares,), _, _ = np.linalg.lstsq(design, target, rcond=None)
    t = np.abs(theta) / np.sqrt(squares / (60 - 8) * np.diag(np.linalg.inv(design.T @ design)))
    margin = full_margin(rows, target, np.array([0, 2, 5]))
    assert margin.true == pytest.approx(t[[0, 2, 5]].min())
    assert margin.false == pytest.approx(t[[1, 3, 4, 6, 7]].max())


@pytest.mark.parametrize("seed", range(6))
def test_the_truth_among_its_neighbours(seed: int) -> None:
    # The reference fits every neighbour by least squares.
    rows, target = regression(seed)
    true, false = [0, 2, 5], [1, 3, 4, 6, 7]

    def squares(terms: Sequence[int]) -> float:
        theta = np.linalg.lstsq(rows[list(terms)].T, target, rcond=None)[0]
        return float(np.sum((target - theta @ rows[list(terms)]) ** 2))

    own = squares(true)
    dropped = min((squares([t for t in true if t != out]) - own) / (own / 57) for out in true)
    added = max((own - squares([*true, extra])) / (squares([*true, extra]) / 56) for extra in false)
    swapped = min(squares([*(t for t in true if t != out), extra]) for out in true for extra in false)
    margin = near_margin(rows, target, np.array(true))
    assert margin.true == pytest.approx(np.sqrt(dropped))
    assert margin.false == (pytest.approx(np.sqrt(added)) if swapped >= own else np.inf)
