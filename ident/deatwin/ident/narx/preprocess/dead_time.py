"""Estimate the dead time of each input: the first lag at which the input acts on an output."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only, real_number, whole_number
from deatwin.ident.narx.linear.polynomials import Orders, Polynomials
from deatwin.ident.narx.linear.prediction import PredictionErrorLoss, Record, filtered, starting_points
from deatwin.ident.narx.long_arx import LongArx, Signals, answer_chance, enough_lags, first_samples, n_residuals
from deatwin.ident.narx.regression import Recordings, flatten, require_alike
from deatwin.plant.arguments import each, instance, taking
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording, label

_STRUCTURES = ((1, 1), (2, 1), (1, 2), (2, 2), (3, 2))
"""Numbers of coefficients of B and F: first and second order under a held input, with whole and fractional dead times.
With two poles, a single coefficient of B is needed too, or B = (0, b) one sample early is as probable as B = (b, 0)."""
_FAR = 60.0  # Decrease of 2 log likelihood beyond which a dead time is excluded: 1e-13 of the best one's probability
# Excluded dead times in a row after which only these two structures are tried, until one fits again, as it may with an
# input that repeats itself: the simplest, and two poles with a fractional dead time.
_PATIENCE, _PROBES = 5, (0, 3)
_POLES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99)
"""Poles to start from, two to three times apart, because ARX models of few frequencies can be far from every plant."""


def delay_probabilities(arx: LongArx, which: int, latest: int) -> Array:
    """Return the probabilities (latest + 1,) of dead times, all equally probable a priori, by exp(-BIC/2) of each
    structure (Kass, Wasserman, JASA 90 (1995) 928-934). Squares are measured in units of what the best plant leaves
    beyond the noise, per degree of freedom, as in quasi-likelihood."""
    records = _whitened(arx, which)
    squares = np.full((latest + 1, len(_STRUCTURES)), np.inf)
    n_errors, far = 1, 0
    former: list[Polynomials | None] = [None] * len(_STRUCTURES)
    for delay in range(latest, arx.shortest[which] - 1, -1):
        probing = far >= _PATIENCE
        for number, (nb, nf) in enumerate(_STRUCTURES):
            if probing and number not in _PROBES:
                former[number] = None
                continue
            orders = Orders(na=0, nb=(nb,), nc=0, nd=0, nf=(nf,), nk=(delay,), offset=True)
            cut = latest + 3 - (delay + nb)  # all structures then use the same samples of the output
            loss = PredictionErrorLoss(orders, [(inputs[:, cut:], output[cut:]) for inputs, output in records])
            simplest = former[0] if number else None
            squares[delay, number], former[number] = _least(loss, former[number], simplest)
            n_errors = loss.n_errors
        best, here = squares.min(), squares[delay].min()
        far = far + 1 if here - best > _FAR * arx.variance * _excess(best, n_errors, arx) else 0
    dispersion = arx.variance * _excess(float(squares.min()), n_errors, arx)
    unknowns = np.array([nb + nf for nb, nf in _STRUCTURES])
    evidence = -0.5 * (squares / dispersion + unknowns * np.log(n_errors))
    weights = np.exp(evidence - evidence.max()).sum(axis=1)
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def _excess(squares: float, n_errors: int, arx: LongArx) -> float:
    """Return the best low-order model's residual power beyond the long one, in noise variances."""
    freedom = max(arx.n_unknowns - 6, 1)
    return max(1.0, (squares / arx.variance - (n_errors - arx.n_unknowns)) / freedom)


def _least(
    loss: PredictionErrorLoss, former: Polynomials | None, simplest: Polynomials | None
) -> tuple[float, Polynomials]:
    """Return the smallest sum of squares from three starts: the next dead time, a simple model, and ARX."""
    from scipy.optimize import least_squares

    starts = starting_points(loss.orders, loss.records)[1:]
    if former is not None:
        starts.append(former._replace(b=(former.b[0][1:],)))
    nb, nf, delay = loss.orders.nb[0], loss.orders.nf[0], loss.orders.nk[0]
    if simplest is None:
        starts += [_with_pole(loss, pole) for pole in _POLES]
    else:
        b, f = simplest.b[0], simplest.f[0]
        starts.append(simplest._replace(b=(np.pad(b, (0, delay + nb - b.size)),), f=(np.pad(f, (0, nf + 1 - f.size)),)))
    unknowns = [loss.started(start) for start in starts]
    least = min(unknowns, key=lambda x: float(np.sum(loss.errors(x) ** 2)))
    loss.best = np.inf, least
    loss.errors(least)
    # A hundredth of the noise's variance is far more accurate than a probability needs.
    least_squares(loss.errors, least, loss.gradient, x_scale="jac", ftol=0.01 / loss.n_errors, max_nfev=20)
    square, found = loss.best
    return square, loss.orders.split(found[: loss.orders.n_theta])


