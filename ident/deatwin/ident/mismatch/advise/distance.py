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

STEPS = 4
"""Largest number of refit steps with simulations."""
SETTLED = 0.02
"""Share of the squared difference that a step must gain for another one to follow."""
DAMPING = 1e-2
"""Damping of a first-order step, relative to each parameter's own effect on the readings; an undamped step goes too far
in directions that hardly change them."""


def confusion(squared: float) -> float:
    """Return the probability Φ(-d/2) that the wrong one of two explanations fits better, from d²: 0.5 if both agree."""
    return float(ndtr(-np.sqrt(squared) / 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    """Information of recordings against a refit of the alternative, to first order about its fitted parameters."""

    known: Difference  # difference between truth and alternative on those recordings, at the fitted parameters
    jacobian: np.ndarray  # (n, n_p), derivative of the alternative's readings by its fitted coordinates, SI

    @classmethod
    def of(cls, truth: Calibration, alternative: Calibration, parts: Sequence[Part]) -> Memory:
        """Compute the memory from the fits of both explanations to the same `parts`, without simulations."""
        readings = np.concatenate([part.measured for part in parts]) - truth.residuals * level_of(parts)
        left = alternative.residuals - truth.residuals
        known = Difference.between(truth.plant, alternative.plant, readings, left, parts)
        return cls(known=known, jacobian=alternative.jacobian)

    @property
    def refitted(self) -> Difference:
        """Return the difference after the alternative's refit to these recordings alone."""
        return replace(self.known, left=self.known.left - self.jacobian @ _step(self.jacobian, self.known.left))

    def beside(self, other: Memory) -> Memory:
        """Return this memory joined with that of other recordings of the same two explanations."""
        return Memory(known=self.known.beside(other.known), jacobian=np.vstack([self.jacobian, other.jacobian]))


def separation(one: Calibration, other: Calibration, parts: Sequence[Part], noise: float, steps: int = STEPS) -> float:
    """Return d² between two fitted explanations, the smaller of both directions; `noise` is in SI.

    If one explanation contains the other and can imitate it exactly, only the other direction counts. With 0 `steps`,
    d² is that to first order. Raise SimulationError if the plant of an explanation fails under the inputs.
    """
    pairs = directions(one, other)
    return min(distance_squared(truth.plant, alternative, parts, noise, steps=steps) for truth, alternative in pairs)


def distance_squared(
    truth: Plant,
    alternative: Calibration,
    parts: Sequence[Part],
    noise: float,
    memory: Memory | None = None,
    steps: int = STEPS,
    response: Response | None = None,
) -> float:
    """Return d² from a plant to an explanation that is refitted to it; infinite if that cannot be simulated.

    The refit must keep explaining the recordings in `memory`, and these count, too. With 0 `steps`, d² is that to first
    order; `noise` is in SI. The other arguments and the errors are those of `difference`.
    """
    found = difference(truth, alternative, parts, memory=memory, steps=steps, response=response)
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

    Readings of `parts` are not used; those of `memory` follow them in the result; `response` is `Problem.evaluate` at
    the refit's start, if known. None if the alternative cannot be simulated; raise SimulationError if the truth cannot.
    """
    # To first order the refit is a projection off the alternative's Jacobian. That is inaccurate for large differences,
    # so some steps with simulations come first.
    readings = simulated(truth, parts)
    if readings is None:
        raise SimulationError("the plant of one explanation cannot be simulated with these inputs")
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
    """Return truth and alternative in each order, but for one in which the alternative contains the truth."""
    return [(t, r) for t, r in ((one, other), (other, one)) if not _contains(r.plant, t.plant)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Imitation(Problem):
    """Least-squares fit of an alternative to readings without noise and, to first order, to earlier recordings."""

    beyond: np.ndarray  # (n,), the truth's readings minus those of the recordings, over the noise's level
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
