"""Intervals of fitted parameters that allow for the plant's own error, and the effects whose strength may be zero."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.covariance import with_errors
from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.likelihood.several import own_errors
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.problem import DiagnosisProblem


def with_own_errors(fit: Calibration, problem: DiagnosisProblem, noise: float) -> Calibration:
    """Return a fit with a covariance that also includes the plant's model error; `noise` in SI."""
    # Repeatable model errors bias a fit in the same way in every recording, so residuals do not show them. Their sizes
    # are those that the likelihood expects.
    whole = problem.everything
    parts = whole if fit.residuals.size == sum(part.size for part in whole) else problem.fitted
    rig, readings = problem.nominal.rig, readings_of_fit(parts, fit.residuals)
    own = own_errors(rig, parts, readings, noise, problem.expected_error)
    columns = own.columns_after(fit.residuals, fit.jacobian)
    return replace(fit, covariance=with_errors(fit.covariance, fit.jacobian, columns))


def perhaps_absent(fit: Calibration, effects: Collection[str]) -> tuple[str, ...]:
    """Return those of some effects whose strength may be zero, by its 95 % interval at the values of their other
    parameters.
    """
    # An effect without strength has no time constant, say, so the question is asked at the fitted one: a drift may become
    # large and slow together, but not small. A film's relaxing modulus is known only as a share of its other modulus,
    # because the permittivity scales both. No interval tells of such a strength whether it is zero; the ablation does.
    added = [effect for effect in fit.plant.effects if effect.name in effects]
    strengths = {effect.name: f"{effect.name}.{effect.strength}" for effect in added}
    fitted = set(fit.names) - fit.undetermined  # a user's effect may have a known strength
    known = {name: _at_its_shape(fit, name, strength) for name, strength in strengths.items() if strength in fitted}
    return tuple(name for name, (low, high) in known.items() if low <= 0.0 <= high)


def _at_its_shape(fit: Calibration, effect: str, strength: str) -> tuple[float, float]:
    """Return the 95 % interval of a strength, given the effect's other parameters."""
    k = fit.names.index(strength)
    known = set(fit.names) - fit.undetermined - {strength}
    others = [i for i, name in enumerate(fit.names) if name in known and name.startswith(f"{effect}.")]
    spread = fit.covariance.copy()
    spread[k, k] -= spread[k, others] @ np.linalg.pinv(spread[np.ix_(others, others)]) @ spread[others, k]
    return replace(fit, covariance=spread).interval(strength)
