r"""Comparison of two explanations by the evidence of the recordings.

Where explanation k is right, alternative l leaves :math:`\delta = r_l - r_k` more than noise and the plant's own error, whose
covariance :math:`\Sigma` is that of `deatwin.ident.mismatch.advise.difference`. The sums of squared residuals then
differ by :math:`S = \|r_l\|^2 - \|r_k\|^2`, which is normal about :math:`\|\delta\|^2` with the variance
:math:`4\,\delta^T\Sigma\,\delta`; where l is right, about :math:`-\|\delta\|^2`. Neither law need be exact: what the
right one errs by may be as :math:`\delta` in a share :math:`\rho` of its size, which adds
:math:`(2\rho\,\|\delta\|^2)^2` to that variance. The logarithm of the ratio of both densities is

.. math:: \Lambda = \frac{x}{2\,(1/d^2 + \rho^2)}, \qquad x = S / \|\delta\|^2, \qquad
          d^2 = \frac{\|\delta\|^4}{\delta^T\Sigma\,\delta}

with x between -1 and 1: where it is more, both are wrong, and the lesser error is not the more likely for that.

Evidence by blocks takes every residual for one that stays the same for a block, as the plant's own error does, and so
hardly sees what two explanations differ in within one: a delay or a lag. It knows better where they are far apart. Of
both the larger counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.mismatch.advise.difference import Difference
from deatwin.ident.mismatch.naming.candidate import Candidate

LAW = 1 / 3
"""Share of what tells two explanations apart, in which the law of the right one may be wrong."""


def advantage(one: Candidate, other: Candidate) -> float:
    """Logarithm of the evidence for one explanation over another one.

    Parameters
    ----------
    one, other : Candidate
        Both fitted to the same recordings.

    Returns
    -------
    float
        In nats, of both parts of the recordings; minus the same with the two exchanged. A parameter costs as much as
        in `deatwin.ident.mismatch.losses.evidence`.
    """
    more = len(other.calibration.names) - len(one.calibration.names)
    cost = more / 2 * float(np.log(one.losses.size)) + one.log_prior - other.log_prior
    by_blocks, by_shape = one.evidence - other.evidence - cost, _by_shape(one, other)
    return max(by_blocks, by_shape, key=abs) + cost


def likeliest(candidates: Sequence[Candidate]) -> Candidate:
    """The explanation that the recordings speak for most.

    Parameters
    ----------
    candidates : sequence of Candidate
        At least one, all fitted to the same recordings.

    Returns
    -------
    Candidate
        The one with the most evidence by itself, unless another one beats it, or one that beats that. Three that beat
        each other in turn end the search.
    """
    best = max(candidates, key=lambda c: c.evidence)
    for _ in candidates:
        over = {id(c): advantage(c, best) for c in candidates if c is not best}
        first = max(candidates, key=lambda c: over.get(id(c), 0.0))
        if first is best:
            break
        best = first
    return best


def _by_shape(one: Candidate, other: Candidate) -> float:
    mine, theirs = one.residuals, other.residuals
    apart = theirs - mine
    whole = float(apart @ apart)
    if whole == 0.0:
        return 0.0
    error = max(c.calibration.plant.rig.model_error for c in (one, other))
    readings = one.measured if one.measured.size else np.zeros(apart.size)
    errors = error / one.level if one.level.size else np.full(apart.size, error)
    difference = Difference(readings=readings, left=apart, model_error=errors, sizes=one.pieces)
    squared = difference.squared_distance(min(one.noise, other.noise))
    share = float(np.clip((theirs @ theirs - mine @ mine) / whole, -1.0, 1.0))
    return share / (2 * (1 / squared + LAW**2))
