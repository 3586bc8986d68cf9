"""Output-error calibration of a plant on recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from deatwin.ident.arguments import positive, real_number, whole_number
from deatwin.ident.greybox.covariance import RANK, covariance
from deatwin.ident.greybox.minimum import CLOSE, EVALUATIONS, Interrupted, minimise, settled_at
from deatwin.ident.greybox.parts import Records, parts_of
from deatwin.ident.greybox.problem import Problem, Progress, Response, Watch, unwatched
from deatwin.ident.greybox.starts import EXACT, STARTS, Search, least, with_better
from deatwin.ident.greybox.status import FitStatus
from deatwin.ident.greybox.survey import survey
from deatwin.ident.greybox.tangent import least_within, linearised_rms
from deatwin.plant.arguments import each, instance
from deatwin.plant.arrays import texts
from deatwin.plant.calibrated import TWO_SIDED_95
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, status_of, variable
from deatwin.plant.errors import DataError, ModelError, nearest
from deatwin.plant.model import Plant, require_plant
from deatwin.plant.parameters import Parameter
from deatwin.plant.resolution import solved_like

REMAINING = 10.0
"""Multiple of the tolerance that a linear model may still remove from the squared residual of a settled fit, as a
share. A fit ends when a step removes less than the tolerance itself, and a step may cover only a tenth of the way."""
WHOLE = 1e-9  # Share of a range that an interval may lack at its ends and still count as the whole range
SURVEYS = 3  # Most surveys of one fit, each about a better minimum than the one before
INVOLVED = 1e-8
"""Share of a parameter's square in undetermined directions above which the parameter itself is undetermined, because it
may move freely along them; far above rounding."""


def _fitted(fit: Calibration) -> list[Parameter]:
    return [fit.plant.parameters[name] for name in fit.names]


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration(Described):
    """Result of fitting a plant's free parameters.

    Parameters
    ----------
    plant : Plant
        Plant with the fitted values.
    names : tuple of str
        Names of the fitted parameters.
    covariance : ndarray, shape (n, n)
        Covariance of the n fitted parameters. Each parameter is transformed by its `Scale`: to its value, its logarithm
        or its reciprocal, SI. It is valid for residuals that are correlated in time (Newey and West), and no variance
        is smaller than that for white residuals.
    residuals : ndarray, shape (m,)
        Measured minus simulated readings at the m fitted samples, SI. If the rig has several readings, the residuals of
        the first reading come first; those of the others are scaled so that their noise is equally large.
    jacobian : ndarray, shape (m, n)
        Derivative of the simulated readings with respect to the transformed parameters, SI.
    status : FitStatus
        Outcome of the fit.
    at_bound : tuple of str
        Names of the parameters that ended on a bound of their range.
    evaluations : int
        Number of simulations, summed over all starts.
    starts : int
        Number of starting points.
    agreed : int
        Number of starts that ended with the smallest error.
    equals : tuple of tuple of float
        Other values of the parameters at which fits ended with the smallest error, in the order of `names`, SI.
    reach : tuple of tuple of float
        Lower and upper end of the joint 95 % confidence region for each parameter, SI, found by refits. Empty if the
        squared residual rises as the covariance predicts.
    fault : str
        Reason why the plant cannot be simulated at its starting values; empty if it can.
    """

    plant: Plant
    names: tuple[str, ...]
    covariance: np.ndarray = field(metadata=variable("parameter", "other_parameter"))
    residuals: np.ndarray = field(
        metadata=variable("sample", name="residual", unit=attrgetter("plant.rig.output_unit"))
    )
    jacobian: np.ndarray = field(metadata=variable("sample", "parameter", unit=attrgetter("plant.rig.output_unit")))
    status: FitStatus = field(metadata=status_of())
    at_bound: tuple[str, ...] = field(metadata=attribute(of=lambda fit: list(fit.at_bound)))
    evaluations: int = field(metadata=attribute())
    starts: int = field(default=1, metadata=attribute())
    agreed: int = field(default=1, metadata=attribute())
    equals: tuple[tuple[float, ...], ...] = field(
        default=(), metadata=attribute(of=lambda fit: [value for values in fit.equals for value in values])
    )
    reach: tuple[tuple[float, float], ...] = field(
        default=(), metadata=attribute(of=lambda fit: [value for ends in fit.reach for value in ends])
    )
    fault: str = ""

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "parameter": coordinate("parameter", of=lambda fit: np.array(fit.names, dtype=str)),
        "other_parameter": coordinate("other_parameter", of=lambda fit: np.array(fit.names, dtype=str)),
        "value": variable("parameter", of=lambda fit: [p.value for p in _fitted(fit)]),
        "low": variable("parameter", of=lambda fit: [fit.interval(name)[0] for name in fit.names]),
        "high": variable("parameter", of=lambda fit: [fit.interval(name)[1] for name in fit.names]),
        "unit": variable("parameter", of=lambda fit: np.array([p.unit for p in _fitted(fit)], dtype=str)),
        "determined": variable(
            "parameter", of=lambda fit: np.array([fit.is_determined(name) for name in fit.names], dtype=bool)
        ),
        "scale": variable("parameter", of=lambda fit: np.array([p.scale.value for p in _fitted(fit)], dtype=str)),
        "rms": attribute(),
        "effects": attribute(of=lambda fit: list(fit.plant.effect_names)),
    }

    def __str__(self) -> str:
        if not self.status.ok:
            return self.fault
        agree = f"; {self.agreed} of {self.starts} starts agree" if self.starts > 1 else ""
        unit = f" {self.plant.rig.output_unit}" if self.plant.rig.output_unit not in ("", "1") else ""
        rows = [f"rms {self.rms:.4g}{unit} after {self.evaluations} simulations: {self.status.value}{agree}"]
        for k, (name, parameter) in enumerate(zip(self.names, _fitted(self), strict=True)):
            interval = self.interval(name) if self.is_determined(name) else None
            bound = ", on a bound of its range" if name in self.at_bound else ""
            rows.append(f"  {described(parameter, interval, [values[k] for values in self.equals], bound)}")
        if together := known_together(self.names, self.covariance):
            rows.append(f"  known together better than alone: {', '.join(together)}")
        return "\n".join(rows)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, SI; NaN if the plant could not be simulated."""
        return float("nan") if not self.status.ok else float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def within_reach(self) -> float:
        """Rms residual, SI. If the fit stopped before its minimum, the value that its linearisation predicts there."""
        return linearised_rms(self.residuals, self.jacobian) if self.status is FitStatus.STOPPED else self.rms

    def solved_like(self, other: Plant) -> Calibration:
        """Return the same calibration with a plant that has as many stages and steps as the `other`."""
        return replace(self, plant=solved_like(self.plant, other))

    @cached_property
    def foreseen(self) -> float:
        """Rms residual, SI. If the fit stopped near its minimum, the value that its linearisation predicts within the
        bounds."""
        if self.status is not FitStatus.STOPPED:
            return self.rms
        problem = Problem(plant=self.plant, parts=(), names=self.names)
        moves = problem.smooth()
        slopes, ends = self.jacobian[:, moves], [(end - problem.start())[moves] for end in problem.bounds()]
        least = least_within(self.residuals, slopes, *ends)
        return float(np.sqrt(least)) if self.rms**2 <= CLOSE * least else self.rms

    @property
    def movable(self) -> np.ndarray:
        """Columns of ``jacobian`` for the k parameters that are not on a bound, shape (m, k), SI."""
        return self.jacobian[:, [k for k, name in enumerate(self.names) if name not in self.at_bound]]

    @cached_property
    def undetermined(self) -> frozenset[str]:
        """Names of the parameters that the readings do not determine.

        Such a parameter either hardly changes the readings over its whole range, or other parameters can compensate for
        its change.
        """
        widths = np.ptp(np.reshape([p.ends for p in _fitted(self)], (-1, 2)), axis=1)
        changes = self.jacobian * np.where(np.isfinite(widths), widths, 1.0)
        lengths = np.linalg.norm(changes, axis=0)
        # The range of an arbitrary zero is metres; compared with it, all other parameters would seem to have no effect.
        usual = float(np.median(lengths[lengths > 0.0])) if lengths.any() else 1.0
        changes = changes / np.maximum(lengths / usual, 1.0)
        squares, axes = np.linalg.eigh(changes.T @ changes)
        idle = axes[:, squares <= RANK * squares.max(initial=0.0)]
        shares = (idle**2).sum(axis=1)
        return frozenset(name for name, share in zip(self.names, shares, strict=True) if share > INVOLVED)

    @property
    def given_up(self) -> bool:
        """True if the fit was abandoned because even its minimum would leave too large an error (`hopeless`)."""
        return self.status is FitStatus.GIVEN_UP

    def interval(self, name: str, deviations: float = TWO_SIDED_95) -> tuple[float, float]:
        """Return the confidence interval of a parameter, limited to its physical range.

        Parameters
        ----------
        name : str
            Name of a fitted parameter.
        deviations : float
            Half width in standard deviations of the transformed parameter (`Scale`); by default 1.96, for a 95 %
            interval.

        Returns
        -------
        tuple of float
            Lower and upper end, SI; the whole range if the parameter is undetermined.

        Raises
        ------
        ModelError
            If the parameter was not fitted.
        """
        if name not in self.names:
            raise ModelError(f"{name!r} was not fitted{nearest(name, self.names)}")
        k = self.names.index(name)
        parameter = self.plant.parameters[name]
        if name in self.undetermined:
            return parameter.lower, parameter.upper
        half = deviations * float(np.sqrt(self.covariance[k, k]))
        scale = parameter.scale
        centre = scale.to_coordinate(parameter.value)
        ends = (
            scale.to_value(min(max(centre + side * half, parameter.ends[0]), parameter.ends[1])) for side in (-1, 1)
        )
        low, high = sorted(min(max(end, parameter.lower), parameter.upper) for end in ends)  # clipped against rounding
        return (min(low, self.reach[k][0]), max(high, self.reach[k][1])) if self.reach else (low, high)

    def is_determined(self, name: str) -> bool:
        """Return True unless the interval of parameter `name` is the whole physical range of the parameter."""
        (low, high), parameter = self.interval(name), self.plant.parameters[name]
        slack = WHOLE * (parameter.upper - parameter.lower) if np.isfinite(parameter.upper - parameter.lower) else 0.0
        return not (low <= parameter.lower + slack and high >= parameter.upper - slack)


