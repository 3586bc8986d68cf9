"""How much worse than least squares on its own terms a fitted model predicts one step ahead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import TermTable
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]

_WORTH_SAYING = 0.01
"""Excess from which a note is due: a prior that is right costs a share of about n_terms / n_samples or less, and an
error that is larger by 1 % changes no decision."""
_RESOLVED = float(np.sqrt(np.finfo(float).eps))
"""Errors below this share of the output are zero to what works with squares of the signals."""


def excess_errors(model: NarxModel, recordings: Sequence[Recording]) -> Array:
    """Return the relative excess of the one-step error over that of least squares on the same terms, shape
    (n_outputs,).
    """
    predicted = [model.predict(record) for record in recordings]
    own = np.sqrt(np.mean(np.concatenate([response.residuals for response in predicted], axis=1) ** 2, axis=1))
    excess = np.zeros(model.n_outputs)
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
        if error > _RESOLVED * data.output_scale:
            excess[row] = error / max(least, _RESOLVED * data.output_scale) - 1.0
    return excess


def excess_notes(model: NarxModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return a sentence for each output whose one-step error exceeds that of least squares by more than 1 %."""
    return tuple(
        f"one step ahead {name}'s error on the training data is {100 * share:.3g} % above that of least squares on the "
        "same terms: the estimator holds the parameters back; compare with Fixed(terms=model), which is least squares"
        for name, share in zip(model.output_names, excess_errors(model, recordings).tolist(), strict=True)
        if share > _WORTH_SAYING
    )
