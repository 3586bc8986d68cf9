r"""Difference between two explanations: the part of the first that the second cannot imitate, and how visible it is.

An alternative that is fitted to the readings of the truth leaves :math:`\delta`, and to recordings with a Gaussian error
e of covariance :math:`\Sigma` it leaves :math:`\|\delta\|^2 + 2\,\delta^T e` more than the truth. It is chosen if that
is negative, with the probability

.. math:: P = \Phi(-d/2), \qquad d^2 = \frac{(\delta^T\delta)^2}{\delta^T\Sigma\,\delta}

The model error of rms m is not white; treated as white, it would let thousands of samples distinguish explanations by a
far smaller difference. Half of its variance is assumed *static*, a smooth function of the reading that repeats do not
average out. The other half is *slow*, with the correlation time of the blocks in which losses are counted:

.. math:: \Sigma_{ij} = \sigma^2\delta_{ij} + \frac{m^2}{2}\sum_b h_b(y_i)\,h_b(y_j)
          + \frac{m^2}{2}\,e^{-|i-j|/n_b}

with functions :math:`h_b` whose squares are hat functions over eight levels of the reading, which add up to one. The
halves are a choice: the difference between a reduced and a fine film has a static share of 0 to 60 %, depending on the
input, and correlation times of 0.5 to 5 s. A fast difference averages out the model error and competes with the noise
only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.parts import Part, level_of
from deatwin.ident.mismatch.thresholds import BLOCK_SAMPLES
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.model import Plant

LEVELS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Difference:
    """Part of the true explanation's readings that an alternative cannot imitate."""

    readings: np.ndarray  # (n,), of the true explanation, experiment after experiment, SI
    left: np.ndarray  # (n,), truth minus alternative after the alternative's refit, over the noise's level, SI
    model_error: np.ndarray  # (n,), rms of the plant's own error, over the noise's level, SI
    sizes: tuple[int, ...]  # numbers of samples of the experiments
    # Name of the reading in each experiment, whose errors are independent; the same in all if empty
    names: tuple[str, ...] = ()

    @classmethod
    def between(
        cls, truth: Plant, alternative: Plant, readings: np.ndarray, left: np.ndarray, parts: Sequence[Part]
    ) -> Difference:
        """Return the difference of two explanations with the larger of the two rigs' model errors.

        Shapes: `readings` of the truth and difference `left` (n,), SI.
        """
        # An experiment is one piece, however it is cut into records: an error does not end where a sample is missing.
        names, sizes = zip(*((part.reading, part.size) for part in parts if part.size), strict=True)
        each = zip(names, np.split(readings, np.cumsum(sizes)[:-1]), strict=True)
        # Further readings, in units of their own noise, say nothing about the motion.
        own = [values for name, values in each if name == names[0]]
        motion = np.sqrt(sum(values.var() * values.size for values in own) / sum(values.size for values in own))
        error = max(plant.rig.for_motion(float(motion)).model_error for plant in (truth, alternative))
        return cls(readings=readings, left=left, model_error=error / level_of(parts), sizes=sizes, names=names)

    @property
    def rms(self) -> float:
        """Root mean square of the difference, SI."""
        return root_mean_square(self.left)

    def squared_distance(self, noise: float) -> float:
        """Return d² of the difference for this `noise`, SI; infinite if there is no error at all."""
        squares = float(self.left @ self.left)
        weighted = self.left * self.model_error
        slow = sum(_slow(piece) for piece in np.split(weighted, np.cumsum(self.sizes)[:-1]))
        reading = np.repeat(self._names, self.sizes)
        same = [reading == name for name in dict.fromkeys(self._names)]
        static = sum(_static(self.readings[own], weighted[own]) for own in same)
        spread = noise**2 * squares + (static + slow) / 2
        if squares == 0.0:
            return 0.0
        return squares**2 / spread if spread > 0 else float(np.inf)

    def beside(self, other: Difference) -> Difference:
        """Join this difference and that of the same two explanations on other records."""
        arrays = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in ("readings", "left", "model_error")
        }
        return Difference(**arrays, sizes=self.sizes + other.sizes, names=self._names + other._names)

    @property
    def _names(self) -> tuple[str, ...]:
        return self.names or ("",) * len(self.sizes)


def _static(readings: np.ndarray, weighted: np.ndarray) -> float:
    """Return the quadratic form of an error that is a smooth function of the reading."""
    low, high = float(readings.min()), float(readings.max())
    place = (readings - low) / (high - low) * (LEVELS - 1) if high > low else np.zeros(readings.size)
    below = np.minimum(place.astype(int), LEVELS - 2)
    share = place - below
    sums = np.bincount(below, np.sqrt(1 - share) * weighted, LEVELS)
    sums += np.bincount(below + 1, np.sqrt(share) * weighted, LEVELS)
    return float(sums @ sums)


def _slow(weighted: np.ndarray) -> float:
    """Return the quadratic form of an error whose correlation decays over a block."""
    from scipy.signal import lfilter

    summed = lfilter([1.0], [1.0, -np.exp(-1 / BLOCK_SAMPLES)], weighted)
    return float(2 * (weighted @ summed) - weighted @ weighted)
