"""Tests whether an explanation and its effects remove most of a mismatch in a plausible plant."""

from __future__ import annotations

import numpy as np

from deatwin.ident.greybox.tangent import bounded_fit
from deatwin.ident.mismatch.excess import Excess
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.plant.parameters import Parameter

MOST = 0.5
"""Share of the mismatch's energy that an explanation takes away: a base plant that is nearly adequate becomes so with
any effect."""
TRIFLE = 0.05
"""Share of the mismatch's energy below which a further effect mends what another one does to the plant's own error."""
NEARLY_ALL = 0.9
"""Share of the explainable power that effects take away whose law alone may be to blame for the rest: the law of a
mechanism is right to about 30 % of what it contributes at worst, which is 9 % of its power. What takes less imitates, or
is not alone."""
ACTING = 0.5
"""Share of the fall of the rms residual, that the effects of an explanation must do by themselves at least; where the
fit without them has found its minimum it is all, by the triangle inequality."""

SUFFICIENT = ((0.8, 0.95), (1.5, 3.0))
"""A model error is not known to the digit, and the law of a mechanism not to the last term: an explanation that takes
away so large a share of the mismatch's energy suffices if it leaves no more than so many times that error; between the
two shares the limit rises evenly."""


def gained(candidate: Candidate, less: Candidate) -> float:
    """Mean square by which a candidate leaves less than one with fewer effects.

    Parameters
    ----------
    candidate, less : Candidate
        With and without some effects.

    Returns
    -------
    float
        Square of the residual's unit; what returns where those effects are taken out.
    """
    return float(less.losses.mean() - candidate.losses.mean())


def takes_most(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a candidate takes away most of what is more than noise.

    Parameters
    ----------
    candidate, base : Candidate
        With and without effects.

    Returns
    -------
    bool
    """
    return gained(candidate, base) > MOST * float(base.losses.mean() - base.noise**2)


def acts(candidate: Candidate, base: Candidate) -> bool:
    """Return whether it is the effects of a candidate that make its fit better.

    A fit with an effect may be better than one without for no merit of the effect: the fit without it had not found
    its minimum. Then the effect does less by itself than the residual fell; from a minimum it cannot. An interval of
    its strength would not tell, since a strength may be tied to a time of the effect.

    Parameters
    ----------
    candidate, base : Candidate
        With and without effects.

    Returns
    -------
    bool
    """
    fell = base.fitted_test.rms - candidate.fitted_test.rms
    return float(np.sqrt(np.mean(candidate.contribution**2))) > ACTING * fell


def held_back_by(candidate: Candidate) -> tuple[str, ...]:
    """Parameters of the plant whose ranges cost an explanation more than the practical size.

    What else is missing bends the plant until its parameters end where no film is. A bound that nothing presses on, as
    of a parameter that the readings hardly depend on, is none.

    Parameters
    ----------
    candidate : Candidate
        Of any effects.

    Returns
    -------
    tuple of str
        Those that the fit would take out of their ranges, if it left so much less then, to first order; else none.
    """
    fit, added = candidate.calibration, tuple(f"{name}." for name in candidate.effects)
    ended = {name for name in fit.at_bound if not name.startswith(added)}
    if not ended:
        return ()
    inwards = [_inwards(fit.plant.parameters[name]) if name in ended else 0.0 for name in fit.names]
    lower = np.array([0.0 if way > 0.0 else -np.inf for way in inwards])
    upper = np.array([0.0 if way < 0.0 else np.inf for way in inwards])
    cost, held = bounded_fit(fit.residuals, fit.jacobian, lower, upper)
    pressing = tuple(name for name, stays in zip(fit.names, held, strict=True) if stays)
    return pressing if cost > candidate.fitted_test.practical**2 else ()


def _inwards(parameter: Parameter) -> float:
    """The sign of a change of its coordinate that takes a parameter, which lies at a bound, into its range."""
    rising = float(np.sign(parameter.scale.slope(parameter.value)))
    return rising if parameter.is_low else -rising


def share_explained(after: Excess, before: Excess) -> float:
    """Share of the explainable energy of a mismatch that was taken away.

    No effect can explain the sensor's noise or the plant's own error.

    Parameters
    ----------
    after, before : Excess
        What is left with and without effects; the model error is that of the first.

    Returns
    -------
    float
        1 where no more than noise and model error is left; negative where it is worse than before; 0 where there was
        nothing to explain.
    """
    error = after.model_error**2
    if before.size**2 <= error:
        return 0.0
    return 1.0 - max(after.size**2 - error, 0.0) / (before.size**2 - error)


def errs_by_its_law(candidate: Candidate, base: Candidate) -> bool:
    """Return whether what a candidate leaves of the fitted part may be no more than the error of its effects' laws.

    The held-out part says nothing of that: a slow effect whose law is not quite right errs more where it is extrapolated.

    Parameters
    ----------
    candidate, base : Candidate
        With and without effects.

    Returns
    -------
    bool
    """
    return share_explained(candidate.fitted_test, base.fitted_test) >= NEARLY_ALL


def asks(after: Excess, before: Excess) -> bool:
    """Whether a part of the recordings has anything to explain: something is missing there, with an explanation or not.

    Parameters
    ----------
    after, before : Excess
        Of the part, with the explanation and without.

    Returns
    -------
    bool
    """
    return before.mismatch or after.mismatch


def explained(candidate: Candidate, base: Candidate) -> float:
    """Share of the explainable energy of the mismatch that a candidate takes away, on the part where it takes less.

    A part on which neither leaves a certain mismatch has nothing to explain, and is passed over.

    Parameters
    ----------
    candidate, base : Candidate
        With and without effects.

    Returns
    -------
    float
        As `share_explained`.
    """
    parts = [(candidate.fitted_test, base.fitted_test), (candidate.unseen_test, base.unseen_test)]
    asked = [(after, before) for after, before in parts if asks(after, before)] or parts
    return min(share_explained(after, before) for after, before in asked)


def suffices(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a candidate explains the recordings as far as anybody knows the plant's own error.

    Parameters
    ----------
    candidate, base : Candidate
        With and without effects.

    Returns
    -------
    bool
    """
    if candidate.adequate:
        return True
    error = candidate.fitted_test.model_error
    left, share = max(candidate.fitted_test.size, candidate.unseen_test.size), explained(candidate, base)
    shares, limits = SUFFICIENT
    return share > shares[0] and bool(left < np.interp(share, shares, limits) * error)


def is_near_model_error(left: Excess) -> bool:
    """Return whether a residual is what a model error may leave that is not known to the digit.

    Parameters
    ----------
    left : Excess
        Of a fit.

    Returns
    -------
    bool
    """
    return left.within_error or left.size < SUFFICIENT[1][0] * left.model_error