def calibrate(
    plant: Plant,
    records: Records,
    *,
    names: Sequence[str] | None = None,
    starts: int = STARTS,
    evaluations: int = EVALUATIONS,
    tolerance: float | None = None,
    hopeless: float = np.inf,
    progress: Progress | None = None,
) -> Calibration:
    """Fit a plant's free parameters to recordings by output error.

    The plant is simulated from its state of rest. A trust-region Gauss-Newton method with exact derivatives minimises
    the squared difference between measured and simulated readings within the physical ranges of the parameters. The
    times of events, such as a jump, keep their starting values. The result nevertheless lists them among the fitted
    parameters, and its covariance includes their uncertainty.

    A single fit may end in a local minimum. The fit is therefore repeated from several starting points: the given
    values, and points of a low-discrepancy sequence in the parameters' ranges. Each of these fits begins with a short
    initial part of the recording, which is doubled until it is the whole. The search ends when two starts reach the
    smallest error, within its 95 % uncertainty. If their parameters differ significantly, the result contains both
    solutions.

    Ctrl-C ends the search and returns the best parameters so far, with the status ``INTERRUPTED``. Before the end of
    the first simulation, it raises KeyboardInterrupt.

    Parameters
    ----------
    plant : Plant
        Plant with starting values.
    records : Part, Experiment or Recording, or a sequence of such
        Data to fit. All readings of the rig that a recording contains are fitted, at all samples; a Part selects
        samples. Each experiment or recording starts from rest.
    names : sequence of str, optional
        Names of the parameters to fit; all free parameters by default.
    starts : int
        Largest number of starting points; 1 for a single fit from the plant's values.
    evaluations : int
        Largest number of simulations of the whole recording in each fit.
    tolerance : float, optional
        Relative change of the squared residual below which a fit ends. By default a fit ends within about a tenth of a
        standard error of its minimum.
    hopeless : float
        Limit of the rms residual, SI. A fit is abandoned if its linearisation predicts a larger residual at the
        minimum.
    progress : callable, optional
        Called after each simulation with the share done, between 0 and 1, and a description of the current step.

    Returns
    -------
    Calibration
        Best fit. Its `status` is the outcome, and `agreed` the number of starts that reached it.

    Raises
    ------
    DataError
        If there is no recording, or the units of a recording differ from those of the plant. Also if a name in `names`
        occurs twice or is not that of a free parameter.
    ModelError
        If `plant` is not a Plant, `starts` or `evaluations` is not an integer of at least 1, `tolerance` is not
        positive, or `hopeless` is not a number.

    References
    ----------
    Ljung, System Identification (1999), section 5.5; Branch, Coleman & Li, SIAM J. Sci. Comput. 21 (1999) 1,
    doi:10.1137/S1064827595289108.
    """
    whole_number(starts, "starts")
    whole_number(evaluations, "evaluations")
    real_number(hopeless, "hopeless")
    if tolerance is not None:
        positive(tolerance, "tolerance")
    problem = _problem(plant, records, names, unwatched() if progress is None else Watch(progress))
    try:
        return _calibrated(problem, starts, evaluations=evaluations, tolerance=tolerance, hopeless=hopeless)
    except Interrupted as stop:
        return _calibration(problem, Search(best=stop.best, tried=1, agreed=1))


