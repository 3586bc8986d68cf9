"""Intervals of fitted parameters that allow for the plant's own error, and the effects whose strength may be zero."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

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
    """Return those of some effects whose 95 % interval of the strength includes zero."""
    # A film's relaxing modulus, for example, is known only as a share of its other modulus, because the permittivity
    # scales both. No interval tells of such a strength whether it is zero; the ablation does.
    added = [effect for effect in fit.plant.effects if effect.name in effects]
    strengths = {effect.name: f"{effect.name}.{effect.strength}" for effect in added}
    fitted = set(fit.names) - fit.undetermined  # a user's effect may have a known strength
    known = {name: fit.interval(strength) for name, strength in strengths.items() if strength in fitted}
    return tuple(name for name, (low, high) in known.items() if low <= 0.0 <= high)
