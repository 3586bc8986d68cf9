"""check_identifier: ours keep the contract, and each way of breaking it is caught."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.narx import Frols, Grow, Semp, SvbNarx
from deatwin.ident.narx.estimate import TotalLeastSquares
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.regression import flatten
from deatwin.ident.narx.rules import AtMost
from deatwin.ident.narx.shrinkage import Bayesian, Ridge
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


class Judges(Frols):
    def __init__(self, *, max_terms=15):
        if not max_terms > 0:
            raise ModelError("max_terms")
        super().__init__(max_terms=max_terms)


class ScoresErrors(Frols):
    def score(self, recordings, y=None):
        return 100.0


class AsksForATarget(Frols):
    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


class ForgetsTheInner(Narmax):
    def get_params(self, deep=True):
        return super().get_params(deep=False)


class Converts(Frols):
    def __init__(self, *, max_terms=15):
        super().__init__()
        self.max_terms = [max_terms]


class Prepares(Fixed):
    def __init__(self, *, terms=TERMS):
        super().__init__(terms=terms)


class TakesAnyName(Frols):
    def set_params(self, **params):
        vars(self).update(params)
        return self


class SetsNothing(Frols):
    def set_params(self, **params):
        if set(params) - set(self.get_params()):
            raise ModelError("no such argument")
        return self


class GetsCopies(Frols):
    def get_params(self, deep=True):
        return {**super().get_params(deep), "output_lags": [1, 2]}


class KeepsLearned(Frols):
    def __sklearn_clone__(self):
        other = type(self)(**self.get_params())
        vars(other).update(vars(self))
        return other


class ReturnsNothing(Frols):
    def fit(self, recordings, *, progress=None):
        super().fit(recordings, progress=progress)


class ChangesArguments(Frols):
    def _learn(self, data, progress):
        self.max_terms = min(self.max_terms, 5)
        return super()._learn(data, progress)


class ExtendsALag(Frols):
    """In place, so that the argument is still the same object."""

    def _learn(self, data, progress):
        if isinstance(self.output_lags, list):
            self.output_lags.append(3)
        return super()._learn(data, progress)


class NamesWithoutUnderscore(Frols):
    def _learn(self, data, progress):
        self.residuals = np.zeros(3)
        return super()._learn(data, progress)


class HiddenNames(Frols):
    def _learn(self, data, progress):
        self._cache_ = data
        return super()._learn(data, progress)


class NoStatus(Frols):
    def fit(self, recordings, *, progress=None):
        super().fit(recordings, progress=progress)
        del self.status_
        return self


class AlwaysInterrupted(Frols):
    def _learn(self, data, progress):
        model = super()._learn(data, progress)
        self.status_ = FitStatus.INTERRUPTED
        return model


class ChangesRecordings(Frols):
    def fit(self, recordings, *, progress=None):
        for record in flatten(recordings):
            record.outputs.setflags(write=True)
            record.outputs[:] -= record.outputs.mean()
            record.outputs.setflags(write=False)
        return super().fit(recordings, progress=progress)


class LeavesRecordingsOpen(Frols):
    def fit(self, recordings, *, progress=None):
        for record in flatten(recordings):
            record.inputs.setflags(write=True)
        return super().fit(recordings, progress=progress)


class DrawsUnseeded(Frols):
    def _learn(self, data, progress):
        model = super()._learn(data, progress)
        return replace(model, theta=model.theta * (1 + 1e-12 * np.random.default_rng().normal()))


class DrawsGlobally(Frols):
    def _learn(self, data, progress):
        np.random.normal()  # noqa: NPY002
        return super()._learn(data, progress)


class StartsWarm(Frols):
    def _learn(self, data, progress):
        model = super()._learn(data, progress)
        before = getattr(self, "counts_", 0)
        self.counts_ = before + 1
        return replace(model, provenance={**model.provenance, "fits": str(self.counts_)})


class JoinsRecordings(Frols):
    def fit(self, recordings, *, progress=None):
        chosen = flatten(recordings)
        joined = Recording.from_arrays(
            np.concatenate([record.inputs for record in chosen], axis=1),
            np.concatenate([record.outputs for record in chosen], axis=1),
            chosen[0].sample_time,
        )
        return super().fit(joined, progress=progress)


class TakesTheFirst(Frols):
    def fit(self, recordings, *, progress=None):
        return super().fit(flatten(recordings)[0], progress=progress)


class ExperimentsDiffer(Frols):
    def fit(self, recordings, *, progress=None):
        if isinstance(recordings, Experiment):
            recordings = recordings.recordings[:1]
        return super().fit(recordings, progress=progress)


class FitsZero(Frols):
    def fit(self, recordings, *, progress=None):
        chosen = flatten(recordings)
        if not any(record.outputs.any() for record in chosen):
            chosen = example_recordings()
        return super().fit(chosen, progress=progress)


class DividesByZero(Frols):
    def fit(self, recordings, *, progress=None):
        if not any(record.outputs.any() for record in flatten(recordings)):
            raise ZeroDivisionError("division by zero")
        return super().fit(recordings, progress=progress)


class FakeResponse:
    def __init__(self, outputs):
        self.outputs = outputs


class FakeModel:
    """A model whose responses are changed."""

    def __init__(self, model, change):
        self.model, self.change, self.save = model, change, model.save

    def predict(self, recording):
        return FakeResponse(self.change(self.model.predict(recording).outputs))

    simulate = predict


class FlatOutputs(Frols):
    def fit(self, recordings, *, progress=None):
        super().fit(recordings, progress=progress)
        self.model_ = FakeModel(self.model_, lambda outputs: outputs[0])
        return self


class NotFinite(Frols):
    def fit(self, recordings, *, progress=None):
        super().fit(recordings, progress=progress)
        self.model_ = FakeModel(self.model_, lambda outputs: np.where(np.arange(outputs.size) < 9, outputs, np.nan))
        return self


class SaysNothing(Frols):
    def fit(self, recordings, *, progress=None):
        return super().fit(recordings)


class TellsPercent(Frols):
    def fit(self, recordings, *, progress=None):
        return super().fit(recordings, progress=progress and (lambda share, doing: progress(100 * share, doing)))


class TellsBackwards(Frols):
    def fit(self, recordings, *, progress=None):
        return super().fit(recordings, progress=progress and (lambda share, doing: progress(1 - share, doing)))


class TellsNumbers(Frols):
    def fit(self, recordings, *, progress=None):
        return super().fit(recordings, progress=progress and (lambda share, doing: progress(share, len(doing))))


class Swallows(Frols):
    def fit(self, recordings, *, progress=None):
        super().fit(recordings, progress=progress)
        self.status_ = FitStatus.DONE
        return self


class SpoiltByInterrupt(Frols):
    def _select(self, rows, target, progress):
        most = getattr(self, "most_", self.max_terms)
        steps = super()._select(rows, target, progress)
        if not self.status_.ok:
            self.most_ = len(steps)
        return steps[:most]


BROKEN = [
    (ScoresErrors(), "1 for a perfect fit"),
    (AsksForATarget(), "the tags ask for a target"),
    (ForgetsTheInner(Fixed(terms=TERMS)), "has no process__terms"),
    (Judges(), "judges its arguments"),
    (Converts(), "'max_terms' untouched"),
    (Prepares(), "sets estimator beside"),
    (TakesAnyName(), "accepts a name"),
    (SetsNothing(), "does not set 'output_lags'"),
    (GetsCopies(), "get_params returns other values"),
    (KeepsLearned(), "a clone of a fitted estimator holds"),
    (ReturnsNothing(), "fit must return the estimator"),
    (ChangesArguments(), "fit changes the arguments"),
    (ExtendsALag(output_lags=[1, 2]), "fit changes the arguments"),
    (NamesWithoutUnderscore(), "fit sets residuals;"),
    (HiddenNames(), "fit sets _cache_;"),
    (NoStatus(), "no status_"),
    (AlwaysInterrupted(), "has the status"),
    (ChangesRecordings(), "changes the recordings"),
    (LeavesRecordingsOpen(), "changes the recordings"),
    (DrawsUnseeded(), "different bytes"),
    (DrawsGlobally(), "global generator"),
    (StartsWarm(), "depends on the fit before"),
    (JoinsRecordings(), "order of the recordings"),
    (TakesTheFirst(), "only the first"),
    (ExperimentsDiffer(), "an Experiment of them differ"),
    (FitsZero(), "zero output is fitted"),
    (DividesByZero(), "ZeroDivisionError"),
    (FlatOutputs(), "outputs of shape"),
    (NotFinite(), "not finite"),
    (SaysNothing(), "never calls progress"),
    (TellsPercent(), "rise within 0 to 1"),
    (TellsBackwards(), "rise within 0 to 1"),
    (TellsNumbers(), "as a text"),
    (Swallows(), "swallowed"),
    (SpoiltByInterrupt(), "after an interrupted one"),
]


@pytest.mark.parametrize(("identifier", "says"), BROKEN, ids=lambda one: type(one).__name__)
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
