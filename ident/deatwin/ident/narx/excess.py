"""Compare the one-step error of a fitted model with that of least squares on the same terms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import TermTable
from deatwin.plant.recording import Recording

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
        terms = [
            term
            for term, equation in zip(model.terms, model.equations, strict=True)
            if equation == row and all(variable.kind != "e" for variable, _ in term.factors)
        ]
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