def descend(
    plant: Plant,
    records: Records,
    *,
    evaluations: int = EVALUATIONS,
    tolerance: float | None = None,
    hopeless: float = np.inf,
    foreseen: float = 0.0,
    response: Response | None = None,
) -> Calibration:
    """Calibrate by one descent, which also ends if two successive linear models agree on the minimum (`foreseen`)."""
    problem = replace(_problem(plant, records, None, unwatched()), response=response)
    return _calibrated(problem, 1, evaluations=evaluations, tolerance=tolerance, hopeless=hopeless, foreseen=foreseen)


def _problem(plant: Plant, records: Records, names: Sequence[str] | None, watch: Watch) -> Problem:
    require_plant(plant, "a calibration")
    instance(Iterable, type(None))(names, "names")
    chosen = tuple(plant.parameters.free) if names is None else texts(names)
    if names is not None and not chosen:
        raise DataError("no name of a parameter to fit is given; leave names out to fit all that are free")
    each(instance(str))(chosen, "names")
    for name in chosen:
        if chosen.count(name) > 1:
            raise DataError(f"the parameter {name} is given twice; each can be fitted once")
        if name not in plant.parameters.free:
            why = (
                "is known" if name in plant.parameters else f"is not a parameter{nearest(name, plant.parameters.free)}"
            )
            raise DataError(f"{name} {why}; parameters that can be fitted: {', '.join(plant.parameters.free)}")
    return Problem(plant=plant, parts=parts_of(records, plant.rig), names=chosen, watch=watch)


