"""Whether an explanation takes away most of a mismatch, and whether its effects do it."""

from __future__ import annotations

import numpy as np

from deatwin.ident.mismatch.naming.candidate import Candidate

__all__ = ["MOST", "acts", "gained", "takes_most"]

MOST = 0.5
"""Share of the mismatch's energy that an explanation takes away: a base plant that is nearly adequate becomes so with
any effect."""
ACTING = 0.5
"""Share of the fall of the rms residual, that the effects of an explanation must do by themselves at least; where the
fit without them has found its minimum it is all, by the triangle inequality."""


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
    """Whether a candidate takes away most of what is more than noise.

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
    """Whether it is the effects of a candidate that make its fit better.

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
