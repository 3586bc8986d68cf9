r"""Comparison of two explanations by the evidence in the recordings.

Suppose that explanation k is right. The alternative l then leaves :math:`\delta = r_l - r_k` in addition to noise and
model error, whose covariance :math:`\Sigma` is given by `deatwin.ident.mismatch.advise.difference`. The difference of
the sums of squares, :math:`S = \|r_l\|^2 - \|r_k\|^2`, is normal with mean :math:`\|\delta\|^2` and variance
:math:`4\,\delta^T\Sigma\,\delta`. If l is right, the mean is :math:`-\|\delta\|^2`. The law of the right explanation
may have an error along :math:`\delta`, of a share :math:`\rho` of its size; this adds
:math:`(2\rho\,\|\delta\|^2)^2` to the variance. The logarithm of the ratio of both densities is

.. math:: \Lambda = \frac{x}{2\,(1/d^2 + \rho^2)}, \qquad x = S / \|\delta\|^2, \qquad
          d^2 = \frac{\|\delta\|^4}{\delta^T\Sigma\,\delta}

with x limited to the range from -1 to 1: beyond it both explanations are wrong, and the one with the smaller error is
not likelier for that.

The evidence by blocks assumes that residuals are constant within a block, as the model error is. So it hardly sees
differences that are faster than a block, such as a delay or a lag, but it is more accurate for large differences. The
larger of both is used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.mismatch.advise.difference import Difference
from deatwin.ident.mismatch.naming.candidate import Candidate

LAW = 1 / 3
"""Error of the right explanation's law, as a share of the difference between two explanations."""


def advantage(one: Candidate, other: Candidate) -> float:
    """Return the log evidence ratio of two explanations, nats, for fitted and held-out data together; antisymmetric."""
    # The cost of a parameter is that of `deatwin.ident.mismatch.losses.evidence`.
    more = len(other.calibration.names) - len(one.calibration.names)
    cost = more / 2 * float(np.log(one.losses.size)) + one.log_prior - other.log_prior
    by_blocks, by_shape = one.evidence - other.evidence - cost, advantage_of_shape(one, other)
    return max(by_blocks, by_shape, key=abs) + cost


def likeliest(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate with the most evidence by itself, or one that beats it, or one that beats that one."""
    # Three may beat each other in turn, so the search ends after as many steps as there are candidates.
    best = max(candidates, key=lambda c: c.evidence)
    for _ in candidates:
        over = {id(c): advantage(c, best) for c in candidates if c is not best}
        first = max(candidates, key=lambda c: over.get(id(c), 0.0))
        if first is best:
            break
        best = first
    return best


def advantage_of_shape(one: Candidate, other: Candidate) -> float:
    """Return the log ratio of both likelihoods, nats, where the law of the right one may be inexact; antisymmetric."""
    mine, theirs = one.residuals, other.residuals
    apart = theirs - mine
    whole = float(apart @ apart)
    if whole == 0.0:
        return 0.0
    error = max(c.calibration.plant.rig.model_error for c in (one, other))
    readings = one.measured if one.measured.size else np.zeros(apart.size)
    errors = error / one.level if one.level.size else np.full(apart.size, error)
    difference = Difference(
        readings=readings, left=apart, model_error=errors, sizes=one.pieces, names=one.readings_of_pieces
    )
    squared = difference.squared_distance(min(one.noise, other.noise))
    share = float(np.clip((theirs @ theirs - mine @ mine) / whole, -1.0, 1.0))
    return share / (2 * (1 / squared + LAW**2))