def _calibrated(
    problem: Problem, starts: int, *, evaluations: int, tolerance: float | None, **options: float
) -> Calibration:
    search = least(problem, starts, evaluations=evaluations, tolerance=tolerance, **options)
    if search is None:
        return _impossible(problem)
    fit = _calibration(problem, search)
    if starts > 1 and fit.status is FitStatus.SETTLED and not _is_exact(fit, problem):
        problem.watch.begin("looking beyond the intervals")
        try:
            search, fit = _surveyed(problem, search, fit, {"evaluations": evaluations, "tolerance": tolerance})
        except KeyboardInterrupt:
            return replace(fit, status=FitStatus.INTERRUPTED)
    return replace(fit, status=_ended(fit, problem, search, tolerance))


def _calibration(problem: Problem, search: Search) -> Calibration:
    """Make a calibration from the best fit of a search."""
    found = search.best
    lower, upper = problem.bounds()
    span = 1e-4 * (upper - lower)
    near = (found.coordinates - lower < span) | (upper - found.coordinates < span)
    return Calibration(
        plant=problem.plant.with_values(problem.values(found.coordinates)),
        names=problem.names,
        covariance=covariance(found.residuals, found.jacobian),
        residuals=found.residuals,
        jacobian=found.jacobian,
        status=found.status,
        at_bound=tuple(n for n, hit in zip(problem.names, near, strict=True) if hit),
        evaluations=found.evaluations,
        starts=search.tried,
        agreed=search.agreed,
        equals=tuple(tuple(problem.values(one)[name] for name in problem.names) for one in search.equals),
    )


