"""Sample the uncertainty of frequency responses from the posterior of the model's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability, read_only, whole_number
from deatwin.ident.frequency.response import Band
from deatwin.ident.frequency.uncertainty.regions import (
    Quantity,
    Uncertain,
    draw_theta,
    evaluate,
    plot_draws,
    response_of,
)
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array, Complex, require_generator
from deatwin.plant.datasets import Metadata, attribute, variable
from deatwin.plant.drawing import Axes
from deatwin.plant.errors import ModelError

_MOST_BYTES = 1 << 31  # of complex draws


class SampleStatus(Enum):
    """Status of a sampled frequency response: whether draws had to be left out.

    The value of each member is a message for the user.
    """

    OK = "all draws have the operating point, with the model's stability"
    LOST = (
        "some draws are left out, because they have no equilibrium or their stability differs from that of the model: the result is valid only if the true "
        "operating point is like that of the model; identify on more data or leave out terms"
    )

    @property
    def ok(self) -> bool:
        """True if no draw was left out."""
        return self is SampleStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled(Uncertain):
    """Frequency response at random draws from the posterior of the model's parameters, as `sample` returns it.

    Parameters
    ----------
    response : FrequencyResponse
        Frequency response at the estimated parameters, with n points.
    level : float
        Default coverage probability of the confidence regions and bands.
    dof : float
        Degrees of freedom of the Student-t posterior of the parameters; infinite if the posterior is normal.
    draws : ndarray of complex, shape (n_kept, n)
        Response at each draw that was kept, in the response's unit.
    n_without : int
        Number of draws left out because the model has no equilibrium at these parameters.
    n_other : int
        Number of draws left out because the equilibrium is stable for the draw and unstable for the estimated
        parameters, or conversely.
    """

    draws: Complex = field(metadata=variable("draw", "point", unit=attrgetter("unit")))
    n_without: int = field(metadata=attribute())
    n_other: int = field(metadata=attribute())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "status": attribute(name="draws", of=attrgetter("status.name")),
    }

    @property
    def source(self) -> str:
        """Text for legends that states the number of draws."""
        return f"of {len(self.draws)} draws"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the response in the complex plane, on `ax` or new axes, with the draws and their ellipses."""
        axes = super().plot(ax)
        plot_draws(self, self.draws, axes)
        return axes

    @property
    def status(self) -> SampleStatus:
        """Status that says whether draws were left out."""
        return SampleStatus.LOST if self.n_without or self.n_other else SampleStatus.OK

    @property
    def linear_law(self) -> NDArray[np.bool_]:
        """True where an ellipse describes the uncertainty: here at all n points, because no linearisation is used."""
        return np.ones(self.values.shape, dtype=np.bool_)

    @property
    def mean(self) -> Complex:
        """Mean of the draws, complex, shape (n,), in ``unit``."""
        return np.asarray(self.draws.mean(axis=0))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n, 2, 2), in the square of ``unit``."""
        away = self.draws - self.mean
        pairs = ((away.real, away.real), (away.real, away.imag), (away.imag, away.imag))
        rr, ri, ii = (np.einsum("kn,kn->n", a, b) for a, b in pairs)
        return read_only(np.stack([rr, ri, ri, ii], axis=-1).reshape(-1, 2, 2) / (len(away) - 1))

    def gain_band(self, level: float | None = None) -> Band:
        """Return the pointwise band of the gain, in ``unit``, of probability `level`, by default ``self.level``.

        Its ends are central quantiles of the draws' gains. Where the true gain is near zero, the band may lie above the
        true gain, because the scatter of real and imaginary part increases the gains of the draws.
        `Propagated.gain_band` avoids this.
        """
        return self._band(np.abs(self.draws), level)

    def phase_band(self, level: float | None = None) -> Band:
        """Return the pointwise band of the phase, degrees, of probability `level`, by default ``self.level``.

        Its ends are the phase of ``response`` plus central quantiles of the draws' deviations from that phase.
        """
        turned = np.angle(self.draws * np.conj(np.where(self.values == 0, 1.0, self.values)))
        return self._band(self.phase_deg + np.degrees(turned), level)

    def _band(self, values: Array, level: float | None) -> Band:
        level = self.level if level is None else probability(level)
        # The true value is like one more draw: it lies below the k-th of n with probability k / (n + 1), as in this
        # definition of the quantiles only.
        low, high = np.quantile(values, [(1 - level) / 2, (1 + level) / 2], axis=0, method="weibull")
        nowhere = np.zeros(low.shape, dtype=np.bool_)
        return Band(level=level, low=read_only(low), high=read_only(high), linear_law=nowhere)


def sample(
    model: NarxModel, quantity: Quantity, rng: np.random.Generator, n_draws: int = 2000, *, level: float = 0.95
) -> Sampled:
    """Compute a frequency response at random draws from the posterior of a model's parameters.

    Two kinds of draws are left out and counted: those for which the model has no equilibrium, and those for which the
    stability of the equilibrium differs from that at the estimated parameters.

    Parameters
    ----------
    model : NarxModel
        Model with the covariance ``theta_cov`` of its parameters. Their posterior is Student-t if ``theta_dof`` is
        finite, and normal otherwise.
    quantity : callable
        Function that takes a model and returns a FrequencyResponse, for example
        ``partial(gfrf, order=1, omega=omega)``.
    rng : numpy.random.Generator
        Random generator for the draws.
    n_draws : int
        Number of draws, at least 2.
    level : float
        Default coverage probability of the confidence regions and bands.

    Raises
    ------
    ModelError
        If `level`, `rng` or `n_draws` is not as described, the draws need more than 2 GiB, the covariance of the
        parameters is invalid, `quantity` does not return a FrequencyResponse, or fewer than two draws are kept.
    """
    response = response_of(model, quantity, level)
    n_draws = whole_number(n_draws, "n_draws", 2)
    require_generator(rng)
    size = 16 * n_draws * response.values.size
    if size > _MOST_BYTES:
        raise ModelError(
            f"{size / 2**30:.3g} GiB, more than {_MOST_BYTES >> 30} GiB, are needed for these draws; take fewer, or fewer "
            "frequencies (at_points)"
        )
    found = evaluate(model, quantity, response, draw_theta(model, rng, n_draws))
    kept = found.exists & (found.stable == response.status.ok)
    if kept.sum() < 2:
        raise ModelError(
            f"of {n_draws} draws {int(kept.sum())} have the model's operating point; its parameters are too uncertain"
        )
    draws = found.values if kept.all() else found.values[kept]
    return Sampled(
        response=response,
        level=level,
        dof=model.theta_dof,
        draws=draws,
        n_without=int(np.sum(~found.exists)),
        n_other=int(np.sum(found.exists & ~kept)),
    )
