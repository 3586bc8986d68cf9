"""A frequency response with the uncertainty that is propagated to it, beside draws of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse
from deatwin.ident.frequency.uncertainty.parameters import Quantity
from deatwin.ident.frequency.uncertainty.propagate import Propagated, UncertaintyWarning, propagate
from deatwin.ident.frequency.uncertainty.sampling import Sampled, sample
from deatwin.ident.narx import NarxModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

DRAWS = 20_000
"""Draws of the parameters."""
SIMULTANEOUS = 0.99
"""Probability that all elements at all frequencies lie in the Monte Carlo band."""
STRICT = 0.1
"""Nonlinearity up to which the covariance is off by its square, 1 %, which so many draws do not tell from none."""
_FLAT = 1e-9  # of the larger variance
_DIGITS = "₀₁₂₃₄₅₆₇₈"


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """A response, propagated and drawn."""

    case: str
    propagated: Propagated
    sampled: Sampled
    curve: Complex  # shape (n_curve,): the response at more frequencies, to be drawn as a line

    @property
    def symbol(self) -> str:
        """Symbol and order of the response, as plain text."""
        return symbol_of(self.propagated.response)

    @property
    def relative(self) -> Array:
        """Largest standard deviation in any direction of the complex plane, over the gain, shape (n,)."""
        longest: Array = np.sqrt(np.linalg.eigvalsh(self.propagated.covariance)[:, -1])
        return longest / self.propagated.gain

    @property
    def whitened(self) -> Array:
        """Covariance of the draws in axes in which the propagated one is the unit matrix, shape (n, 2, 2)."""
        return whitened(self.propagated.covariance, self.sampled.covariance)

    @property
    def strict(self) -> NDArray[np.bool_]:
        """Where the law should hold as exactly as the draws can tell, shape (n,)."""
        return np.asarray(self.propagated.nonlinearity <= STRICT)

    @property
    def largest(self) -> float:
        """Largest departure of the draws' covariance from the propagated one, over its Monte Carlo error."""
        error = np.array([[2.0, 1.0], [1.0, 2.0]]) / len(self.sampled.draws)  # of a Wishart matrix about the unit
        departure = np.abs(self.whitened - np.eye(2)) / np.sqrt(error)
        return float(np.max(departure[self.strict], initial=0.0))

    @property
    def allowed(self) -> float:
        """Bound of `largest` with probability `SIMULTANEOUS`, were the propagated covariance exact."""
        return NormalDist().inv_cdf(1 - (1 - SIMULTANEOUS) / (2 * 3 * max(1, int(self.strict.sum()))))

    @property
    def ratio(self) -> float:
        """The draws' variance over the propagated one, at the frequency and in the direction furthest from one."""
        values = np.linalg.eigvalsh(self.whitened).ravel()
        return float(values[np.argmax(np.abs(np.log(values)))])

    @property
    def held(self) -> float:
        """Smallest or largest share of the draws that the 95 % region holds, whichever is further from 95 %."""
        shares = self.propagated.contains(self.sampled.draws).mean(axis=0)
        return float(shares[np.argmax(np.abs(shares - 0.95))])


def symbol_of(response: FrequencyResponse) -> str:
    """Symbol and order of a response, as plain text."""
    return f"{response.symbol}{_DIGITS[response.order]}"


def whitened(reference: Array, covariance: Array) -> Array:
    """Covariances in axes in which the reference is the unit matrix. Shapes: `reference, covariance` (n, 2, 2);
    returns (n, 2, 2).
    """
    sizes, axes = np.linalg.eigh(reference)
    flat = sizes <= _FLAT * sizes[:, 1:]
    root = np.where(flat, 0.0, 1 / np.sqrt(np.where(flat, 1.0, sizes)))
    turned = (axes * root[:, None, :]).swapaxes(1, 2)
    found: Array = turned @ covariance @ turned.swapaxes(1, 2) + flat[:, None, :] * np.eye(2)
    return found


def departure(reference: Array, covariance: Array) -> float:
    """Largest relative departure of covariances from others, over frequency and direction. Shapes: `reference,
    covariance` (n, 2, 2).
    """
    return float(np.abs(np.linalg.eigvalsh(whitened(reference, covariance)) - 1).max())


def spread_of(
    case: str, model: NarxModel, quantity: Quantity, rng: np.random.Generator, curve: Complex | None = None
) -> Spread:
    """Propagate and draw. Shapes: `curve` (n_curve,)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)  # the page says it, where it is looked for
        propagated = propagate(model, quantity)
    sampled = sample(model, quantity, rng, DRAWS)
    fine = np.empty(0, dtype=np.complex128) if curve is None else curve
    return Spread(case=case, propagated=propagated, sampled=sampled, curve=fine)
