"""What all NARX estimators share: scikit-learn's contract, several outputs, progress and interruption."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from typing import Any, Self

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Recordings, Regression, flatten
from deatwin.ident.narx.terms import Lags, Rule
from deatwin.plant.errors import ModelError, nearest

__all__ = ["FitStatus", "Identifier", "NarxIdentifier", "Progress", "silent"]

Progress = Callable[[float, str], None]
"""Takes the share that is done, 0 to 1, and what is being done."""


class FitStatus(Enum):
    """How a fit ended; the value is the advice."""

    DONE = "done"
    INTERRUPTED = "interrupted: the model is the best that was found until then; fit again for the whole search"
    EDGE_OF_STABILITY = (
        "the best stable model has a pole at the edge of stability: the output integrates, or does not follow from the "
        "input alone, because the plant is unstable or the recording was made in a loop; use Armax"
    )
    LOOP_SUSPECTED = (
        "the input answers to the output, so a loop is suspected, and a model of the output error is biased by it: use "
        "Armax or BoxJenkins, which model the noise"
    )

    @property
    def ok(self) -> bool:
        """Whether the search was completed, and nothing speaks against its result."""
        return self is FitStatus.DONE


class Identifier:
    """An estimator under scikit-learn's contract: arguments are stored untouched under their names."""

    @classmethod
    def _names(cls) -> list[str]:
        return [name for name in inspect.signature(cls.__init__).parameters if name != "self"]

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the arguments by name.

        Parameters
        ----------
        deep : bool
            Part of scikit-learn's contract; without effect, for no argument is an estimator.

        Returns
        -------
        dict
        """
        return {name: getattr(self, name) for name in self._names()}

    def set_params(self, **params: Any) -> Self:
        """Set arguments by name.

        Parameters
        ----------
        **params
            New values.

        Raises
        ------
        ModelError
            If a name is not an argument.
        """
        for name in params:
            if name not in self._names():
                raise ModelError(
                    f"{type(self).__name__} has no argument {name!r}{nearest(name, self._names())}"
                )
        for name, value in params.items():
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.get_params().items())
        return f"{type(self).__name__}({arguments})"


class NarxIdentifier(Identifier, ABC):
    """An estimator of NARX models under scikit-learn's contract.

    Arguments are stored untouched under their names, what is learned ends in ``_``, and ``fit`` returns the
    estimator. Of recordings with several outputs each equation is learned by a clone of its own, from the
    lags of all outputs and inputs.

    Attributes
    ----------
    model_ : NarxModel
        What was learned.
    status_ : FitStatus
        Whether the search was completed.
    equations_ : tuple of NarxIdentifier
        With several outputs, the fitted estimator of each; otherwise empty. What else a class documents as
        learned is then found on these.
    """

    output_lags: Lags
    input_lags: Lags
    degree: int
    rule: Rule | None

    model_: NarxModel
    status_: FitStatus
    equations_: tuple[NarxIdentifier, ...]

    def fit(self, recordings: Recordings, *, progress: Progress | None = None) -> Self:
        """Choose terms and estimate their parameters.

        Ctrl-C ends the search: the best model so far is kept, and ``status_`` says so. Before there is any,
        the interrupt goes on to the caller.

        Parameters
        ----------
        recordings : Recording, Experiment, or several
            Training data of one sample time; each recording starts with its own lags.
        progress : callable, optional
            Takes the share that is done and what is being done.

        Returns
        -------
        NarxIdentifier
            The estimator itself.

        Raises
        ------
        ModelError
            If an argument makes no sense, or the recordings do not suit.
        """
        self._check()
        tell = progress or silent
        chosen = flatten(recordings)
        rows = range(chosen[0].outputs.shape[0])
        data = [self._regression(chosen, row) for row in rows or (0,)]
        if len(data) == 1:
            self.status_, self.equations_ = FitStatus.DONE, ()
            self.model_ = self._learn(data[0], tell)
            return self
        self._learn_each(data, tell)
        return self

    def _learn_each(self, data: list[Regression], progress: Progress) -> None:
        """Fit a clone for each output and join their equations."""
        fitted: list[NarxIdentifier] = []
        for row, regression in enumerate(data):
            fitted.append(self._fitted_clone(regression, _part_of(progress, row, len(data))))
        self.equations_ = tuple(fitted)
        self.status_ = next((one.status_ for one in fitted if not one.status_.ok), FitStatus.DONE)
        self.model_ = NarxModel.joined([one.model_ for one in fitted])

    def _fitted_clone(self, data: Regression, progress: Progress) -> Self:
        """Return an estimator of the same arguments that has learned one equation."""
        one = type(self)(**self.get_params())
        one.status_, one.equations_ = FitStatus.DONE, ()
        one.model_ = one._learn(data, progress)
        return one

    def _regression(self, recordings: Recordings, output: int) -> Regression:
        """Return the regression on all candidates of one output's equation."""
        return Regression.of(
            recordings,
            output_lags=self.output_lags,
            input_lags=self.input_lags,
            degree=self.degree,
            rule=self.rule,
            output=output,
        )

    @abstractmethod
    def _check(self) -> None:
        """Raise ModelError where an argument makes no sense."""

    @abstractmethod
    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        """Set what is learned and return the model of one equation."""


def silent(share: float, doing: str) -> None:
    """Take progress and say nothing.

    Parameters
    ----------
    share : float
        Done, 0 to 1.
    doing : str
        What is being done.
    """


def _part_of(progress: Progress, part: int, parts: int) -> Progress:
    """Return what takes the progress of one part of several."""
    return lambda share, doing: progress((part + share) / parts, f"output {part + 1}: {doing}")