def _surveyed(
    problem: Problem, search: Search, fit: Calibration, options: Mapping[str, Any]
) -> tuple[Search, Calibration]:
    """Return a fit with the parameter ranges found by a survey, or a better minimum if the survey found one."""
    for _ in range(SURVEYS):
        known = np.array([n not in fit.undetermined and n not in fit.plant.event_times for n in fit.names])
        found, spent = survey(problem, search.best, known, TWO_SIDED_95)
        start = None if found is None or found.better is None else problem.values(found.better)
        another = start and minimise(replace(problem, plant=problem.plant.with_values(start)), **options)
        search = with_better(search, another or None, spent)
        fit = _calibration(problem, search)
        if found is not None:
            ends = [problem.values(x) for x in (found.lower, found.upper)]
            fit = replace(fit, reach=tuple((ends[0][name], ends[1][name]) for name in fit.names))
        if not start:
            break
    return search, fit


def _is_exact(fit: Calibration, problem: Problem) -> bool:
    """Return whether the residual consists of rounding errors, so that its gradient means nothing."""
    return fit.rms <= EXACT * float(np.std(np.concatenate([part.measured for part in problem.parts])))


def _ended(fit: Calibration, problem: Problem, search: Search, tolerance: float | None) -> FitStatus:
    """Return the status of a fit: settled only if its gradient is small and no other start contradicts it."""
    if fit.status is not FitStatus.SETTLED:
        return fit.status
    moves = [s and name not in fit.at_bound for name, s in zip(fit.names, problem.smooth(), strict=True)]
    gain = 0.0
    if any(moves) and not _is_exact(fit, problem):
        # Only a gain within the bounds counts: if a parameter hardly matters, its bound does not hide a better fit.
        slopes, ends = fit.jacobian[:, moves], [(end - search.best.coordinates)[moves] for end in problem.bounds()]
        gain = fit.rms**2 - least_within(fit.residuals, slopes, *ends)
    if gain > REMAINING * settled_at(tolerance, fit.residuals.size) * fit.rms**2:
        return FitStatus.UNSETTLED
    if search.tried > 1 and search.agreed < 2:
        return FitStatus.OTHER_MINIMA
    if search.equals:
        return FitStatus.EQUAL_MINIMA
    return fit.status


def _impossible(problem: Problem) -> Calibration:
    n = len(problem.names)
    runs = (problem.plant.simulate(part.experiment) for part in problem.parts)
    fault = next((run.advice for run in runs if not run.status.ok), "the readings' derivative is not finite")
    return Calibration(
        plant=problem.plant,
        names=problem.names,
        covariance=np.full((n, n), np.nan),
        residuals=np.empty(0),
        jacobian=np.empty((0, n)),
        status=FitStatus.IMPOSSIBLE,
        at_bound=(),
        evaluations=1,
        fault=f"the plant cannot be simulated at its starting values: {fault}",
    )


ALIKE = 0.95
"""Correlation above which an interval is more than three times as long as it would be if the other parameter were
known."""


def described(parameter: Parameter, interval: tuple[float, float] | None, others: Sequence[float], bound: str) -> str:
    """Describe a parameter in one line: its interval, or None if undetermined, and other equally good values."""
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    known = "undetermined" if interval is None else _range(parameter, *interval)
    other = "".join(f", or {value:.6g}" for value in others)
    return f"{parameter.name} = {parameter.value:.6g}{unit} ({known}{bound}){other}"


def _range(parameter: Parameter, low: float, high: float) -> str:
    """Write an interval in words; an end of the allowed range does not come from the readings."""
    if low <= parameter.lower:
        return f"{high:.4g} or less"
    return f"{low:.4g} to {high:.4g}" if high < parameter.upper else f"{low:.4g} or more"


def known_together(names: tuple[str, ...], covariance: np.ndarray) -> list[str]:
    """Return pairs of parameters of which one is known much better if the other is known; (n, n)."""
    deviations = np.sqrt(np.diag(covariance))
    sizes = np.outer(deviations, deviations)
    alike = np.divide(covariance, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    pairs = [(j, k) for j, k in zip(*np.triu_indices(len(names), 1), strict=True) if abs(alike[j, k]) > ALIKE]
    return [f"{names[j]} and {names[k]} (correlation {alike[j, k]:.4f})" for j, k in pairs]
