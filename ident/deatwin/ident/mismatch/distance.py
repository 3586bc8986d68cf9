r"""How far apart two explanations are on given inputs, and how often a decision between them will be wrong.

The truth is a plant with readings :math:`y_k`; a rival is fitted to them as well as its parameters can, and leaves

.. math:: \delta = y_k - y_l(\hat\theta_l), \qquad \hat\theta_l = \arg\min\nolimits_{\theta_l} \|y_k - y_l(\theta_l)\|^2

Recordings add an error e to the readings. What the engine compares are squared residuals, of which the rival leaves
:math:`\|\delta\|^2 + 2\,\delta^T e` more than the truth does (up to what parameters take up of e in the one model and
not in the other, which is of the size of :math:`\sigma^2`). The rival wins where that is negative: for Gaussian e of
covariance :math:`\Sigma` with the probability

.. math:: P = \Phi(-d/2), \qquad d^2 = \frac{(\delta^T\delta)^2}{\delta^T\Sigma\,\delta}

For white noise this is the usual :math:`\|\delta\|^2/\sigma^2`, which grows with every sample. The plant's own error
of rms m is not white, and counting it as such would tell explanations apart by thousands of samples of a difference
far below it. A half of its variance is taken to be *static*, a smooth function of the reading that is the same
whenever the film comes back to it: repeats do not average it out. The other half is *slow*, with the correlation time
of the blocks in which the engine counts its losses:

.. math:: \Sigma_{ij} = \sigma^2\delta_{ij} + \frac{m^2}{2}\sum_b h_b(y_i)\,h_b(y_j)
          + \frac{m^2}{2}\,e^{-|i-j|/n_b}

with functions :math:`h_b` whose squares are hats over eight levels of the reading, and add up to one. The halves are a
choice: what a reduced film leaves of its fine twin has a static share between nothing and 60 %, depending on the
input, and correlation times of 0.5 to 5 s. A difference that is fast averages the model error out by itself, and
counts against the noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.stats import norm

from deatwin.ident.greybox.fit import Calibration, Part, Problem, simulated
from deatwin.ident.greybox.minimum import minimise
from deatwin.ident.mismatch.losses import BLOCK_SAMPLES
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant

__all__ = [
    "TOLD_APART",
    "Difference",
    "Memory",
    "confusion",
    "difference",
    "directions",
    "distance_squared",
    "separation",
]

TOLD_APART = 16.0
"""d² from which on two explanations can be told apart: the wrong one wins in 2.3 % of all recordings."""
LEVELS = 8
STEPS = 4
"""Steps of the rival towards the truth with simulations."""
SETTLED = 0.02
"""Share of the squared difference that a step must gain for another one: d² is not wanted to the percent."""
DAMPING = 1e-2
"""Of a step to first order, as a share of what each parameter alone does to the readings: undamped it goes far along
what hardly changes them, where no simulation follows."""


def confusion(squared: float) -> float:
    r"""Probability that the wrong one of two explanations fits a recording better, :math:`\Phi(-d/2)`.

    Parameters
    ----------
    squared : float
        d².

    Returns
    -------
    float
        From 0.5 for explanations that predict the same down to 0.

    Examples
    --------
    >>> round(confusion(16.0), 3)
    0.023
    """
    return float(norm.cdf(-np.sqrt(squared) / 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Difference:
    """What a rival cannot imitate of the truth's readings.

    Parameters
    ----------
    readings : ndarray, shape (n,)
        Of the truth, record after record, SI.
    left : ndarray, shape (n,)
        Truth minus rival after the rival's refit, SI.
    model_error : ndarray, shape (n,)
        Rms of the plant's own error at each sample, SI.
    sizes : tuple of int
        Samples of each record.
    """

    readings: np.ndarray
    left: np.ndarray
    model_error: np.ndarray
    sizes: tuple[int, ...]

    @property
    def rms(self) -> float:
        """Root mean square of the difference, SI."""
        return float(np.sqrt(np.mean(self.left**2)))

    def squared_distance(self, noise: float) -> float:
        """d² of the difference under noise and model error.

        Parameters
        ----------
        noise : float
            Standard deviation of the sensor's noise, SI.

        Returns
        -------
        float
            Infinite where there is a difference but no error to hide it.
        """
        squares = float(self.left @ self.left)
        weighted = self.left * self.model_error
        slow = sum(_slow(piece) for piece in np.split(weighted, np.cumsum(self.sizes)[:-1]))
        spread = noise**2 * squares + (_static(self.readings, weighted) + slow) / 2
        if squares == 0.0:
            return 0.0
        return squares**2 / spread if spread > 0 else float(np.inf)

    def beside(self, other: Difference) -> Difference:
        """This difference and that on other records.

        Parameters
        ----------
        other : Difference
            Of the same two explanations.

        Returns
        -------
        Difference
        """
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)])
                  for name in ("readings", "left", "model_error")}  # fmt: skip
        return Difference(**arrays, sizes=self.sizes + other.sizes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    """What earlier recordings hold against a refit of the rival, to first order about its fitted parameters.

    Parameters
    ----------
    known : Difference
        Of truth and rival on those recordings, with the rival's fitted parameters.
    jacobian : ndarray, shape (n, n_p)
        Derivative of the rival's readings by its fitted coordinates, SI.
    """

    known: Difference
    jacobian: np.ndarray

    @classmethod
    def of(cls, truth: Calibration, rival: Calibration, parts: Sequence[Part]) -> Memory:
        """What the recordings say to which both were fitted; no simulation is needed.

        Parameters
        ----------
        truth, rival : Calibration
            On the same parts.
        parts : sequence of Part
            To which they were fitted.

        Returns
        -------
        Memory
        """
        measured = np.concatenate([part.measured for part in parts])
        known = Difference(
            readings=measured - truth.residuals, left=rival.residuals - truth.residuals,
            model_error=np.full(measured.size, _model_error(truth.plant, rival.plant)), sizes=_sizes(parts),
        )  # fmt: skip
        return cls(known=known, jacobian=rival.jacobian)

    @property
    def refitted(self) -> Difference:
        """The difference after the rival's refit to these recordings alone."""
        return _with_left(self.known, self.known.left - self.jacobian @ _step(self.jacobian, self.known.left))