def _with_pole(loss: PredictionErrorLoss, pole: float) -> Polynomials:
    """Return the first-order model with a given pole; gain and offset are found by least squares."""
    delay, f = loss.orders.nk[0], np.array([1.0, -pole])
    answer = np.concatenate([filtered([1.0], f, inputs[0])[: output.size - delay] for inputs, output in loss.records])
    target = np.concatenate([output[delay:] for _, output in loss.records])
    gain, offset = np.linalg.lstsq(np.column_stack([answer, np.ones(target.size)]), target, rcond=None)[0]
    one = np.ones(1)
    return Polynomials(a=one, b=(np.r_[np.zeros(delay), gain],), c=one, d=one, f=(f,), offset=float(offset))


def _whitened(arx: LongArx, which: int) -> list[Record]:
    """Return an input and the output, minus the contributions of other inputs, both filtered by A."""
    first = max(arx.n_output_lags, arx.longest if arx.b.shape[0] > 1 else 0)
    records: list[Record] = []
    for inputs, output in arx.signals:
        left = filtered(arx.a, [1.0], output)
        for row, b in enumerate(arx.b):
            if row != which:
                left = left - filtered(b, [1.0], inputs[row])
        records.append((filtered(arx.a, [1.0], inputs[which : which + 1])[:, first:], left[first:]))
    return records


_SEEN = 1e-4  # p-value below which a coefficient is significant: over the 100 lags that are tried, 1 % for a false one
_LOOP = 1e-3  # The same for an input that responds to the output, with one test for each input
_AFTER = 20  # Lags beyond the longest dead time in which the response is sought; half of all lags if these are few


class DeadTimeStatus(Enum):
    """Outcome of a dead-time estimation. The value of each member is a message for the user."""

    FOUND = "the recordings show at which lag the input begins to act"
    AT_ONCE = (
        "the input acts within the sample, unless the recording was made in a closed loop: a controller that reacts within "
        "the sample looks the same"
    )
    LOOP = (
        "the past of the output predicts this input, so a closed loop is suspected; but the input may also be a noisy "
        "reading, or share an unrecorded cause with the output; recordings cannot distinguish these cases. Dead times are "
        "searched only from one sample on, and a dead time that is found may be that of the common cause"
    )
    ALIKE = (
        "very different dead times fit equally well, because the input repeats itself, so none is stated: record with "
        "an input that does not repeat, such as steps of random height"
    )
    POOR = (
        "the input has an effect, but too few frequencies to determine its dead time: record with an input of more "
        "frequencies, such as steps of random height"
    )
    UNSEEN = (
        "no linear effect of the input was detected, so its dead time is unknown: allow longer dead times, use the "
        "square of the input if its effect is even, or record with a stronger input of more frequencies"
    )
    CONSTANT = "the input is constant, so its dead time is unknown: record with a changing input"
    SHORT = "the recordings are too short to determine the dead time: record longer"

    @property
    def ok(self) -> bool:
        """True if there is a single estimate and no sign of a feedback loop."""
        return self in (DeadTimeStatus.FOUND, DeadTimeStatus.AT_ONCE)


