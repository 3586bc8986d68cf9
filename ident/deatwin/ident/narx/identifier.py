"""Common base of all NARX estimators: scikit-learn's contract, several outputs, progress and interruption."""

from __future__ import annotations

import copyreg
import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.notes import (
    LAST_INPUT_LAGS,
    constant_inputs,
    excess_notes,
    last_lag,
    late_inputs,
    noisy_products,
)
from deatwin.ident.narx.regression import Recordings, Regression, about_data, about_rest, flatten, require_no_target
from deatwin.ident.narx.shapes import own_functions, rebuilt
from deatwin.ident.narx.terms import Lags, Rule
from deatwin.plant.errors import ModelError, nearest
from deatwin.plant.recording import Recording

Progress = Callable[[float, str], None]  # Called with the completed share, 0 to 1, and the current work


class FitStatus(Enum):
    """Outcome of a fit. The value of each member is a message for the user.

    Estimators that minimise an error by its gradient (`Grow`, `OutputError`, `Armax`, `BoxJenkins`, `Pnlss`, `Cascade`)
    end with ``DONE`` only if the gradient is small. A further Gauss-Newton step would then change the parameters by
    less than a twentieth of their standard deviations (relative offset of Bates and Watts, 1981). The minimum may still
    be a local one.
    """

    DONE = "done"
    HELD_OUT = (
        "the search ended, as intended, when the error on the held-out samples no longer fell: the parameters are "
        "not those with the smallest error on the training data"
    )
    NOT_CONVERGED = (
        "the search ended before the gradient was small: its parameters may still change, and their covariance is not "
        "valid; allow more steps, or fewer terms"
    )
    INTERRUPTED = "interrupted: the model is the best that had been found; fit again to complete the search"

    @property
    def ok(self) -> bool:
        """True if the search was completed and its result passed all checks."""
        return self in (FitStatus.DONE, FitStatus.HELD_OUT)


class Identifier:
    """An estimator under scikit-learn's contract: arguments are stored untouched, so that searches work."""

    model_: Any

    @classmethod
    def _names(cls) -> list[str]:
        return [name for name in inspect.signature(cls.__init__).parameters if name != "self"]

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the arguments by name. `deep` adds the arguments of nested estimators, as ``process__degree``."""
        own = {name: getattr(self, name) for name in self._names()}
        if not deep:
            return own
        inner = {name: value.get_params() for name, value in own.items() if isinstance(value, Identifier)}
        return own | {f"{name}__{key}": value for name, held in inner.items() for key, value in held.items()}

    def set_params(self, **params: Any) -> Self:
        """Set arguments by name, those of nested estimators as ``process__degree=3``; ModelError for unknown names."""
        inner: dict[str, dict[str, Any]] = {}
        for name in params:
            outer, double, key = name.partition("__")
            if outer not in self._names() or (
                double and not isinstance(params.get(outer, getattr(self, outer)), Identifier)
            ):
                known = list(self.get_params())
                raise ModelError(f"{type(self).__name__} has no argument {name!r}{nearest(name, known)}")
            if double:
                inner.setdefault(outer, {})[key] = params[name]
        for name, value in params.items():
            if "__" not in name:
                setattr(self, name, value)
        for outer, held in inner.items():
            getattr(self, outer).set_params(**held)
        return self

    if not TYPE_CHECKING:  # so that mypy still knows which attributes there are

        def __getattr__(self, name: str) -> Any:
            """Say of an attribute that is missing where it is; a fitted model predicts, not its estimator."""
            missing = f"{type(self).__name__} has no attribute {name!r}"
            if "model_" not in vars(self) and not name.startswith("__"):
                raise AttributeError(f"{missing}; fit makes its model_")
            held = not name.startswith("__") and hasattr(self.model_, name)
            raise AttributeError(f"{missing}; its fitted model has: model_.{name}" if held else missing)

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process may not know the registered functions that arguments mention.
        return rebuilt, (own_functions(repr(self)), copyreg.__newobj__, (type(self),)), vars(self)  # type: ignore[attr-defined]

    def score(self, recordings: Recordings, y: None = None) -> float:
        """Return the coefficient of determination of free runs, the mean of all outputs; `y` is unused."""
        if not hasattr(self, "model_"):
            raise ModelError(f"this {type(self).__name__} is not fitted; call fit first")
        runs = [self.model_.simulate(record) for record in flatten(recordings)]
        if not all(run.status.ok for run in runs):
            return -math.inf
        measured = np.concatenate([run.measured[:, run.first :] for run in runs], axis=1)
        errors = np.concatenate([run.residuals for run in runs], axis=1)
        around = measured.var(axis=1)
        if not np.all(around > 0):
            raise ModelError("an output of the recordings is constant: there is nothing to compare a free run with")
        return float(np.mean(1.0 - np.mean(errors**2, axis=1) / around))

    def __sklearn_tags__(self) -> Any:
        """Return scikit-learn's tags of an estimator: it needs no target, because recordings contain the outputs."""
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=False),
            regressor_tags=RegressorTags(),
            input_tags=InputTags(two_d_array=False),
            no_validation=True,
        )

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.get_params(deep=False).items())
        return f"{type(self).__name__}({arguments})"