def separation(
    one: Calibration, other: Calibration, parts: Sequence[Part], noise: float, *, steps: int = STEPS
) -> float:
    """d² between two fitted explanations, the smaller one of both directions.

    Parameters
    ----------
    one, other : Calibration
        The explanations.
    parts : sequence of Part
        Inputs, and the samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.
    steps : int
        With simulations, at most; with none the distance is that to first order.

    Returns
    -------
    float
        Where one explanation contains the other, which it can always imitate, d² of the way back.

    Raises
    ------
    SimulationError
        If the inputs are such that the plant of an explanation fails.
    """
    pairs = directions(one, other)
    return min(distance_squared(truth.plant, rival, parts, noise, steps=steps) for truth, rival in pairs)


def distance_squared(
    truth: Plant,
    rival: Calibration,
    parts: Sequence[Part],
    noise: float,
    *,
    memory: Memory | None = None,
    steps: int = STEPS,
) -> float:
    """d² from a plant to an explanation that is refitted to it.

    Parameters
    ----------
    truth : Plant
        With the values to be imitated.
    rival : Calibration
        The explanation, and where its refit starts.
    parts : sequence of Part
        Inputs, and the samples that count; readings are not used.
    noise : float
        Standard deviation of the sensor's noise, SI.
    memory : Memory, optional
        Earlier recordings, which the refit must keep explaining and which count, too.
    steps : int
        With simulations, at most; with none the distance is that to first order.

    Returns
    -------
    float
        Infinite where the rival cannot be simulated.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    found = difference(truth, rival, parts, memory=memory, steps=steps)
    return float(np.inf) if found is None else found.squared_distance(noise)


def difference(
    truth: Plant,
    rival: Calibration,
    parts: Sequence[Part],
    *,
    memory: Memory | None = None,
    steps: int = STEPS,
) -> Difference | None:
    """What a rival cannot imitate of a plant's readings, after a refit of all its parameters.

    To first order the refit is a projection off the rival's Jacobian. That errs where the two are far apart, so some
    steps with simulations come before it.

    Parameters
    ----------
    truth : Plant
        With the values to be imitated.
    rival : Calibration
        The explanation, and where its refit starts.
    parts : sequence of Part
        Inputs, and the samples that count; readings are not used.
    memory : Memory, optional
        Earlier recordings, which the refit must keep explaining; they are put behind `parts` in the result.
    steps : int
        With simulations, at most; with none the projection alone is the result.

    Returns
    -------
    Difference or None
        None where the rival cannot be simulated.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    readings = simulated(truth, parts)
    if readings is None:
        raise SimulationError("the plant that is to be imitated cannot be simulated on these inputs")
    records = np.split(readings, np.cumsum(_sizes(parts))[:-1])
    error = _model_error(truth, rival.plant, float(np.sqrt(np.mean([r.var() for r in records]))))
    start = Difference(
        readings=readings, left=readings, model_error=np.full(readings.size, error), sizes=_sizes(parts)
    )
    whole = start if memory is None else start.beside(memory.known)
    measured = np.concatenate([part.measured for part in parts])
    imitation = _Imitation(
        plant=rival.plant, parts=tuple(parts), names=rival.names, beyond=readings - measured, memory=memory
    )
    left = imitation.left(steps)
    return None if left is None else _with_left(whole, left)