@dataclass(frozen=True, kw_only=True, eq=False)
class DeadTime(Rebuilt):
    """Estimated dead time from one input to one output, as `estimate_dead_time` returns it.

    Parameters
    ----------
    input_name, output_name : str
        Names of the two signals.
    sample_time : float
        Time between two samples, in s.
    status : DeadTimeStatus
        Outcome of the estimation.
    probability : float
        Probability that the property `interval` contains the dead time, between 0 and 1.
    probabilities : ndarray, shape (n_lags,)
        Probabilities of the dead times 0, 1, 2, ... samples; empty if there is no estimate.
    searched_to : int
        Longest dead time that was tested, in samples; 0 if none was tested.
    """

    input_name: str
    output_name: str
    sample_time: float
    status: DeadTimeStatus
    probability: float
    probabilities: Array = field(default_factory=lambda: np.empty(0))
    searched_to: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "probabilities", read_only(self.probabilities))

    @property
    def samples(self) -> int | None:
        """Most probable dead time in samples; None if there is no estimate or several fit equally well."""
        told = self.probabilities.size and self.status is not DeadTimeStatus.ALIKE
        return int(np.argmax(self.probabilities)) if told else None

    @property
    def seconds(self) -> float | None:
        """Most probable dead time in s; None if `samples` is None."""
        return None if self.samples is None else self.samples * self.sample_time

    @property
    def interval(self) -> tuple[int, int] | None:
        """Shortest and longest dead time of the credible interval, in samples; None if there is no estimate.

        At most the probability ``(1 - probability) / 2`` lies on either side of the interval.
        """
        if not self.probabilities.size:
            return None
        best = int(np.argmax(self.probabilities))
        tail, below = (1.0 - self.probability) / 2.0, np.cumsum(self.probabilities)
        low, high = (int(np.searchsorted(below, share * below[-1])) for share in (tail, 1.0 - tail))
        return min(low, best), max(high, best)

    def __str__(self) -> str:
        if self.interval is not None and self.samples is None:
            low, high = self.interval
            return f"{self.input_name}: {self.status.value} ({100 * self.probability:g} % interval {low} to {high} samples)"
        if self.samples is None or self.interval is None:
            longest = "1 sample was" if self.searched_to == 1 else f"{self.searched_to} samples were"
            tested = f" ({longest} the longest tested)" if self.searched_to else ""
            return f"{self.input_name}: {self.status.value}{tested}"
        low, high = self.interval
        word = "sample" if self.samples == 1 else "samples"
        found = (
            f"{self.input_name} begins to act on {self.output_name} after {self.samples} {word} "
            f"({self.samples * self.sample_time:.4g} s), {100 * self.probability:g} % interval {low} to {high} samples"
        )
        return found if self.status is DeadTimeStatus.FOUND else f"{found}; {self.status.value}"


@taking(output=partial(whole_number, least=0), max_dead_time=partial(whole_number, least=0))
def estimate_dead_time(
    recordings: Recordings, *, output: int = 0, max_dead_time: int = 100, probability: float = 0.95
) -> tuple[DeadTime, ...]:
    """Estimate the dead time of each input: the first lag at which the input acts on an output.

    The dead time is 0 samples if the output y(k) depends on the input u(k) of the same sample. Usually, each reading is
    taken when the input of the same sample is applied; a plant without transport delay then has a dead time of 1.

    A long ARX model with all inputs whitens the noise. The first lag at which its coefficient of an input differs
    significantly from zero (robust Wald test) is an upper bound of the dead time. Up to that bound, first- and
    second-order plants are fitted to the whitened signals for each dead time, and Schwarz's criterion (BIC) converts the
    likelihoods of these fits to probabilities.

    An input that is held, slow or autocorrelated does not bias the estimate, and coloured noise does not either. With
    strongly correlated inputs, the interval is too narrow by a sample or two, and noise on a measured input makes the
    dead time seem a sample or two shorter. For a plant of higher order, the estimate is the dead time of a low-order
    approximation. If the input repeats itself, as a triangle wave does, several dead times may fit equally well (status
    ``ALIKE``); the interval then covers all of them. A few sines may not determine the dead time at all (``POOR``).

    Each input is also tested for feedback: whether the past of the output predicts the input. For a periodic input, the
    test uses only the differences between periods, so it cannot detect feedback in recordings without noise. Decimated
    recordings are not tested, because a zero-phase filter makes each sample depend on later ones. At most 20 000 samples
    are used, from the beginning of each recording.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings with the same signals and sample time.
    output : int
        Row index of the output.
    max_dead_time : int
        Longest dead time to test, in samples; in short recordings, only shorter dead times can be tested.
    probability : float
        Probability that the interval contains the dead time, between 0 and 1.

    Returns
    -------
    tuple of DeadTime
        Dead time of each input.

    Raises
    ------
    ModelError
        If an argument is out of range, the output is constant, or the recordings differ in signals or sample time.
    """
    chosen = flatten(recordings)
    _require(chosen, output, max_dead_time, probability)
    inputs = np.concatenate([record.inputs for record in chosen], axis=1)
    moving = np.flatnonzero(np.ptp(inputs, axis=1) > 0.0)
    signals = _scaled(chosen, moving, output)
    longest = enough_lags(signals, moving.size, max_dead_time + _AFTER)
    found = [
        DeadTime(
            input_name=name,
            output_name=chosen[0].output_names[output],
            sample_time=chosen[0].sample_time,
            status=DeadTimeStatus.SHORT if which in moving else DeadTimeStatus.CONSTANT,
            probability=probability,
        )
        for which, name in enumerate(chosen[0].input_names)
    ]
    if longest > 1:
        signals = [(u, y) for u, y in signals if n_residuals([(u, y)], longest) > 0]
        decimated = any("decimated" in record.provenance for record in chosen)
        answers = [math.nan if decimated else answer_chance(signals, row, longest) for row in range(moving.size)]
        # A controller that responds within the sample acts at lag 0, whatever the plant does, so a loop is searched
        # from lag 1.
        arx = LongArx.of(signals, longest, shortest=[int(chance < _LOOP) for chance in answers])
        for row, which in enumerate(moving.tolist()):
            found[which] = _of_input(found[which], arx, row, answers[row])
    return tuple(found)


