"""Tests whether an explanation and its effects remove most of a mismatch in a plausible plant."""

from __future__ import annotations

import numpy as np

from deatwin.ident.greybox.tangent import bounded_fit
from deatwin.ident.mismatch.excess import Excess
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.thresholds import MOST, NEARLY_ALL
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.parameters import Parameter

TRIFLE = 0.05
"""Share of the mismatch's power below which a further effect may only correct the model error."""

SUFFICIENT = ((0.8, 0.95), (1.5, 3.0))
"""Shares of the mismatch's power that an explanation removes, and how many times the model error it may then leave,
because neither the model error nor the law of a mechanism is known exactly. The limit is interpolated linearly between
the two shares."""


def gained(candidate: Candidate, less: Candidate) -> float:
    """Return the fall of the mean square residual from `less`, which lacks some effects, to `candidate`."""
    return float(less.losses.mean() - candidate.losses.mean())


def takes_most(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a candidate removes most of the residual's power beyond noise."""
    # Any effect makes a nearly adequate base plant adequate.
    return gained(candidate, base) > MOST * float(base.losses.mean() - base.noise**2)


def acts(candidate: Candidate, base: Candidate) -> bool:
    """Return whether the effects of a candidate, not its refitted parameters, make the fit better."""
    # If the fit without an effect has not reached its minimum, a fit with the effect may be better although the effect
    # does little. Its contribution is then smaller than the fall of the residual, which the triangle inequality
    # forbids at a minimum.
    # An interval of the strength is no substitute, because a strength may be correlated with a time constant of the
    # effect.
    fell = base.fitted_test.rms - candidate.fitted_test.rms
    return root_mean_square(candidate.contribution) > MOST * fell


def held_back_by(candidate: Candidate) -> tuple[str, ...]:
    """Return plant parameters at a bound that, to first order, costs an explanation more than the practical size."""
    # Further missing physics drives parameters of the plant to physically implausible values. A bound does not count if
    # the fit would hardly improve beyond it.
    fit, added = candidate.calibration, tuple(f"{name}." for name in candidate.effects)
    ended = {name for name in fit.at_bound if not name.startswith(added)}
    if not ended:
        return ()
    ways = [inwards(fit.plant.parameters[name]) if name in ended else 0.0 for name in fit.names]
    lower = np.array([0.0 if way > 0.0 else -np.inf for way in ways])
    upper = np.array([0.0 if way < 0.0 else np.inf for way in ways])
    cost, held = bounded_fit(fit.residuals, fit.jacobian, lower, upper)
    pressing = tuple(name for name, stays in zip(fit.names, held, strict=True) if stays)
    return pressing if cost > candidate.fitted_test.practical**2 else ()


def inwards(parameter: Parameter) -> float:
    """Return the sign of the change of the coordinate that moves a parameter from its bound into its range."""
    rising = float(np.sign(parameter.scale.slope(parameter.value)))
    return rising if parameter.is_low else -rising


def share_explained(after: Excess, before: Excess) -> float:
    """Return the share of a mismatch's power, beyond noise and model error, that was removed.

    It is negative if the residual grew, 0 if there was nothing to explain, 1 if only noise and model error are left.
    """
    error = after.model_error**2
    if before.size**2 <= error:
        return 0.0
    return 1.0 - max(after.size**2 - error, 0.0) / (before.size**2 - error)


def errs_by_its_law(candidate: Candidate, base: Candidate) -> bool:
    """Return whether the fitted residual of a candidate may come from errors in its effects' laws."""
    # Held-out data are not considered: a slow effect with a slightly wrong law errs more if it is extrapolated.
    return share_explained(candidate.fitted_test, base.fitted_test) >= NEARLY_ALL


def asks(after: Excess, before: Excess) -> bool:
    """Return whether a part of the recordings shows a mismatch, with or without the explanation."""
    return before.mismatch or after.mismatch


def explained(candidate: Candidate, base: Candidate) -> float:
    """Return the smaller of the shares that a candidate explains of the fitted and of the held-out data."""
    # A part without a certain mismatch has nothing to explain, and is left out.
    parts = [(candidate.fitted_test, base.fitted_test), (candidate.unseen_test, base.unseen_test)]
    asked = [(after, before) for after, before in parts if asks(after, before)] or parts
    return min(share_explained(after, before) for after, before in asked)


def suffices(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a candidate is adequate within the uncertainty of the model error."""
    if candidate.adequate:
        return True
    error = candidate.fitted_test.model_error
    left, share = max(candidate.fitted_test.size, candidate.unseen_test.size), explained(candidate, base)
    shares, limits = SUFFICIENT
    return share > shares[0] and bool(left < np.interp(share, shares, limits) * error)


def is_near_model_error(left: Excess) -> bool:
    """Return whether a residual is within the uncertainty of the model error."""
    return left.within_error or left.size < SUFFICIENT[1][0] * left.model_error
