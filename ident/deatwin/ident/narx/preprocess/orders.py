"""Choose lags and degree of a NARX model by the free-run error on held-out data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import product
from operator import attrgetter
from typing import ClassVar

import numpy as np

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.ident.narx.terms import Lags, lags_anywhere
from deatwin.plant.arguments import instance, taking
from deatwin.plant.datasets import Described, Metadata, attribute, squared, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_BLOCKS = 10  # blocks of the squared errors, whose means show how certain their mean is


class TrialStatus(Enum):
    """Outcome of a trial. The value of each member is a message for the user."""

    DONE = "done"
    DIVERGED = "the free run over the held-out data diverged"
    FAILED = "no model could be fitted: see the reason"


@dataclass(frozen=True, kw_only=True)
class OrderTrial:
    """Trial of one combination of lags and degree.

    Parameters
    ----------
    output_lags, input_lags : Lags
        Lags in samples, in the form of the identifier's parameters of the same names.
    degree : int
        Largest degree of the candidate terms.
    n_terms : int
        Number of terms of the fitted model; 0 if there is no model.
    error : float
        Root mean square of the free-run error over the held-out data, in the output's unit; infinite if there is no
        model or its free run diverged.
    mean_square : float
        Square of ``error``, in the squared unit of the output.
    standard_error : float
        Standard error of ``mean_square``, in the squared unit of the output. It is computed from the means of ten
        blocks of the held-out data.
    status : TrialStatus
        Outcome of the trial.
    reason : str
        Reason of a failure, otherwise empty.
    """

    output_lags: Lags = field(metadata=variable(of=lambda trial: str(trial.output_lags)))
    input_lags: Lags = field(metadata=variable(of=lambda trial: str(trial.input_lags)))
    degree: int
    n_terms: int = 0
    error: float = field(
        default=np.inf, metadata=variable(unit=attrgetter("unit"), about="RMS of the free run, held-out data")
    )
    mean_square: float = field(default=np.inf, metadata=variable(unit=lambda choice: squared(choice.unit)))
    standard_error: float = field(
        default=np.inf,
        metadata=variable(unit=lambda choice: squared(choice.unit), about="standard error of mean_square"),
    )
    status: TrialStatus = field(default=TrialStatus.FAILED, metadata=variable(of=lambda trial: trial.status.name))
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class OrderChoice(Described):
    """Trials over a grid of lags and degrees, and the choice among them.

    Parameters
    ----------
    trials : tuple of OrderTrial
        Trials at all grid points, including those that failed.
    unit : str
        Unit of the output and of the errors.
    """

    trials: tuple[OrderTrial, ...] = field(metadata=table_along("trial", name=""))
    unit: str = ""

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "chosen": variable(
            "trial", of=lambda choice: [bool(choice.done) and trial is choice.chosen for trial in choice.trials]
        ),
        "n_done": attribute(of=lambda choice: len(choice.done)),
    }

    @property
    def done(self) -> tuple[OrderTrial, ...]:
        """Trials whose free run did not diverge."""
        return tuple(trial for trial in self.trials if trial.status is TrialStatus.DONE)

    @property
    def best(self) -> OrderTrial:
        """Trial with the smallest error; ModelError if all trials failed or diverged."""
        if not self.done:
            raise ModelError("no model of the grid ran free over the held-out data: there is nothing to choose")
        return min(self.done, key=lambda trial: trial.mean_square)

    @property
    def chosen(self) -> OrderTrial:
        """Trial of the smallest model whose ``mean_square`` is within one standard error of the best trial's.

        This is the one-standard-error rule (Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd
        ed., 2009, section 7.10). The smallest model has the fewest terms; among equals, the lowest degree and then the
        fewest lags. ModelError if all trials failed or diverged.
        """
        limit = self.best.mean_square + self.best.standard_error
        return min((trial for trial in self.done if trial.mean_square <= limit), key=_size)

    def __str__(self) -> str:
        lines = ["output lags  input lags  degree  terms  free-run error"]
        for trial in self.trials:
            error = f"{trial.error:.4g} {self.unit}" if trial.status is TrialStatus.DONE else trial.status.name.lower()
            mark = "  <- chosen" if self.done and trial is self.chosen else ""
            lags = f"{_short(trial.output_lags):>11}  {_short(trial.input_lags):>10}"
            lines.append(f"{lags}  {trial.degree:>6}  {trial.n_terms:>5}  {error}{mark}")
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the free-run error over the largest output lag on `ax` or new axes, with a line for each degree.

        A cross at the top marks a trial that failed or diverged. If several input lags were tried with the same output
        lags, the line shows the smallest error.
        """
        axes = axes_or_new(ax)
        top = 2.0 * max((trial.error for trial in self.done), default=1.0)
        for number, degree in enumerate(sorted({trial.degree for trial in self.trials})):
            mine = [trial for trial in self.trials if trial.degree == degree]
            places = sorted({_largest(trial.output_lags) for trial in mine})
            errors = [min(t.error for t in mine if _largest(t.output_lags) == place) for place in places]
            finite = np.isfinite(errors)
            label = "linear" if degree == 1 else f"degree {degree}"
            (line,) = axes.plot(np.array(places)[finite], np.array(errors)[finite], "o-", label=label)
            lost = np.array(places)[~finite]
            axes.plot(lost, np.full(lost.size, top * 1.4**number), "x", color=line.get_color())
        if len(self.done) < len(self.trials):
            axes.plot([], [], "x", color="0.4", label="diverged, or no model")
        if self.done:
            chosen = self.chosen
            axes.plot(
                _largest(chosen.output_lags),
                chosen.error,
                "o",
                markersize=14,
                fillstyle="none",
                color="k",
                label="chosen",
            )
        axes.set_yscale("log")
        axes.locator_params(axis="x", integer=True)
        axes.set_xlabel("largest output lag (samples)")
        axes.set_ylabel(f"free-run error ({self.unit})" if self.unit else "free-run error")
        axes.legend()
        return axes