@taking(dead_times=each(instance(DeadTime)), count=whole_number)
def lags_after(dead_times: Sequence[DeadTime], count: int) -> tuple[int, ...]:
    """Return input lags for a model from the dead-time interval of each input.

    A dead-time interval from ``low`` to ``high`` samples gives the lags ``low`` to ``high + count - 1``; a dead time of
    0 counts as one of 1. The lags are 1 to `count` if the dead time is unknown, or if several dead times fit equally
    well. If feedback is suspected, the lags 1 to `count` are added to those of the interval.

    Parameters
    ----------
    dead_times : sequence of DeadTime
        Dead time of each input. Constant inputs are ignored.
    count : int
        Number of lags from ``high`` on; the first one is included.

    Returns
    -------
    tuple of int
        Lags of all inputs together, in ascending order; 1 to `count` if all inputs are constant.
    """
    lags: set[int] = set()
    for one in dead_times:
        if one.status is DeadTimeStatus.CONSTANT:
            continue
        interval = one.interval if one.interval and one.status is not DeadTimeStatus.ALIKE else (1, 1)
        low, high = (max(1, end) for end in interval)
        lags |= set(range(low, high + count))
        lags |= set(range(1, count + 1)) if one.status is DeadTimeStatus.LOOP else set()
    return tuple(sorted(lags or range(1, count + 1)))


def _require(chosen: Sequence[Recording], output: int, max_dead_time: int, probability: float) -> None:
    require_alike(chosen)
    n_inputs, n_outputs = chosen[0].inputs.shape[0], chosen[0].outputs.shape[0]
    if n_inputs == 0 or not 0 <= output < n_outputs:
        raise ModelError(
            f"the recordings have {n_inputs} inputs and {n_outputs} outputs; a dead time belongs to an input "
            f"to one of the outputs, here output {output}"
        )
    if max_dead_time < 1 or not 0.0 < real_number(probability, "probability") < 1.0:
        raise ModelError(
            f"max_dead_time = {max_dead_time}, probability = {probability}: give at least one sample, and a "
            "probability between 0 and 1"
        )
    if np.ptp(np.concatenate([record.outputs[output] for record in chosen])) == 0.0:
        files = ", ".join(dict.fromkeys(label(record) for record in chosen))
        raise ModelError(
            f'{files}: the output "{chosen[0].output_names[output]}" is constant: no input acts on it; give another '
            "column as output, or record with a stronger input"
        )


def _scaled(chosen: Sequence[Recording], moving: NDArray[np.intp], output: int) -> Signals:
    """Return deviations from the mean, in standard deviations, of the first samples of each recording."""
    parts = first_samples(chosen)
    inputs, outputs = [record.inputs[moving] for record in parts], [record.outputs[output] for record in parts]
    all_u, all_y = np.concatenate(inputs, axis=1), np.concatenate(outputs)
    u_mean, u_std = all_u.mean(axis=1, keepdims=True), all_u.std(axis=1, keepdims=True)
    u_std[u_std == 0.0], y_std = 1.0, float(all_y.std()) or 1.0
    return [((u - u_mean) / u_std, (y - all_y.mean()) / y_std) for u, y in zip(inputs, outputs, strict=True)]


def _of_input(unknown: DeadTime, arx: LongArx, row: int, feedback: float) -> DeadTime:
    """Return the dead time of one moving input, row `row` of the long model."""
    searched_to = arx.longest - min(_AFTER, arx.longest // 2)
    acting = np.flatnonzero(arx.chances(row) < _SEEN)
    status = DeadTimeStatus.LOOP if feedback < _LOOP else DeadTimeStatus.FOUND
    probabilities: Array = np.empty(0)
    if acting.size and acting[0] <= searched_to:
        probabilities = delay_probabilities(arx, row, int(acting[0]))
        if status.ok and not np.argmax(probabilities):
            status = DeadTimeStatus.AT_ONCE
    else:
        status = DeadTimeStatus.POOR if arx.hides(row) else DeadTimeStatus.UNSEEN
    found = replace(unknown, status=status, probabilities=probabilities, searched_to=searched_to)
    if found.interval is None or not status.ok:
        return found
    between = probabilities[found.interval[0] : found.interval[1] + 1]
    # If the interval contains a dead time that is practically excluded, it comes from an input that repeats itself.
    return replace(found, status=DeadTimeStatus.ALIKE) if between.min() < _SEEN * between.max() else found
