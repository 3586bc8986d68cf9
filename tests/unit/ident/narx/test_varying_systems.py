"""Systems whose parameters are given functions of time."""

from dataclasses import replace

import numpy as np
import pytest
from made_fleet import STEP, of_growing_gain

from deatwin.ident.narx import Fixed, NarxModel, Term
from deatwin.ident.narx.varying_systems import (
    BLOCK,
    CHOOSING,
    CONSTANT,
    CYCLE,
    JUDGING,
    LIKELIEST,
    MOVING_DC,
    RESONANCE,
    SHARES,
    SYSTEMS,
    VARYING,
    blocks_of,
    follow_actuator,
    free_run_errors,
    recorded,
    stretches,
    walked,
)


def test_a_recording_obeys_the_equation_of_each_instant() -> None:
    rng = np.random.default_rng(0)
    for system in SYSTEMS:
        truth = system.truth(duration=20.0)
        u, e = system.excitation(rng, 20.0), 0.01 * rng.standard_normal(400)
        y = recorded(truth, u, e).outputs[0]
        lag = truth.model.table.max_lag
        assert not y[:lag].any()
        for k in range(lag, 400):
            known = {"1": 1.0, "y(k-1)": y[k - 1], "y(k-2)": y[k - 2], "u(k-1)": u[k - 1], "y(k-1)^2": y[k - 1] ** 2}
            terms = [known[str(term)] for term in truth.terms]
            assert y[k] == pytest.approx(truth.theta[:, k] @ terms + e[k], abs=1e-12)


def test_parameters_go_there_and_back() -> None:
    assert RESONANCE.is_linear and not MOVING_DC.is_linear
    for speed in (1.0, 4.0):
        constant = MOVING_DC.truth(speed).theta[0]
        assert constant.max() == pytest.approx(0.5, abs=1e-4)
        turns = np.sum(np.diff(np.sign(constant - 0.25)) != 0)
        assert turns == 2 * speed


SMALL = tuple(Term.parse(text) for text in ("1", "y(k-1)", "u(k)", "u(k)^2"))


def test_blocks_are_a_partition() -> None:
    record = of_growing_gain(0.0, duration=333.0)
    left = stretches(record, (CHOOSING, JUDGING))
    parts = [*left, *blocks_of(record, CHOOSING), *blocks_of(record, JUDGING)]
    times = np.sort(np.concatenate([part.timepts for part in parts]))
    whole = record.timepts[: times.size]
    np.testing.assert_allclose(times, whole)
    assert record.n_samples - times.size < BLOCK / STEP + 2
    assert all(part.n_samples % 2 == 0 for part in parts)
    assert len(blocks_of(record, JUDGING)) == pytest.approx(len(parts) / CYCLE, abs=3)


def test_a_walk_that_may_not_wander_is_least_squares() -> None:
    record = of_growing_gain(0.2, duration=120.0)
    model = Fixed(terms=SMALL).fit(record).model_
    smoother = walked(SMALL, [record], 0.0, record)
    # The start is worth 1e-4 of a sample among a thousand, and is the same estimate.
    for theta in (smoother.trajectory_.theta[:, 0], smoother.filtered_.theta[:, -1]):
        np.testing.assert_allclose(theta, model.theta, rtol=1e-6)
    wander = walked(SMALL, [record], 0.1, record).trajectory_.drift_variance * record.n_samples
    products = model.table.rows(record.inputs, record.outputs, 1, record.n_samples)
    size = np.sqrt(np.mean(np.asarray(products) ** 2, axis=1))
    np.testing.assert_allclose(np.sqrt(wander) * size, 0.1 * record.outputs.std(), rtol=1e-9)


def test_a_run_that_diverges_has_no_finite_error() -> None:
    model = NarxModel.from_terms({"y(k-1)": 2.0, "u(k)": 1.0}, sample_time=STEP)
    record = of_growing_gain(0.0, duration=60.0)
    model = replace(model, operating=Fixed(terms=["u(k)"]).fit(record).model_.operating)
    assert np.isinf(free_run_errors(model, [record])).all()


def test_drift_is_followed_and_standing_still_is_not_made_worse() -> None:
    drifting = follow_actuator("DEA 1", of_growing_gain(0.3), SMALL)
    for kind in (drifting.seen, drifting.unseen, drifting.ahead):
        assert kind[VARYING] < 0.5 * kind[CONSTANT]
    still = follow_actuator("DEA 6", of_growing_gain(0.0), SMALL)
    assert still.share == SHARES[0]
    assert still.unseen[VARYING] < 1.02 * still.unseen[CONSTANT]
    assert drifting.seen[LIKELIEST] <= drifting.seen[CONSTANT]
    known = drifting.trajectory.theta[3]
    # The gain grows by 0.3 of itself, and the constant and the linear term, which move along, take a part of it.
    growth = drifting.trajectory.at(1000.0).theta @ [1, 0, 2.4, 2.4**2] - drifting.trajectory.at(100.0).theta @ [
        1,
        0,
        2.4,
        2.4**2,
    ]
    assert growth == pytest.approx(0.3 * 900 / 1100 * 1e-5 * 2.4**2, rel=0.15)
    assert known.shape == drifting.trajectory.timepts.shape