def directions(one: Calibration, other: Calibration) -> list[tuple[Calibration, Calibration]]:
    """Truth and rival, in the orders that can tell something.

    Parameters
    ----------
    one, other : Calibration
        Two explanations.

    Returns
    -------
    list of tuple
        One pair where the other order has a rival that contains the truth, else both.
    """
    return [(t, r) for t, r in ((one, other), (other, one)) if not _contains(r.plant, t.plant)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Imitation(Problem):
    """Least squares of a rival's parameters on readings without noise and, to first order, on earlier recordings.

    `beyond` is the truth's readings less those of the recordings, which `Problem` compares with.
    """

    beyond: np.ndarray
    memory: Memory | None

    def evaluate(self, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        found = super().evaluate(coordinates)
        if found is None:
            return None
        left, jacobian = found[0] + self.beyond, found[1]
        if self.memory is None:
            return left, jacobian
        old = self.memory.known.left - self.memory.jacobian @ (coordinates - self.start())
        return np.concatenate([left, old]), np.vstack([jacobian, self.memory.jacobian])

    def left(self, steps: int) -> np.ndarray | None:
        """What the rival leaves after some steps with simulations, and a last one to first order if that is less."""
        found = minimise(self, evaluations=1 + steps, tolerance=SETTLED)
        if found is None:
            return None
        lower, upper = self.bounds()
        step = _step(found.jacobian, found.residuals)
        projected = found.residuals - found.jacobian @ (
            np.clip(found.coordinates + step, lower, upper) - found.coordinates
        )
        return min(found.residuals, projected, key=lambda left: float(left @ left))


def _step(jacobian: np.ndarray, left: np.ndarray) -> np.ndarray:
    """A damped Gauss-Newton step."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    scaled = jacobian / scale
    return np.linalg.solve(scaled.T @ scaled + DAMPING**2 * np.eye(scale.size), scaled.T @ left) / scale


def _static(readings: np.ndarray, weighted: np.ndarray) -> float:
    """The square form of an error that is a smooth function of the reading."""
    low, high = float(readings.min()), float(readings.max())
    place = (readings - low) / (high - low) * (LEVELS - 1) if high > low else np.zeros(readings.size)
    below = np.minimum(place.astype(int), LEVELS - 2)
    share = place - below
    sums = np.bincount(below, np.sqrt(1 - share) * weighted, LEVELS)
    sums += np.bincount(below + 1, np.sqrt(share) * weighted, LEVELS)
    return float(sums @ sums)


def _slow(weighted: np.ndarray) -> float:
    """The square form of an error whose correlation decays over a block."""
    summed = lfilter([1.0], [1.0, -np.exp(-1 / BLOCK_SAMPLES)], weighted)
    return float(2 * (weighted @ summed) - weighted @ weighted)


def _sizes(parts: Sequence[Part]) -> tuple[int, ...]:
    return tuple(int(mask.sum()) for part in parts for mask in part.masks if mask.any())


def _model_error(truth: Plant, rival: Plant, motion: float = 0.0) -> float:
    """Of the worse plant, for readings of a given standard deviation."""
    return max(plant.rig.for_motion(motion).model_error for plant in (truth, rival))


def _with_left(of: Difference, left: np.ndarray) -> Difference:
    return Difference(readings=of.readings, left=left, model_error=of.model_error, sizes=of.sizes)


def _contains(rival: Plant, truth: Plant) -> bool:
    """Whether a plant is another one with further effects, on the same rig."""
    return set(rival.effect_names) > set(truth.effect_names) and _form(rival) == _form(truth)


def _form(plant: Plant) -> dict[str, object]:
    """What the rig is, apart from its errors."""
    return {k: v for k, v in plant.rig.to_dict().items() if k not in ("noise", "model_error")}
