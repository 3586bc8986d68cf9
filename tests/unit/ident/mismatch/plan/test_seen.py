"""What readings would show, against the likelihood of drawn readings and against closed variants."""

import numpy as np
import pytest
from processes import drawn

from deatwin.ident.mismatch.likelihood.beforehand import PRIORS, TIMING, OwnError
from deatwin.ident.mismatch.likelihood.model import LogNormal, Prior, Reading
from deatwin.ident.mismatch.likelihood.scales import evidence
from deatwin.ident.mismatch.likelihood.several import OwnErrors
from deatwin.ident.mismatch.plan.seen import Change, distances, products, smallest
from deatwin.ident.mismatch.thresholds import CREDIBLE

N, STEP, NOISE = 800, 0.02, 2e-6
TIME = np.arange(N) * STEP
RNG = np.random.default_rng(5)
READINGS = 1e-4 * np.sin(0.7 * TIME) + 3e-5 * np.sin(9.0 * TIME)
DERIVATIVES = np.column_stack([READINGS, np.full(N, 1e-4)])


def change(readings, effect="a", typical=1.0, deviation=2.0, one_sided=True):
    return Change(effect=effect, readings=readings, typical=typical, deviation=deviation, one_sided=one_sided)


def alone(error):
    return OwnErrors(of=(error,), at=(np.arange(N),))


@pytest.fixture
def error():
    return OwnError(
        readings=READINGS,
        late=TIMING * np.gradient(READINGS),
        times=TIME,
        records=np.zeros(N),
        sample_time=STEP,
        noise=NOISE,
        stated=1e-6,
    )


def test_the_smallest_strength_has_the_evidence_that_is_asked_for():
    square, deviation = 40.0, 2.0
    strength = smallest(square, deviation, catalogue=28)
    expected = 0.5 * strength**2 * square - 0.5 * np.log1p(deviation**2 * square)
    posterior = np.exp(expected) * PRIORS[1] / 28 / PRIORS[0]
    assert posterior / (1.0 + posterior) == pytest.approx(CREDIBLE, rel=1e-12)
    assert np.isinf(smallest(0.0, deviation, catalogue=28))


def test_expected_evidence_is_that_of_drawn_readings(error):
    """Of 150 draws the mean is within three of its standard errors of the closed form: it is not in 1 of 370."""
    one = change(1e-5 * np.sin(3.0 * TIME) ** 3, deviation=1.0, one_sided=False)
    square = products(alone(error), DERIVATIVES, [one])[0, 0]
    strength = 4.0 / np.sqrt(square)
    nuisance = np.column_stack([DERIVATIVES, error.columns])
    fast = LogNormal(median=error.ratio * NOISE)

    def log(residual, columns):
        reading = Reading(
            times=TIME, records=np.zeros(N), residual=residual, columns=columns,
            process=error.process, kappa=fast, sigma=LogNormal(median=NOISE),
        )  # fmt: skip
        return evidence([reading], Prior.of((columns.shape[1], None))).log

    gained = []
    for _ in range(150):
        slow = error.ratio * NOISE * drawn(error.process, N, STEP, RNG)
        noisy = nuisance @ RNG.standard_normal(nuisance.shape[1]) + slow + NOISE * RNG.standard_normal(N)
        residual = noisy + strength * one.readings
        gained.append(log(residual, np.column_stack([nuisance, one.readings])) - log(residual, nuisance))
    # b is normal about q s with variance q: E b² = q² s² + q.
    expected = 0.5 * (square**2 * strength**2 + square) / (square + 1.0) - 0.5 * np.log1p(square)
    assert abs(np.mean(gained) - expected) < 3.0 * np.std(gained) / np.sqrt(len(gained))


def test_what_a_parameter_does_is_not_seen(error):
    sharp = 1e3 * DERIVATIVES  # nothing is known of them
    seen = products(alone(error), sharp, [change(1e-5 * np.sin(3.0 * TIME)), change(DERIVATIVES[:, 0])])
    assert seen[1, 1] < 1e-3 * seen[0, 0]


def test_distances_are_those_to_the_nearest_one_sided_sum():
    among = np.array([[4.0, 4.0, -2.0], [4.0, 9.0, 0.0], [-2.0, 0.0, 4.0]])
    blank = np.zeros(1)
    pair = [change(blank, "a"), change(blank, "b"), change(blank, "c")]
    found = distances(pair, among, range(len(pair)))
    # from a to b: 4 - 4²/9; to c, which acts the other way: nothing of it helps
    assert found[0] == pytest.approx([0.0, 4.0 - 16.0 / 9.0, 4.0], abs=1e-9)
    both = [pair[0], pair[1], change(blank, "c", one_sided=False)]
    assert distances(both, among, [0])[0, 2] == pytest.approx(4.0 - 4.0 / 4.0)
    spread = [pair[0], change(blank, "b"), change(blank, "b", one_sided=False)]
    assert distances(spread, np.diag([4.0, 9.0, 1.0]), [0])[0].tolist() == pytest.approx([0.0, 4.0])
    stronger = [change(blank, "a", typical=3.0), *pair[1:]]
    assert distances(stronger, among, [0])[0, 1] == pytest.approx(9.0 * (4.0 - 16.0 / 9.0))