@taking(identifier=instance(NarxIdentifier))
def choose_orders(
    identifier: NarxIdentifier,
    training: Recordings,
    validation: Recordings,
    *,
    output_lags: Iterable[Lags],
    input_lags: Iterable[Lags] | None = None,
    degrees: Iterable[int] = (1, 2, 3),
) -> OrderChoice:
    """Fit models over a grid of lags and degrees and compare their free runs on held-out data.

    All errors are computed over the same samples: those after the largest lag of the grid. If an input has a dead time
    (`estimate_dead_time`), give input lags that begin at the dead time (`lags_after`).

    Parameters
    ----------
    identifier : NarxIdentifier
        Estimator. At each grid point, a clone of the estimator with the lags and degree of that point is fitted.
    training, validation : Recording, Experiment, or several
        Data for the fits and held-out data for the free runs, with one output.
    output_lags : iterable of Lags
        Output lags to try. Each entry is a number n for the lags 1 to n, or a sequence of lags.
    input_lags : iterable of Lags, optional
        Input lags to try with each entry of `output_lags`, in the same form; several inputs can have different lags, as
        in the identifier. By default, the input lags equal the output lags.
    degrees : iterable of int
        Degrees to try.

    Raises
    ------
    ModelError
        If lags or degrees are not given as a list, the grid is empty, or a held-out recording is too short for the
        largest lag.
    """
    held_out, train = flatten(validation), flatten(training)
    for name, tried in (("output_lags", output_lags), ("input_lags", input_lags), ("degrees", degrees)):
        if isinstance(tried, str) or not (isinstance(tried, Iterable) or (tried is None and name == "input_lags")):
            raise ModelError(f"{name} = {tried!r}; give all that are tried, as [1, 2, 3]")
    own = list(output_lags)
    pairs = zip(own, own, strict=True) if input_lags is None else product(own, input_lags)
    grid = [
        OrderTrial(output_lags=y, input_lags=u, degree=d)
        for d, (y, u) in product((whole_number(d, "a degree") for d in degrees), list(pairs))
    ]
    if not grid:
        raise ModelError("the grid is empty: give output lags and degrees")
    first = max(max(_largest(trial.output_lags), _largest(trial.input_lags)) for trial in grid)
    if any(record.n_samples < first + 2 * _BLOCKS for record in held_out):
        raise ModelError(
            f"a held-out recording is shorter than the {first + 2 * _BLOCKS} samples that lags up to {first} need"
        )
    trials = tuple(_try(identifier, trial, train, held_out, first) for trial in grid)
    return OrderChoice(trials=trials, unit=held_out[0].output_units[0])


def _try(
    identifier: NarxIdentifier,
    trial: OrderTrial,
    training: tuple[Recording, ...],
    validation: tuple[Recording, ...],
    first: int,
) -> OrderTrial:
    """Fit one point of the grid, and simulate it."""
    point = {"output_lags": trial.output_lags, "input_lags": trial.input_lags, "degree": trial.degree}
    clone = type(identifier)(**(identifier.get_params(deep=False) | point))
    try:
        model = clone.fit(training).model_
    except (ModelError, np.linalg.LinAlgError) as error:
        return replace(trial, status=TrialStatus.FAILED, reason=str(error))
    runs = [model.simulate(record) for record in validation]
    fitted = replace(trial, n_terms=len(model.terms), status=TrialStatus.DIVERGED)
    if not all(run.status.ok for run in runs):
        return fitted
    squares = np.concatenate([(run.measured - run.outputs)[0, first:] ** 2 for run in runs])
    mean_square = float(squares.mean())
    return replace(
        fitted,
        error=float(np.sqrt(mean_square)),
        mean_square=mean_square,
        standard_error=_standard_error(squares),
        status=TrialStatus.DONE,
    )


def _short(lags: Lags) -> str:
    """Write consecutive lags by the first and the last."""
    listed = lags_anywhere(lags)
    if isinstance(lags, int) or len(listed) < 3 or listed[-1] - listed[0] + 1 != len(listed):
        return str(lags)
    return f"{listed[0]}..{listed[-1]}"


def _standard_error(squares: np.ndarray) -> float:
    """Return the standard error of the mean of a correlated sequence, from the means of blocks."""
    means = [block.mean() for block in np.array_split(squares, _BLOCKS)]
    return float(np.std(means, ddof=1) / np.sqrt(_BLOCKS))


def _largest(lags: Lags) -> int:
    return max(lags_anywhere(lags), default=0)


def _size(trial: OrderTrial) -> tuple[int, int, int]:
    counts: Sequence[int] = [len(lags_anywhere(lags)) for lags in (trial.output_lags, trial.input_lags)]
    return trial.n_terms, trial.degree, sum(counts)
