"""Find what biases a fit of `deatwin identify`: noise on the readings, and isolated wrong readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from deatwin.ident.narx import NarxModel
    from deatwin.plant.recording import Recording

_SECTIONS = 10  # Parts of the held-out data whose squared errors are compared
_LEVEL = 0.05  # Probability that a free-run fit without any gain appears better
_WORTH_SAYING = 0.01
"""Least gain that is reported, in the output's standard deviations, and least share of the output's squares in a single
reading: as for an excess of the one-step error, 1 % changes no decision."""


def outlying(training: Sequence[Recording]) -> list[str]:
    """Return a sentence for each output with isolated outliers that affect a fit by least squares."""
    from deatwin.ident.narx.preprocess.findings import FEWEST, FindingKind, inspect_recordings

    said = []
    for record in training:
        if record.n_samples < FEWEST:
            continue
        squares = record.outputs[0].var() * record.n_samples
        for found in inspect_recordings(record):
            if found.kind is FindingKind.OUTLIERS and found.size**2 > _WORTH_SAYING * squares:
                said.append(f"{found}: {found.kind.value}; these samples bias the fit")
    return said


def biased_by_noise(model: NarxModel, training: Sequence[Recording], unseen: Sequence[Recording]) -> list[str]:
    """Return a sentence if the free-run fit of the same terms is significantly better on held-out data."""
    from deatwin.ident.narx import refine
    from deatwin.ident.narx.semp_search import worse
    from deatwin.plant.errors import ModelError
    from deatwin.plant.prefixes import with_unit

    try:
        refined = refine(model, training, tolerance=1e-4)
    except ModelError:  # no terms, or a free run that diverges
        return []
    runs = [(model.simulate(part), refined.simulate(part)) for part in unseen]
    if not all(own.status.ok and other.status.ok for own, other in runs):
        return []
    own, other = (np.concatenate([pair[i].residuals[0] for pair in runs]) for i in (0, 1))
    parts = [np.array([part @ part for part in np.array_split(errors, _SECTIONS)]) for errors in (own, other)]
    before, after = (float(np.sqrt(np.mean(errors**2))) for errors in (own, other))
    size = float(np.concatenate([part.outputs[0] for part in unseen]).std())
    if before - after < _WORTH_SAYING * size or not worse(parts[0], parts[1], _LEVEL):
        return []
    own_error, other_error = (with_unit(error, model.output_units[0]) for error in (before, after))
    return [
        f"the fit is biased by noise on the readings or by missing dynamics; use --method semp (a fit of the same terms to the "
        f"free run has an error of only {other_error} rms on held-out data, and this model {own_error} rms)"
    ]
