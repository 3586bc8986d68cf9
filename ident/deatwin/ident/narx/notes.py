"""Notes on a fit: late or constant inputs, and a one-step error above that of least squares.

Box and Jenkins' correlation of prewhitened signals costs a few sums, so that every fit and every validation can ask
whether an input is late. It takes the slow beginning of a plant for a dead time, so what it suspects is put to
`estimate_dead_time`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from deatwin.ident.narx.long_arx import first_samples
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording

if TYPE_CHECKING:
    from deatwin.ident.narx.preprocess.dead_time import DeadTime


LAST_INPUT_LAGS = "last input lags"
"""Key of a model's provenance: the last lag of each input among the candidates, -1 for none."""
_SEEN = 3.9  # Standard deviations from which a correlation counts: by chance, that of 1 in 10,000 lags does
_BEYOND = 100  # Lags beyond the model's last that are examined, up to a quarter of a recording
_FEW = 3000  # Most samples for the estimate of a dead time, which takes less than a second; far fewer determine it
_WHITENING = 10  # Lags of the autoregression that whitens a signal


def constant_inputs(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return a sentence for each input that is constant in all recordings."""
    values = np.concatenate([record.inputs for record in recordings], axis=1)
    return tuple(
        f'the input "{name}" is constant, so the model does not show how the output depends on it'
        for name, spread in zip(recordings[0].input_names, np.ptp(values, axis=1), strict=True)
        if spread == 0.0
    )


def late_inputs(model: NarxModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return a sentence for each input and output if the input acts only after the model's last lag."""
    from deatwin.ident.narx.preprocess.dead_time import DeadTimeStatus

    longest = max(record.n_samples for record in recordings)
    recordings = [record for record in recordings if record.n_samples > longest // 4]  # enough for the examined lags
    predicted = [model.predict(record) for record in recordings]
    said = []
    for column, row in product(range(len(model.input_names)), range(model.n_outputs)):
        last = last_lag(_terms_of(model, row), column)
        residuals = [response.residuals[row] for response in predicted]
        if not _acts_late(recordings, residuals, (column, row), last, min(last + _BEYOND, longest // 4)):
            continue
        one = _dead_times(tuple(recordings), row)[column]
        told = one.status in (DeadTimeStatus.FOUND, DeadTimeStatus.LOOP)
        if told and one.interval is not None and one.interval[0] > last:
            there = f"later than its last lag in the model, {last}" if last >= 0 else "and is in no term of the model"
            advice = f": allow lags {one.interval[0]} to {one.interval[1] + 2} of {one.input_name}"
            known = one.interval[1] <= _competed(model, column)
            said.append(f"{one}, {there}{', although such lags were candidates' if known else advice}")
    return tuple(said)


def _acts_late(
    recordings: Sequence[Recording], residuals: Sequence[Array], place: tuple[int, int], last: int, most: int
) -> bool:
    """Return whether an output, and what a model leaves of it, follow an input first at a lag beyond the last one."""
    column, row = place
    if most <= last:
        return False
    inputs = _whitened([record.inputs[column] for record in recordings])
    seen = np.flatnonzero(_scores(inputs, _whitened([record.outputs[row] for record in recordings]), most) > _SEEN)
    if not seen.size or seen[0] <= last:
        return False
    left = [  # on the clock of the recordings, with zeros before them
        np.r_[np.zeros(record.n_samples - e.size), e - e.mean()]
        for record, e in zip(recordings, residuals, strict=True)
    ]
    return bool(np.max(_scores(inputs, left, most)[last + 1 :]) > _SEEN)


def _terms_of(model: NarxModel, row: int) -> list[Term]:
    """Return the terms of one output's equation."""
    return [term for term, equation in zip(model.terms, model.equations, strict=True) if equation == row]


@lru_cache(maxsize=1)  # several fits use the same recordings
def _dead_times(recordings: tuple[Recording, ...], row: int) -> tuple[DeadTime, ...]:
    """Return dead times from the first samples of recordings."""
    from deatwin.ident.narx.preprocess.dead_time import estimate_dead_time

    return estimate_dead_time(first_samples(recordings, _FEW), output=row)


def last_lag(terms: Iterable[Term], column: int) -> int:
    """Return the last lag of an input in terms; -1 if it does not occur."""
    return max((v.reach for t in terms for v, _ in t.factors if v.kind == "u" and v.index == column), default=-1)


def _competed(model: NarxModel, column: int) -> int:
    """Return the last lag of an input among the candidates of a model; -1 if that is unknown."""
    told = model.provenance.get(LAST_INPUT_LAGS, "").split(", ")
    return int(told[column]) if len(told) == len(model.input_names) and told[column].isdecimal() else -1


def _whitened(signals: Sequence[Array]) -> list[Array]:
    """Return the residual of each signal after a joint autoregression of all; the first samples are zero."""
    mean = float(np.concatenate(signals).mean())
    centred = [signal - mean for signal in signals]
    rows = [
        np.stack([signal[_WHITENING - lag : signal.size - lag] for lag in range(_WHITENING + 1)])
        for signal in centred
        if signal.size > _WHITENING
    ]
    if not rows:
        return centred
    together = np.concatenate(rows, axis=1)
    weights = np.linalg.lstsq(together[1:].T, together[0])[0]
    taps = np.r_[1.0, -weights]
    return [np.r_[np.zeros(min(_WHITENING, s.size)), np.convolve(s, taps, "valid")][: s.size] for s in centred]


def _scores(inputs: Sequence[Array], outputs: Sequence[Array], most: int) -> Array:
    """Correlations of the output with an earlier input, (most + 1,), in deviations (White, doi:10.2307/1912934)."""
    power = float(np.mean(np.concatenate(outputs) ** 2))
    found = np.zeros(most + 1)
    for lag in range(most + 1):
        pairs = [(u[: y.size - lag], y[lag:]) for u, y in zip(inputs, outputs, strict=True)]
        u, y = (np.concatenate(signals) for signals in zip(*pairs, strict=True))
        products = u * y
        square = max(float(products @ products), power * float(u @ u), np.finfo(float).tiny)
        found[lag] = abs(float(products.sum())) / square**0.5
    return found


_WORTH_SAYING = 0.01
"""Relative excess from which a note is given: a suitable prior costs a share of about n_terms / n_samples or less, and
an error that is larger by 1 % changes no decision."""
_RESOLVED = float(np.sqrt(np.finfo(float).eps))
"""Share of the output below which errors are zero for methods that work with squares of the signals."""


def excess_notes(model: NarxModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return a sentence for each output whose one-step error exceeds that of least squares by more than 1 %."""
    predicted = [model.predict(record) for record in recordings]
    own = np.sqrt(np.mean(np.concatenate([response.residuals for response in predicted], axis=1) ** 2, axis=1))
    notes = []
    for row, error in enumerate(own.tolist()):
        terms = [term for term in _terms_of(model, row) if all(variable.kind != "e" for variable, _ in term.factors)]
        if not terms:
            continue
        data = Regression(TermTable(tuple(terms)), tuple(recordings), model.table.max_lag, row).about(model)
        rows, target = data.matrix()
        sizes = np.linalg.norm(rows, axis=1)
        rows /= np.where(sizes > 0, sizes, 1.0)[:, None]
        left = target - np.linalg.lstsq(rows.T, target)[0] @ rows
        least = data.output_scale * float(np.sqrt(np.mean(left**2)))
        if error > max((1.0 + _WORTH_SAYING) * least, _RESOLVED * data.output_scale):
            spread = float(np.concatenate([record.outputs[row] for record in recordings]).std())
            notes.append(_note(model.output_names[row], error / spread, least / spread))
    return tuple(notes)


def noisy_products(model: NarxModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return a warning about products of several noisy outputs, which represent noise as well as the plant."""
    products = {v.index for term in model.terms if term.degree > 1 for v, _ in term.factors if v.kind == "y"}
    if model.n_outputs == 1 or not products:
        return ()
    errors = np.concatenate([model.predict(record).residuals for record in recordings], axis=1).std(axis=1)
    spreads = np.concatenate([record.outputs for record in recordings], axis=1).std(axis=1)
    shares = np.divide(errors, spreads, out=np.zeros(model.n_outputs), where=spreads > 0)
    if max(shares[row] for row in products) <= _WORTH_SAYING:
        return ()
    told = ", ".join(f"{100 * shares[row]:.2g} % of {model.output_names[row]}" for row in sorted(products))
    return (
        f"the one-step residual is {told}: if it is noise on the readings, this noise also enters the regressors, and terms "
        f"with products of outputs may describe the bias that the noise causes rather than the plant, even if their intervals "
        f"are small; average, filter or repeat the measurement before you interpret these terms",
    )


def _note(name: str, error: float, least: float) -> str:
    """State how much larger an error is than that of least squares, both in standard deviations of the output."""
    if least <= _RESOLVED:  # a ratio to rounding errors says nothing
        excess = (
            f"{error:.2g} of its standard deviation, while least squares on the same terms leaves only rounding errors"
        )
    elif error < 2.0 * least:
        excess = f"{100 * (error / least - 1.0):.3g} % above that of least squares on the same terms"
    else:
        excess = (
            f"{error / least:.3g} times that of least squares on the same terms, {error:.2g} of its standard deviation"
        )
    return (
        f"the one-step error of {name} on the training data is {excess}, because the estimator shrinks the parameters; "
        "compare with least squares on the same terms, Fixed(terms=model)"
    )
