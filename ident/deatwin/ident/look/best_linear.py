"""The best linear approximation of a periodic recording, with its noise and its odd and even nonlinear distortions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import real_number, whole_number
from deatwin.ident.look.approximation import BestLinearApproximation, Lines
from deatwin.ident.narx.regression import Recordings, flatten, require_alike
from deatwin.ident.narx.repeats import period_of, whole_multiple
from deatwin.plant.arguments import taking
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording, label

_EXCITED = 1e-4
"""Share of the largest line's power from which on a line counts as excited: generators distort by less than -40 dB."""
_OFF_CLOCK = 0.125  # Samples by which a period that was found may leave the clock over the record: finer is none found
_ABOVE_NOISE = 10.0
"""Times its own noise that the power of an excited line is: noise alone exceeds it in 1 line of 20 000."""
_NEIGHBOURS = 6
"""Detection lines whose mean is the distortion of an excited one: six tell it within 2 dB (one deviation)."""
_SETTLED = 0.99  # Probability that a period without a transient is kept
_SURE = 0.95  # Probability that the distortion exceeds its lower bound
_SAME = 0.99  # Correlation from which on two inputs are one signal, the one perhaps later than the other
_FINER = 16  # Shifts per sample at which inputs are compared: half of one costs 0.5 % of the correlation at most
_SAME_SIZE = 1.1
"""Ratio of the inputs' rms up to which realisations are alike: what is cubic in the response differs by 20 % then."""


@dataclass(frozen=True)
class _Realisation:
    """Steady-state periods of one input, at lines above 0 Hz and below half the sampling rate: (n_periods, n_all)."""

    inputs: Complex
    outputs: Complex
    left_out: int

    @property
    def means(self) -> tuple[Complex, Complex]:
        return self.inputs.mean(axis=0), self.outputs.mean(axis=0)


@taking(channel=partial(whole_number, least=0), output=partial(whole_number, least=0))
def best_linear_approximation(
    recordings: Recordings, *, period: float | None = None, channel: int = 0, output: int = 0, skip: int | None = None
) -> BestLinearApproximation:
    """Estimate the best linear approximation, the noise and the nonlinear distortion from periodic recordings.

    Differences between periods are attributed to noise. If recordings have different random phases of the input, the
    nonlinear distortion is estimated from the differences between these realisations (robust method). With a single
    realisation, it is estimated from the output on lines that are not excited (fast method, for an odd random-phase
    multisine with detection lines). Recordings of the same input signal count as periods of one realisation.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings with the same channels and sample time, of a periodic input. Between recordings, the rms of the input
        may differ by up to 10 %. Each recording needs at least three periods or, if `skip` is given, at least
        two periods more than `skip`.
    period : float, optional
        Period of the input, s. By default it is estimated from the first recording.
    channel, output : int
        Indices of the input and of the output, from 0. All other inputs must be constant.
    skip : int, optional
        Number of periods to leave out at the start of each recording. By default those before the output has reached
        its steady state.

    Raises
    ------
    DataError
        If a recording is not periodic, has too few periods, or its period is not a whole number of samples. Also if
        another input is not constant, the rms values of the inputs differ by more than 10 %, or no line is excited in
        all recordings.
    ModelError
        If the recordings differ in their channels or sample time, `period` is not a number, or `skip` is not a whole
        number of at least 0.

    References
    ----------
    Pintelon & Schoukens, System Identification: A Frequency Domain Approach (2nd ed. 2012), chapters 3 and 4.
    """
    records = flatten(recordings)
    require_alike(records)
    if not 0 <= channel < records[0].inputs.shape[0] or not 0 <= output < records[0].outputs.shape[0]:
        raise DataError(f"{label(records[0])} has no input {channel} or no output {output}; the numbers begin at 0")
    if skip is not None:
        skip = whole_number(skip, "skip", 0)
    n = _samples_of(records[0], period, channel)
    runs = _distinct([_realisation(record, n, channel, output, skip) for record in records], n)
    excited = _excited(runs)
    means = [run.means for run in runs]
    inputs, outputs = np.array([u for u, _ in means]), np.array([y for _, y in means])
    response = np.mean(outputs[:, excited] / inputs[:, excited], axis=0)
    lines = np.arange(1, excited.size + 1)
    single, noise = _noise(runs, excited, response)
    power = np.mean(np.abs(inputs[:, excited]) ** 2, axis=0)
    # Where a generator excites a detection line faintly, the linear response to that is no distortion.
    at = [np.interp(lines, lines[excited], part) for part in (response.real, response.imag)]
    rest = np.mean(np.abs(outputs - (at[0] + 1j * at[1]) * inputs) ** 2, axis=0)
    beside = _beside(lines, excited)
    complete, dof = len(runs) > 1 or beside is not None, 2.0 * (len(runs) - 1)
    if len(runs) > 1:
        of_one = np.var(outputs[:, excited] / inputs[:, excited], axis=0, ddof=1) * power
    elif beside is not None:
        of_one, dof = rest[beside].mean(axis=1), 2.0 * beside.shape[1]
    else:
        of_one, dof = noise[excited], 2.0 * (len(runs[0].outputs) - 1)
    distortion = np.where(excited, np.nan, rest - noise)
    if complete:
        distortion[excited] = of_one - noise[excited]
    step = records[0].sample_time
    free = sum(len(run.outputs) - 1 for run in runs)
    bounds = [
        _least(group, excited, rest, noise, of_one if complete else None, beside, len(runs), free)
        for group in (lines % 2 == 0, lines % 2 == 1, np.isfinite(distortion))
    ]
    return BestLinearApproximation(
        frequencies=lines[excited] / (n * step),
        response=response,
        variance=of_one / power / len(runs),
        noise_variance=noise[excited] / power / len(runs),
        dof=dof,
        complete=complete,
        all_frequencies=lines / (n * step),
        excited=excited,
        odd=lines % 2 == 1,
        output=np.sqrt(np.mean(np.abs(outputs) ** 2, axis=0)),
        noise=np.sqrt(noise),
        distortion_variance=distortion,
        distortion_low=np.array(bounds),
        realisations=len(runs),
        periods=sum(len(run.outputs) for run in runs),
        left_out=sum(run.left_out for run in runs),
        input_unit=records[0].input_units[channel],
        output_unit=records[0].output_units[output],
        noise_rms=float(np.sqrt(2.0 * single.sum())),
    )


