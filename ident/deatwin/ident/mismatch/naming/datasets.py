"""Explanations and rig variants, with their residuals, as xarray datasets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from deatwin.ident.mismatch.datasets import table
from deatwin.ident.mismatch.naming.rows import Explanations, Forms, Row, row_of, variant_rows
from deatwin.plant.datasets import Variables

NOISE = "standard deviation of the sensor's noise"


def base_tables(base: Forms) -> Variables:
    """Return the variants of the base plant with their residuals, the chosen one first; SI."""
    unit = base.chosen.calibration.plant.rig.output_unit
    return {**_rows("form", variant_rows(base), unit), "noise": ((), base.noise, unit, NOISE)}


def naming_tables(naming: Explanations) -> Variables:
    """Return all explanations that were tried, the base plant first, with their residuals, SI."""
    # Only explanations that competed with the best one have a probability; the distances d² are from the best one.
    told = [*naming.candidates, *([] if naming.best is None else [naming.best]), *naming.alternatives]
    candidates = list(dict.fromkeys(told))
    probability = [naming.probabilities.get(c.effects, np.nan) for c in candidates]
    distances = [{"from": one.effects[0], "to": one.effects[1], "d2": one.d2} for one in naming.distances]
    unit = naming.base.calibration.plant.rig.output_unit
    return {
        **_rows("candidate", [row_of(c, naming) for c in candidates], unit),
        "candidate_probability": ("candidate", probability, "", "among those of the size of the best one"),
        **table("distance", distances, {"d2": ("", "squared distance after a refit of the one to the other")}),
        "noise": ((), naming.noise, unit, NOISE),
    }


def _rows(dimension: str, rows: Sequence[Row], unit: str) -> Variables:
    """Return candidates as a table, with their residuals; all are judged on the same samples."""
    told = {
        "fitted": (unit, "rms residual on the fitted part"),
        "unseen": (unit, "rms residual on the held-out part"),
        "model_error": (unit, "rms of the plant's own error by which it is judged"),
        "evidence": ("nat",),
        "fitted_p_value": ("", "of no more than noise and model error on the fitted part"),
        "unseen_p_value": ("", "of no more than noise and model error on the held-out part"),
        "adequate": ("", "whether it explains the recordings"),
    }
    fitted = np.stack([row.candidate.calibration.residuals for row in rows])
    unseen = np.stack([row.candidate.unseen for row in rows])
    return {
        **table(dimension, map(_told, rows), told),
        "residual": ((dimension, "sample"), fitted, unit, "residual on the fitted part"),
        "unseen_residual": ((dimension, "unseen_sample"), unseen, unit, "residual on the held-out part"),
    }


def _told(row: Row) -> dict[str, Any]:
    one = row.candidate
    fitted, unseen = row.sizes
    return {
        "name": row.name,
        "role": row.role,
        "effects": "+".join(one.effects),
        "fitted": fitted,
        "unseen": unseen,
        "model_error": one.fitted_test.model_error,
        "fitted_p_value": one.fitted_test.p_value,
        "unseen_p_value": one.unseen_test.p_value,
        "evidence": one.evidence,
        "adequate": one.adequate,
    }
