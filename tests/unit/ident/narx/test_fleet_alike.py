"""One structure for several actuators of one law."""

import numpy as np
import pytest
from made_fleet import GAINS, NOISE, STEP, made_fleet, made_up, plan_of

from deatwin.ident.frequency import gfrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.fleet import alike
from deatwin.ident.narx.fleet.alike import OPERATING_INPUT, Fleet, choose_structure, fit
from deatwin.ident.narx.fleet.records import HELD_OUT

made = pytest.fixture(scope="module")(made_fleet)


def test_a_common_structure_holds_the_law(made: Fleet) -> None:
    truth = {"y(k-1)", "u(k)^2", "u(k-1)^2", "u(k)u(k-1)"}
    assert truth <= {str(term) for term in made.structure}
    assert all(one.model.terms == made.structure for one in made.actuators)
    # The free run's error is the noise through the loop, 1 / sqrt(1 - 0.55^2) = 1.2 of it at the mean command.
    for one, error in zip(made.actuators, made.errors, strict=True):
        assert error < 2 * NOISE / one.sections[0].outputs.std()
        assert one.sections[1].duration == pytest.approx(HELD_OUT, abs=STEP) and one.fit_percent > 95


def test_the_shortest_of_equally_good_structures(monkeypatch: pytest.MonkeyPatch) -> None:
    records = [made_up(gain, 600, seed) for seed, gain in enumerate(GAINS)]
    passed = [[("a", "b", "c")], [("a", "b"), ("a",)], [("a", "d")]]
    # Least: three terms. Two terms are worse by half a standard error of the paired differences, one by far.
    least, noise = np.array([0.1, 0.2, 0.3]), 0.01 * np.array([-1.0, 0.0, 1.0])
    errors = {("a", "b", "c"): least, ("a", "b"): least + noise + 0.003, ("a",): least + 0.1, ("a", "d"): least + 0.05}
    calls = iter(passed)
    monkeypatch.setattr(alike, "_passed", lambda *_: next(calls))
    rows = iter(range(3))
    monkeypatch.setattr(
        alike, "_free_run_errors", lambda structures, *_: [errors[s][i] for i in [next(rows)] for s in structures]
    )
    structure, chosen, tried = choose_structure(records, plan_of())
    assert structure == ("a", "b") and tried == 4  # type: ignore[comparison-overlap]
    np.testing.assert_allclose(chosen, errors["a", "b"])


def test_a_fit_has_a_covariance_that_the_scatter_bears_out() -> None:
    terms = ["y(k-1)", "u(k)^2", "u(k-1)^2", "u(k)u(k-1)"]
    models = [
        fit(NarxModel.from_terms(dict.fromkeys(terms, 1.0), sample_time=1.0).terms, made_up(1.0, 600, seed))
        for seed in range(40)
    ]
    gains = [gfrf(m, 1, [0.5], operating_input=OPERATING_INPUT) for m in models]
    scatter = np.std([float(g.gain[0]) for g in gains], ddof=1)
    stated = np.sqrt(np.mean([float(g.gain_deviation[0]) ** 2 for g in gains]))
    # The scatter of 40 is known to 11 %; the robust variance of 600 samples (28 cosines) has 19 % and is averaged.
    assert scatter / stated == pytest.approx(1.0, abs=0.35)