def _samples_of(record: Recording, period: float | None, channel: int) -> int:
    """Return the samples of one period."""
    found = period_of(record.inputs[channel]) if period is None else real_number(period, "period") / record.sample_time
    if found is None:
        raise DataError(
            f"{label(record)}: no period was found in the input {record.input_names[channel]}; give its period"
        )
    # Of a found period several may make a whole number of samples: its lines are then every so many.
    n = (
        whole_multiple(found, record.n_samples, _OFF_CLOCK)
        if period is None
        else round(found)
        if np.isfinite(found)
        else 0
    )
    if n < 4 or (period is not None and abs(found - n) * (record.n_samples // n) > 0.5) or 2 * n > record.n_samples:
        raise DataError(
            f"{label(record)}: a period must be a whole number of at least 4 samples, so that its spectral lines do not leak, but this one is "
            f"{found:.6g} samples long; generate and sample the input with the same clock"
        )
    return n


def _realisation(record: Recording, n: int, channel: int, output: int, skip: int | None) -> _Realisation:
    others = np.delete(record.inputs, channel, axis=0)
    if np.any(np.ptp(others, axis=1) > 0.0):
        raise DataError(
            f"{label(record)}: an input other than {record.input_names[channel]} varies, too; excite one input at a time"
        )
    periods = record.n_samples // n
    needed = 2 + (1 if skip is None else skip)
    if periods < needed:
        raise DataError(
            f"{label(record)}: {periods} whole periods of {n} samples, but {needed} are needed"
            + (
                " (or give skip=0 if the output is already in the steady state in the first period)"
                if skip is None and periods == 2
                else ""
            )
        )
    u, y = (
        np.fft.rfft(row[: periods * n].reshape(periods, n)) / n
        for row in (record.inputs[channel], record.outputs[output])
    )
    inner = slice(1, (n + 1) // 2)
    left_out = _settling(y[:, inner]) if skip is None else skip
    return _Realisation(inputs=u[left_out:, inner], outputs=y[left_out:, inner], left_out=left_out)


def _settling(outputs: Complex) -> int:
    """Return after how many periods the output has settled: neighbouring periods differ no more than the last two."""
    from scipy.special import fdtri

    steps = np.abs(np.diff(outputs, axis=0)) ** 2
    dof = 4.0 * steps[-1].sum() ** 2 / max(np.sum(steps[-1] ** 2), np.finfo(float).tiny)
    settled = steps.sum(axis=1) <= max(fdtri(dof, dof, _SETTLED), 1.0) * steps[-1].sum()
    return int(np.argmax(settled))


def _distinct(runs: Sequence[_Realisation], n: int) -> list[_Realisation]:
    """Join realisations that start the same signal at different times; periods have `n` samples."""
    distinct: list[_Realisation] = []
    for run in runs:
        mean = run.inputs.mean(axis=0)
        for j, other in enumerate(distinct):
            first = other.inputs.mean(axis=0)
            sizes = np.linalg.norm(first), np.linalg.norm(mean)
            if not 1.0 / _SAME_SIZE <= sizes[1] / sizes[0] <= _SAME_SIZE:
                raise DataError(
                    f"the inputs have different rms values, {np.sqrt(2) * sizes[0]:.4g} and {np.sqrt(2) * sizes[1]:.4g}, on which "
                    "the best linear approximation depends; give recordings whose inputs have the same rms value"
                )
            shifts = _FINER * n
            alike = np.fft.irfft(np.concatenate([[0.0], mean * first.conj()]), shifts) * shifts / 2.0
            if alike.max() > _SAME * sizes[0] * sizes[1]:
                turn = np.exp(2j * np.pi * np.arange(1, mean.size + 1) * int(np.argmax(alike)) / shifts)
                distinct[j] = _Realisation(
                    np.vstack([other.inputs, run.inputs * turn]),
                    np.vstack([other.outputs, run.outputs * turn]),
                    other.left_out + run.left_out,
                )
                break
        else:
            distinct.append(run)
    return distinct


def _excited(runs: Sequence[_Realisation]) -> Lines:
    """Return which lines every realisation excites."""
    found = []
    for run in runs:
        power = np.abs(run.inputs.mean(axis=0)) ** 2
        noise = np.var(run.inputs, axis=0, ddof=1) / len(run.inputs)
        found.append((power > _EXCITED * power.max()) & (power > _ABOVE_NOISE * noise))
    excited = np.logical_and.reduce(found)
    if not excited.any():
        raise DataError(
            "no spectral line is excited in all recordings; give recordings whose inputs contain the same harmonics"
        )
    return np.asarray(excited, dtype=np.bool_)


def _noise(runs: Sequence[_Realisation], excited: Lines, response: Complex) -> tuple[Array, Array]:
    """Return the variances of the output's noise: in one period, and in the mean over a realisation's periods."""
    gain = np.zeros(excited.size, dtype=np.complex128)
    gain[excited] = response
    single = np.array([np.var(run.outputs - gain * run.inputs, axis=0, ddof=1) for run in runs])
    counts = np.array([len(run.outputs) for run in runs])
    return single.mean(axis=0), (single / counts[:, None]).mean(axis=0)


def _least(
    group: Lines,
    excited: Lines,
    rest: Array,
    noise: Array,
    of_one: Array | None,
    beside: NDArray[np.int64] | None,
    realisations: int,
    free: int,
) -> float:
    """95 % lower bound of a group's rms distortion, NaN if unknown. Shapes: (n_all,), `of_one` (n_excited,)."""
    from scipy.special import fdtri

    own = group[excited]
    if own.any() and of_one is None:
        return float("nan")
    power, dof = np.where(group & ~excited, rest, 0.0), np.full(rest.size, 2.0 * realisations)
    if of_one is not None and realisations > 1:
        power[excited], dof[excited] = np.where(own, of_one, 0.0), 2.0 * (realisations - 1)
    elif of_one is not None and beside is not None:  # a detection line that stands for excited ones counts with them
        weights = np.bincount(beside[own].ravel(), minlength=rest.size) / beside.shape[1]
        power = power + weights * rest
    total, chance = power.sum(), noise[group].sum()
    tiny = np.finfo(float).tiny
    of_rest = total**2 / max(np.sum(power**2 / dof), tiny)
    of_noise = chance**2 / max(np.sum(noise[group] ** 2) / (2.0 * free), tiny)
    if not of_rest > 0.0 or not of_noise > 0.0:
        return float(np.sqrt(2.0 * total))
    return float(np.sqrt(2.0 * max(total / fdtri(of_rest, of_noise, _SURE) - chance, 0.0)))


def _beside(lines: NDArray[np.int64], excited: Lines) -> NDArray[np.int64] | None:
    """Return the nearest detection lines of equal parity, (n_excited, n_neighbours); None if there are none."""
    band = slice(int(np.argmax(excited)), excited.size - int(np.argmax(excited[::-1])))
    inside = np.zeros_like(excited)
    inside[band] = ~excited[band]
    parities = set((lines[excited] % 2).tolist())
    places = {parity: np.flatnonzero(inside & (lines % 2 == parity)) for parity in parities}
    count = min([_NEIGHBOURS, *(place.size for place in places.values())])
    if count == 0:
        return None
    found = np.empty((int(excited.sum()), count), dtype=np.int64)
    for parity, place in places.items():
        own = lines[excited] % 2 == parity
        # The nearest lie among as many places before and after the line.
        first = np.searchsorted(lines[place], lines[excited][own]) - count
        window = np.clip(first, 0, max(place.size - 2 * count, 0))[:, None] + np.arange(min(2 * count, place.size))
        apart = np.abs(lines[place[window]] - lines[excited][own][:, None])
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :count]
        found[own] = place[np.take_along_axis(window, nearest, axis=1)]
    return found