class NarxIdentifier(Identifier, ABC):
    """Base class of the estimators of NARX models, which follow the conventions of scikit-learn.

    Arguments are stored unchanged under their names, attributes that a fit sets end in ``_``, and ``fit`` returns the
    estimator.

    Estimators that choose terms subtract the mean from a signal whose mean is larger than its variation, because powers
    of such a signal are nearly collinear. If they have done so, all of them except `Grow` fit a second time, with the
    equilibrium of the first model as the origin of the outputs, so that no constant term is needed.

    For recordings with several outputs, a clone of the estimator fits the equation of each output. The terms of each
    equation may contain all outputs and inputs.

    Attributes
    ----------
    model_ : NarxModel
        Fitted model, in physical units.
    status_ : FitStatus
        Outcome of the search.
    notes_ : tuple of str
        Remarks on the fit, one sentence each; usually empty. There is a remark if the one-step error on the training
        data is more than 1 % larger than that of least squares with the same terms. There is another one if the plant
        responds to an input later than the model's largest lag of that input, and one if products of several noisy
        outputs may describe the noise instead of the plant.
    equations_ : tuple of NarxIdentifier
        Fitted estimator of each output if there are several outputs, otherwise empty. Attributes that are not listed
        here then exist only in these estimators.
    """

    output_lags: Lags
    input_lags: Lags
    degree: int
    functions: Sequence[str] = ()
    rule: Rule | None

    model_: NarxModel
    status_: FitStatus
    notes_: tuple[str, ...]
    equations_: tuple[NarxIdentifier, ...]

    def fit(self, recordings: Recordings, y: None = None, *, progress: Progress | None = None) -> Self:
        """Choose terms and estimate their parameters.

        Ctrl-C ends the search and keeps the best model so far, with the status ``INTERRUPTED``. If there is no model
        yet, it raises KeyboardInterrupt.

        Parameters
        ----------
        recordings : Recording, Experiment, or several
            Training data with a common sample time. The first samples of each recording serve as its lagged values.
        y : None
            Argument of scikit-learn's interface, which must be None: the recordings contain the outputs.
        progress : callable, optional
            Called with the share done, between 0 and 1, and a description of the current step.

        Returns
        -------
        NarxIdentifier
            The estimator itself.

        Raises
        ------
        ModelError
            If an argument is invalid, or the recordings do not suit the estimator.
        """
        require_no_target(y)
        self._check()
        tell = progress or silent
        chosen = flatten(recordings)
        rows = range(chosen[0].outputs.shape[0])
        data = [self._regression(chosen, row) for row in rows or (0,)]
        model = self._learn_all(data, tell)
        candidates = str(sum(len(one.table.terms) for one in data))
        last = ", ".join(str(last_lag(data[0].table.terms, column)) for column in range(len(chosen[0].inputs)))
        told = {"candidates": candidates, LAST_INPUT_LAGS: last}
        self.model_ = replace(model, provenance={**model.provenance, **told})
        self.notes_ = constant_inputs(chosen) + self._notes(chosen)
        return self

    def _learn_all(self, data: list[Regression], progress: Progress) -> NarxModel:
        """Return the model of all outputs, relative to their rest if signals lie far from zero."""
        model = self._learn_each(data, progress)
        resting = self._resting(data, model) if self.status_.ok else data
        return model if resting is data else self._learn_each(resting, progress)

    def _resting(self, data: list[Regression], model: NarxModel) -> list[Regression]:
        """Return the regressions relative to the rest of a model, if they use origins from the data."""
        return about_rest(data, model)

    def _learn_each(self, data: list[Regression], progress: Progress) -> NarxModel:
        """Return the model of all outputs; with several, each equation is learned by a clone."""
        self.status_, self.equations_ = FitStatus.DONE, ()
        if len(data) == 1:
            return self._learn(data[0], progress)
        parts = [_part_of(progress, row, len(data)) for row in range(len(data))]
        self.equations_ = tuple(self._fitted_clone(one, part) for one, part in zip(data, parts, strict=True))
        self.status_ = next((one.status_ for one in self.equations_ if not one.status_.ok), FitStatus.DONE)
        return NarxModel.joined([one.model_ for one in self.equations_])

    def _fitted_clone(self, data: Regression, progress: Progress) -> Self:
        """Return a clone of the estimator that has learned one equation."""
        one = type(self)(**self.get_params(deep=False))
        one.model_, one.notes_ = one._learn_all([data], progress), ()
        return one

    def _regression(self, recordings: Recordings, output: int) -> Regression:
        """Return the regression on all candidates of one equation, relative to origins from its data."""
        candidates = Regression.of(
            recordings,
            output_lags=self.output_lags,
            input_lags=self.input_lags,
            degree=self.degree,
            functions=self.functions,
            rule=self.rule,
            output=output,
        )
        return about_data(candidates)

    def _notes(self, recordings: tuple[Recording, ...]) -> tuple[str, ...]:
        """Return the notes on the fit to these recordings."""
        model = self.model_
        return excess_notes(model, recordings) + noisy_products(model, recordings) + late_inputs(model, recordings)

    @contextmanager
    def _keeping(self, found: Callable[[], Any] = lambda: True) -> Iterator[None]:
        """Let Ctrl-C end the work inside, and say so in the status; it reaches the caller if nothing was found yet."""
        try:
            yield
        except KeyboardInterrupt:
            if not found():
                raise
            self.status_ = FitStatus.INTERRUPTED

    @abstractmethod
    def _check(self) -> None:
        """Raise ModelError if an argument makes no sense."""

    @abstractmethod
    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        """Learn one equation, set the results, and return its model."""


@dataclass(kw_only=True, eq=False, repr=False)
class CandidateSearch(NarxIdentifier):
    """An estimator that chooses its terms among the polynomial terms of lagged signals."""

    output_lags: Lags = 2
    input_lags: Lags = 2
    degree: int = 2
    functions: Sequence[str] = ()
    rule: Rule | None = None


def silent(share: float, doing: str) -> None:
    """Ignore all progress."""


def _part_of(progress: Progress, part: int, parts: int) -> Progress:
    """Return a progress function for one of several parts."""
    return lambda share, doing: progress((part + share) / parts, f"output {part + 1}: {doing}")
