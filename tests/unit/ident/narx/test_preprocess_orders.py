"""Lags and degree by free-run error: the choice, the rule, and what fails."""

from functools import partial

import made_narx
import numpy as np
import pytest

from deatwin.ident.narx import Frols, NarxModel
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.preprocess import OrderChoice, OrderTrial, TrialStatus, choose_orders
from deatwin.ident.narx.preprocess.orders import _standard_error
from deatwin.plant.errors import ModelError

bilinear = partial(made_narx.bilinear, n=600)


class Scripted(NarxIdentifier):
    """Returns a model that depends on the output lags: sound, unstable, or none."""

    def __init__(self, *, output_lags=1, input_lags=1, degree=1, rule=None):
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule

    def _check(self):
        if self.output_lags == 3:
            raise ModelError("three is not to be had")

    def _learn(self, data, progress):
        gain = 2.0 if self.output_lags == 2 else 0.5
        return NarxModel.from_terms({"y(k-1)": gain, "u(k-1)": 1.0}, sample_time=0.1)


def test_the_structure_of_a_system_is_chosen():
    training, validation = bilinear(seed=1), bilinear(seed=2)
    choice = choose_orders(Frols(max_terms=8), training, validation, output_lags=(1, 2, 3, 4), degrees=(1, 2, 3))
    assert len(choice.trials) == 12
    chosen = choice.chosen
    assert (chosen.output_lags, chosen.input_lags, chosen.degree, chosen.n_terms) == (2, 2, 2, 3)
    linear = min(trial.error for trial in choice.trials if trial.degree == 1)
    # the noise of 0.02 through 1/(1 - 0.5 q^-1) is 0.023 in free run
    assert chosen.error == pytest.approx(0.02 / np.sqrt(1 - 0.25), rel=0.15) and linear > 2 * chosen.error
    assert "<- chosen" in str(choice)


def test_all_errors_are_over_the_same_samples():
    training, validation = bilinear(seed=3), [bilinear(n=300, seed=4), bilinear(n=200, seed=5)]
    choice = choose_orders(
        Frols(max_terms=5), training, validation, output_lags=(1, 5), input_lags=(2, 4), degrees=(2,)
    )
    assert [(t.output_lags, t.input_lags) for t in choice.trials] == [(1, 2), (1, 4), (5, 2), (5, 4)]
    for trial in choice.trials:
        model = Frols(max_terms=5, output_lags=trial.output_lags, input_lags=trial.input_lags).fit(training).model_
        left = [(model.simulate(r).outputs - r.outputs)[0, 5:] for r in validation]
        assert trial.error == pytest.approx(np.sqrt(np.mean(np.concatenate(left) ** 2)), rel=1e-12)


def trial(n_terms, mean_square, degree=2, lags=2, standard_error=1.0):
    return OrderTrial(
        output_lags=lags,
        input_lags=lags,
        degree=degree,
        n_terms=n_terms,
        error=np.sqrt(mean_square),
        mean_square=mean_square,
        standard_error=standard_error,
        status=TrialStatus.DONE,
    )


def test_the_rule_takes_the_smallest_within_one_standard_error_of_the_best():
    best = trial(9, 10.0, standard_error=1.0)
    near, far = trial(5, 10.9), trial(2, 11.1)
    lost = OrderTrial(output_lags=1, input_lags=1, degree=1, n_terms=1, status=TrialStatus.DIVERGED)
    assert OrderChoice(trials=(best, near, far, lost)).chosen is near
    assert OrderChoice(trials=(best, near, far, lost)).best is best
    # of as many terms the lower degree, then the fewer lags
    assert OrderChoice(trials=(best, near, trial(5, 10.5, degree=1))).chosen.degree == 1
    assert OrderChoice(trials=(best, near, trial(5, 10.5, lags=(2,)))).chosen.output_lags == (2,)


def test_the_standard_error_of_white_errors():
    # squares of n normal errors: deviation of their mean sqrt(2/n); ten block means tell it to 1/sqrt(18) = 24 %
    rng = np.random.default_rng(8)
    found = np.array([_standard_error(rng.normal(size=1000) ** 2) for _ in range(200)])
    assert np.sqrt(np.mean(found**2)) == pytest.approx(np.sqrt(2 / 1000), rel=4 * 0.24 / np.sqrt(200))


def test_divergence_and_failure_are_a_status():
    recording = bilinear(seed=9)
    choice = choose_orders(Scripted(), recording, recording, output_lags=(1, 2, 3), input_lags=(1,), degrees=(1,))
    assert [t.status for t in choice.trials] == [TrialStatus.DONE, TrialStatus.DIVERGED, TrialStatus.FAILED]
    assert choice.trials[2].reason == "three is not to be had" and choice.trials[1].n_terms == 2
    assert choice.chosen is choice.trials[0] and "diverged" in str(choice)
    only = choose_orders(Scripted(), recording, recording, output_lags=(2,), degrees=(1,))
    with pytest.raises(ModelError, match="nothing to choose"):
        _ = only.chosen
    assert "diverged" in str(only)


def test_plot_has_a_line_for_each_degree():
    recording = bilinear(seed=12)
    choice = choose_orders(Frols(max_terms=4), recording, recording, output_lags=(1, 2, 3), degrees=(1, 2))
    axes = choice.plot()
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[:2] == ["linear", "degree 2"] and "chosen" in labels
    assert "(m)" in axes.get_ylabel()
