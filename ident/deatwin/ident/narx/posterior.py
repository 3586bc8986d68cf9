"""The posterior law of a NARX model's parameters: intervals, densities, draws, and their export to ArviZ."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.covariance import covariance_root
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes


Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThetaDraws:
    """Joint draws of parameters and noise."""

    theta: Array  # shape (n_draws, n_terms): Parameters in SI units
    noise_variance: Array  # shape (n_draws, n_outputs): Variances of e(k), squares of the outputs' units


@dataclass(frozen=True, kw_only=True, eq=False)
class ThetaPosterior:
    """Posterior of a model's parameters: Student-t, or normal if the model's degrees of freedom are infinite.

    It is the marginal distribution of ``theta | tau ~ N(mean, V/tau)``, ``tau ~ Gam(a, b)``, with 2a degrees of
    freedom. A model stores ``V b/(a - 1)`` as covariance and ``b/(a - 1)`` as noise variance. Each equation has its own
    tau.

    Parameters
    ----------
    model : NarxModel
        Model with the parameters, their covariance and degrees of freedom.
    """

    model: NarxModel

    @property
    def scale(self) -> Array:
        """Scale of each parameter's distribution, shape (n_terms,); the standard deviation if it is normal."""
        dof = self.model.theta_dof
        shrink = 1.0 if math.isinf(dof) else (dof - 2) / dof
        return np.asarray(np.sqrt(shrink * np.diag(self.model.theta_cov)))

    def interval(self, level: float = 0.95) -> Array:
        """Return the central interval of each parameter.

        Parameters
        ----------
        level : float
            Probability of the interval, between 0 and 1.

        Returns
        -------
        ndarray, shape (n_terms, 2)
            Lower and upper ends, in the parameters' units.

        Raises
        ------
        ModelError
            If the level lies outside 0 to 1.
        """
        half = quantile(level, self.model.theta_dof) * self.scale
        return np.column_stack([self.model.theta - half, self.model.theta + half])

    def density(self, term: int, values: Array) -> Array:
        """Return the marginal density of one parameter.

        Parameters
        ----------
        term : int
            Position of the term in the model.
        values : ndarray
            Values of the parameter, in its unit.

        Returns
        -------
        ndarray
            Density at each value, in the inverse of the parameter's unit.
        """
        from scipy import stats

        law = stats.norm if math.isinf(self.model.theta_dof) else stats.t(self.model.theta_dof)
        scale = self.scale[term]
        return np.asarray(law.pdf((values - self.model.theta[term]) / scale) / scale)

    def sample(self, rng: np.random.Generator, n_draws: int) -> ThetaDraws:
        """Draw parameters and noise variances jointly from the posterior.

        Parameters
        ----------
        rng : numpy.random.Generator
            Generator of the draws.
        n_draws : int
            Number of draws.

        Returns
        -------
        ThetaDraws
        """
        model = self.model
        # (1/tau) / E[1/tau]: inverse gamma of mean 1
        if math.isinf(model.theta_dof):
            ratio = np.ones((n_draws, model.n_outputs))
        else:
            a = model.theta_dof / 2
            ratio = (a - 1) / rng.gamma(a, size=(n_draws, model.n_outputs))
        normal = rng.standard_normal((n_draws, model.theta.size)) @ covariance_root(model.theta_cov).T
        return ThetaDraws(
            theta=model.theta + normal * np.sqrt(ratio[:, list(model.equations)]),
            noise_variance=ratio * np.atleast_1d(model.noise_variance),
        )

    def plot(
        self, axes: Sequence[Axes] | None = None, *, truth: Array | None = None, level: float = 0.95
    ) -> list[Axes]:
        """Draw the marginal density of each parameter.

        Parameters
        ----------
        axes : sequence of matplotlib Axes, optional
            Axes to draw on, one for each term; created if omitted.
        truth : ndarray, shape (n_terms,), optional
            True values of the parameters, in their units, drawn if given.
        level : float
            Probability of the interval that is marked, between 0 and 1.

        Returns
        -------
        list of matplotlib Axes
        """
        from deatwin.ident.narx.svb_plots import draw_densities

        return draw_densities(self, axes, truth, level)

    def to_arviz(self, rng: np.random.Generator, **options: Any) -> Any:
        """Return draws of the posterior in ArviZ's format; see `deatwin.ident.narx.arviz_export.to_arviz`.

        Parameters
        ----------
        rng : numpy.random.Generator
            Generator of the draws.
        **options
            Options ``recording``, ``n_chains`` and ``n_draws`` of that function.

        Returns
        -------
        arviz.InferenceData, or xarray.DataTree from ArviZ 1 on
        """
        from deatwin.ident.narx.arviz_export import to_arviz

        return to_arviz(self.model, rng, **options)


def quantile(level: float, dof: float) -> float:
    """Return the half width, in scales, of the central interval of a Student-t or normal law."""
    from scipy import special

    if not 0 < level < 1:
        raise ModelError(f"level = {level}; it must lie between 0 and 1")
    share = (1 + level) / 2
    return float(special.ndtri(share) if math.isinf(dof) else special.stdtrit(dof, share))
