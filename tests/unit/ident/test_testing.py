"""check_identifier: ours keep the contract, and each way of breaking it is caught."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.narx import Frols, Grow, Semp, SvbNarx
from deatwin.ident.narx.estimate import Bayesian, Ridge, TotalLeastSquares
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.regression import flatten
from deatwin.ident.narx.terms import AtMost
from deatwin.ident.testing import CHECKS, ContractError, check_identifier, example_recordings
from deatwin.plant.errors import DeatwinError, ModelError
from deatwin.plant.recording import Experiment, Recording

TERMS = ["y(k-1)", "u(k-2)", "y(k-1)u(k-1)"]
OURS = [
    Frols(),
    Frols(criterion="free_run", rule=AtMost(output=1), estimator=Ridge()),
    Lasso(max_terms=6),
    SvbNarx(),
    Semp(max_terms=6),
    Grow(degree=1, max_terms=4),
    Fixed(terms=TERMS, estimator=Bayesian()),
    Fixed(terms=TERMS, estimator=TotalLeastSquares()),
    Narmax(Fixed(terms=TERMS), criterion="none", max_noise_terms=1),
]


@pytest.mark.parametrize("name", list(CHECKS))
@pytest.mark.parametrize("identifier", OURS, ids=lambda one: repr(one)[:30])
def test_ours_keep_the_contract(identifier, name):
    before = dict(vars(identifier))
    CHECKS[name](identifier, example_recordings())
    assert vars(identifier) == before


def test_it_takes_recordings_of_the_author():
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 300), np.zeros((2, 300))
    for k in range(1, 300):
        y[0, k] = 0.5 * y[0, k - 1] + 0.3 * y[1, k - 1] + u[k - 1] + 0.02 * rng.normal()
        y[1, k] = -0.4 * y[1, k - 1] + 0.5 * u[k - 1] + 0.02 * rng.normal()
    whole = Recording.from_arrays(u, y, 1.0)
    check_identifier(Frols(output_lags=1, input_lags=1), recordings=[whole.section(0, 140), whole.section(140, 300)])


def given(prepare):
    """A class of estimators that fit what ``prepare`` makes of the recordings."""

    def fit(self, recordings, *, progress=None):
        return Frols.fit(self, prepare(recordings), progress=progress)

    return type(prepare.__name__, (Frols,), {"fit": fit})


def fitted(change):
    """One whose fit ends with ``change``."""

    def fit(self, recordings, *, progress=None):
        Frols.fit(self, recordings, progress=progress)
        return change(self)

    return type(change.__name__, (Frols,), {"fit": fit})


def learned(change):
    """One whose model is what ``change`` makes of it."""

    def _learn(self, data, progress):
        return change(self, Frols._learn(self, data, progress))

    return type(change.__name__, (Frols,), {"_learn": _learn})


def telling(change):
    """One whose progress is what ``change`` makes of a share and a text."""

    def fit(self, recordings, *, progress=None):
        told = progress and (lambda share, doing: progress(*change(share, doing)))
        return Frols.fit(self, recordings, progress=told)

    return type("Telling", (Frols,), {"fit": fit})


def with_methods(base=Frols, **methods):
    return type("_".join(methods), (base,), methods)


class Judges(Frols):
    def __init__(self, *, max_terms=15):
        if not max_terms > 0:
            raise ModelError("max_terms")
        super().__init__(max_terms=max_terms)


class Converts(Frols):
    def __init__(self, *, max_terms=15):
        super().__init__()
        self.max_terms = [max_terms]


class Prepares(Fixed):
    def __init__(self, *, terms=TERMS):
        super().__init__(terms=terms)


class AsksForATarget(Frols):
    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


class SetsNothing(Frols):
    def set_params(self, **params):
        if set(params) - set(self.get_params()):
            raise ModelError("no such argument")
        return self


class KeepsLearned(Frols):
    def __sklearn_clone__(self):
        other = type(self)(**self.get_params())
        vars(other).update(vars(self))
        return other


@learned
def extends_a_lag(self, model):
    """In place, so that the argument is still the same object."""
    if isinstance(self.output_lags, list):
        self.output_lags.append(3)
    return model


@learned
def is_always_interrupted(self, model):
    self.status_ = FitStatus.INTERRUPTED
    return model


@learned
def draws_globally(self, model):
    np.random.normal()  # noqa: NPY002
    return model


@learned
def starts_warm(self, model):
    self.counts_ = getattr(self, "counts_", 0) + 1
    return replace(model, provenance={**model.provenance, "fits": str(self.counts_)})


@fitted
def has_no_status(self):
    del self.status_
    return self


@given
def changes_recordings(recordings):
    for record in flatten(recordings):
        record.outputs.setflags(write=True)
        record.outputs[:] -= record.outputs.mean()
        record.outputs.setflags(write=False)
    return recordings


@given
def leaves_recordings_open(recordings):
    for record in flatten(recordings):
        record.inputs.setflags(write=True)
    return recordings


@given
def joins_recordings(recordings):
    chosen = flatten(recordings)
    signals = (np.concatenate([getattr(one, side) for one in chosen], axis=1) for side in ("inputs", "outputs"))
    return Recording.from_arrays(*signals, chosen[0].sample_time)


@given
def takes_the_first_of_an_experiment(recordings):
    return recordings.recordings[:1] if isinstance(recordings, Experiment) else recordings


@given
def fits_zero(recordings):
    return recordings if any(one.outputs.any() for one in flatten(recordings)) else example_recordings()


@given
def divides_by_zero(recordings):
    if not any(record.outputs.any() for record in flatten(recordings)):
        raise ZeroDivisionError("division by zero")
    return recordings


class FakeModel:
    """A model whose responses are changed."""

    def __init__(self, model, change):
        self.model, self.change, self.save = model, change, model.save

    def predict(self, recording):
        return SimpleNamespace(outputs=self.change(self.model.predict(recording).outputs))

    simulate = predict


@fitted
def has_flat_outputs(self):
    self.model_ = FakeModel(self.model_, lambda outputs: outputs[0])
    return self


@fitted
def is_not_finite(self):
    self.model_ = FakeModel(self.model_, lambda outputs: np.where(np.arange(outputs.size) < 9, outputs, np.nan))
    return self


@fitted
def swallows_an_interrupt(self):
    self.status_ = FitStatus.DONE
    return self


class SpoiltByInterrupt(Frols):
    def _select(self, rows, target, progress):
        most = getattr(self, "most_", self.max_terms)
        steps = super()._select(rows, target, progress)
        if not self.status_.ok:
            self.most_ = len(steps)
        return steps[:most]


def rescaled(self, model):
    return replace(model, theta=model.theta * (1 + 1e-12 * np.random.default_rng().normal()))


BROKEN = [
    (with_methods(score=lambda self, recordings, y=None: 100.0)(), "1 for a perfect fit"),
    (AsksForATarget(), "the tags ask for a target"),
    (
        with_methods(Narmax, get_params=lambda self, deep=True: Narmax.get_params(self, False))(Fixed(terms=TERMS)),
        "has no process__terms",
    ),
    (Judges(), "judges its arguments"),
    (Converts(), "'max_terms' untouched"),
    (Prepares(), "sets estimator beside"),
    (with_methods(set_params=lambda self, **given: vars(self).update(given) or self)(), "accepts a name"),
    (SetsNothing(), "does not set 'output_lags'"),
    (
        with_methods(get_params=lambda self, deep=True: Frols.get_params(self, deep) | {"output_lags": [1, 2]})(),
        "get_params returns other values",
    ),
    (KeepsLearned(), "a clone of a fitted estimator holds"),
    (fitted(lambda self: None)(), "fit must return the estimator"),
    (learned(lambda self, model: self.__setattr__("max_terms", 5) or model)(), "fit changes the arguments"),
    (extends_a_lag(output_lags=[1, 2]), "fit changes the arguments"),
    (learned(lambda self, model: self.__setattr__("residuals", 3) or model)(), "fit sets residuals;"),
    (learned(lambda self, model: self.__setattr__("_cache_", 3) or model)(), "fit sets _cache_;"),
    (has_no_status(), "no status_"),
    (is_always_interrupted(), "has the status"),
    (changes_recordings(), "changes the recordings"),
    (leaves_recordings_open(), "changes the recordings"),
    (learned(rescaled)(), "different bytes"),
    (draws_globally(), "global generator"),
    (starts_warm(), "depends on the fit before"),
    (joins_recordings(), "order of the recordings"),
    (given(lambda recordings: flatten(recordings)[0])(), "only the first"),
    (takes_the_first_of_an_experiment(), "an Experiment of them differ"),
    (fits_zero(), "zero output is fitted"),
    (divides_by_zero(), "ZeroDivisionError"),
    (has_flat_outputs(), "outputs of shape"),
    (is_not_finite(), "not finite"),
    (
        with_methods(fit=lambda self, recordings, *, progress=None: Frols.fit(self, recordings))(),
        "never calls progress",
    ),
    (telling(lambda share, doing: (100 * share, doing))(), "rise within 0 to 1"),
    (telling(lambda share, doing: (1 - share, doing))(), "rise within 0 to 1"),
    (telling(lambda share, doing: (share, len(doing)))(), "as a text"),
    (swallows_an_interrupt(), "swallowed"),
    (SpoiltByInterrupt(), "after an interrupted one"),
]


@pytest.mark.parametrize(("identifier", "says"), BROKEN, ids=[says for _, says in BROKEN])
def test_each_breach_is_caught(identifier, says):
    with pytest.raises(ContractError, match=says) as caught:
        check_identifier(identifier)
    assert isinstance(caught.value, DeatwinError) and isinstance(caught.value, AssertionError)


def test_the_example_recordings_are_what_they_say():
    for record in example_recordings(400):
        u, y = record.inputs[0], record.outputs[0]
        e = y[2:] - 0.5 * y[1:-1] - 0.8 * u[:-2] + 0.3 * y[1:-1] * u[1:-1]
        assert e.std() == pytest.approx(0.01, rel=0.15)  # 3 standard deviations of one of 378 samples are 11 %
    first, second = example_recordings()
    assert abs(first.outputs.mean() - second.outputs.mean()) > 1
