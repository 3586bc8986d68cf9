"""Squared distance of two explanations on given inputs, and the probability of a wrong decision between them.

One explanation is taken as the truth and the other is refitted to its readings. The remaining difference is evaluated by
`deatwin.ident.mismatch.advise.difference`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.minimum import minimise
from deatwin.ident.greybox.parts import Part, level_of, simulated
from deatwin.ident.greybox.problem import Problem, Response
from deatwin.ident.mismatch.advise.difference import Difference
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant

DISTINGUISHED = 16.0
"""Smallest d² of distinguished explanations: the wrong one is chosen in 2.3 % of all recordings."""
STEPS = 4
"""Largest number of refit steps with simulations."""
SETTLED = 0.02
"""Share of the squared difference that a step must gain to be followed by another one."""
DAMPING = 1e-2
"""Damping of a first-order step, relative to each parameter's own effect on the readings; an undamped step goes too far
in directions that hardly change them."""


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
    return float(ndtr(-np.sqrt(squared) / 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    """Information from earlier recordings, to first order, that limits a refit of the alternative.

    Parameters
    ----------
    known : Difference
        Difference of truth and alternative on those recordings, with the fitted parameters.
    jacobian : ndarray, shape (n, n_p)
        Derivative of the alternative's readings by its fitted coordinates, SI.
    """

    known: Difference
    jacobian: np.ndarray

    @classmethod
    def of(cls, truth: Calibration, alternative: Calibration, parts: Sequence[Part]) -> Memory:
        """Compute the information from fits of both explanations to the same recordings, without simulations.

        Parameters
        ----------
        truth, alternative : Calibration
            On the same parts.
        parts : sequence of Part
            To which they were fitted.

        Returns
        -------
        Memory
        """
        readings = np.concatenate([part.measured for part in parts]) - truth.residuals * level_of(parts)
        left = alternative.residuals - truth.residuals
        known = Difference.between(truth.plant, alternative.plant, readings, left, parts)
        return cls(known=known, jacobian=alternative.jacobian)

    @property
    def refitted(self) -> Difference:
        """Return the difference after the alternative's refit to these recordings alone."""
        return replace(self.known, left=self.known.left - self.jacobian @ _step(self.jacobian, self.known.left))

    def beside(self, other: Memory) -> Memory:
        """Combine this information with that of other recordings.

        Parameters
        ----------
        other : Memory
            Of the same two explanations.

        Returns
        -------
        Memory
        """
        return Memory(known=self.known.beside(other.known), jacobian=np.vstack([self.jacobian, other.jacobian]))


def separation(one: Calibration, other: Calibration, parts: Sequence[Part], noise: float, steps: int = STEPS) -> float:
    """Return d² between two fitted explanations, the smaller one of both directions.

    Parameters
    ----------
    one, other : Calibration
        The explanations.
    parts : sequence of Part
        Inputs, and the samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.
    steps : int
        Largest number of steps with simulations; with 0 the distance is that to first order.

    Returns
    -------
    float
        If one explanation contains the other and can imitate it exactly, d² of the other direction.

    Raises
    ------
    SimulationError
        If the inputs are such that the plant of an explanation fails.
    """
    pairs = directions(one, other)
    return min(distance_squared(truth.plant, alternative, parts, noise, steps=steps) for truth, alternative in pairs)


def distance_squared(
    truth: Plant,
    alternative: Calibration,
    parts: Sequence[Part],
    noise: float,
    *,
    memory: Memory | None = None,
    steps: int = STEPS,
) -> float:
    """Return d² from a plant to an explanation that is refitted to it.

    Parameters
    ----------
    truth : Plant
        Plant with the true values.
    alternative : Calibration
        The explanation, and the start of its refit.
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
        Infinite if the alternative cannot be simulated.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    found = difference(truth, alternative, parts, memory=memory, steps=steps)
    return float(np.inf) if found is None else found.squared_distance(noise)


def difference(
    truth: Plant,
    alternative: Calibration,
    parts: Sequence[Part],
    *,
    memory: Memory | None = None,
    steps: int = STEPS,
    response: Response | None = None,
) -> Difference | None:
    """Return the part of a plant's readings that an alternative cannot imitate after a refit of all its parameters.

    To first order the refit is a projection off the alternative's Jacobian. That is inaccurate for large differences, so
    some steps with simulations come first.

    Parameters
    ----------
    truth : Plant
        With the values to be imitated.
    alternative : Calibration
        The explanation, and where its refit starts.
    parts : sequence of Part
        Inputs, and the samples that count; readings are not used.
    memory : Memory, optional
        Earlier recordings, which the refit must keep explaining; they are put behind `parts` in the result.
    steps : int
        With simulations, at most; with none the projection alone is the result.
    response : tuple of ndarray, optional
        What `Problem.evaluate` gives of the alternative on these parts where its refit starts, if that is known.

    Returns
    -------
    Difference or None
        None where the alternative cannot be simulated.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    readings = simulated(truth, parts)
    if readings is None:
        raise SimulationError("the plant to be imitated cannot be simulated on these inputs")
    start = Difference.between(truth, alternative.plant, readings, readings, parts)
    whole = start if memory is None else start.beside(memory.known)
    measured = np.concatenate([part.measured for part in parts])
    imitation = _Imitation(
        plant=alternative.plant,
        parts=tuple(parts),
        names=alternative.names,
        beyond=(readings - measured) / level_of(parts),
        memory=memory,
        response=response,
    )
    left = imitation.left(steps)
    return None if left is None else replace(whole, left=left)


def directions(one: Calibration, other: Calibration) -> list[tuple[Calibration, Calibration]]:
    """Return truth and alternative in each order that is informative.

    Parameters
    ----------
    one, other : Calibration
        Two explanations.

    Returns
    -------
    list of tuple
        Only one order if in the other one the alternative contains the truth.
    """
    return [(t, r) for t, r in ((one, other), (other, one)) if not _contains(r.plant, t.plant)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Imitation(Problem):
    """Least-squares fit of an alternative to readings without noise and, to first order, to earlier recordings.

    `beyond` is the truth's readings minus those of the recordings.
    """

    beyond: np.ndarray
    memory: Memory | None

    def evaluate(self, coordinates: np.ndarray) -> Response | None:
        found = super().evaluate(coordinates)
        if found is None:
            return None
        left, jacobian = found[0] + self.beyond, found[1]
        if self.memory is None:
            return left, jacobian
        old = self.memory.known.left - self.memory.jacobian @ (coordinates - self.start())
        return np.concatenate([left, old]), np.vstack([jacobian, self.memory.jacobian])

    def left(self, steps: int) -> np.ndarray | None:
        """Refit the alternative in steps with simulations, and a last first-order step if that leaves less."""
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
    """Take a damped Gauss-Newton step."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    scaled = jacobian / scale
    return np.linalg.solve(scaled.T @ scaled + DAMPING**2 * np.eye(scale.size), scaled.T @ left) / scale


def _contains(alternative: Plant, truth: Plant) -> bool:
    """Return whether a plant is another plant plus further effects, on the same rig."""
    return set(alternative.effect_names) > set(truth.effect_names) and _form(alternative) == _form(truth)


def _form(plant: Plant) -> dict[str, object]:
    """Return the description of a rig without its errors."""
    return {k: v for k, v in plant.rig.to_dict().items() if k not in ("noise", "model_error")}
