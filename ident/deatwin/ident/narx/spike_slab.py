"""Other judges of known structures than the lower bound of `SvbNarx`; first a spike-and-slab sampler.

In the regression y = Phi theta + e, e ~ N(0, 1/tau), tau ~ Gam(a0, b0) as in the variational posterior, every number of
terms is alike before the data [1]_, and theta_j ~ N(0, n / (i tau phi_j'phi_j)) if in, the information of i samples. One
is usual [2]_, but widens all intervals [3]_; i is a hundredth. Parameters and noise are integrated out; the set of terms
is sampled by heat-bath flips, and draws in which nothing happens are counted by their expected number [4]_.

.. [1] Scott, Berger, Ann. Statist. 38 (2010) 2587-2619, doi:10.1214/10-AOS792.
.. [2] Kass, Wasserman, J. Am. Stat. Assoc. 90 (1995) 928-934, doi:10.1080/01621459.1995.10476592.
.. [3] Liang et al., J. Am. Stat. Assoc. 103 (2008) 410-423, doi:10.1198/016214507000001337.
.. [4] Bortz, Kalos, Lebowitz, J. Comput. Phys. 17 (1975) 10-18, doi:10.1016/0021-9991(75)90060-1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import lgamma

import numpy as np
from scipy.special import expit

from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.prediction_error import prediction_error_fit
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.svb import SvbNarx, model_of
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.arrays import Array, Indices
from deatwin.plant.recording import Recording
from deatwin.plant.records import UNBOUNDED

Terms = frozenset[int]


@dataclass(frozen=True, kw_only=True, eq=False)
class SpikeSlab:
    """The posterior over sets of terms, up to a constant."""

    data: Statistics
    priors: Priors = field(default_factory=Priors)
    information: float = 0.01  # Information in the slab, in samples

    @property
    def n_terms(self) -> int:
        """Number of candidates."""
        return int(self.data.moment.size)

    @property
    def slab(self) -> Array:
        """Precision of each parameter that is in, relative to the noise's; shape (n_terms,)."""
        return np.asarray(self.information / self.data.n_samples * np.diag(self.data.gram), dtype=np.float64)

    def precision(self, chosen: list[int]) -> Array:
        """Return Phi'Phi plus the slab's precision for the chosen terms, relative to the noise's."""
        return np.asarray(self.data.gram[np.ix_(chosen, chosen)] + np.diag(self.slab[chosen]), dtype=np.float64)

    def flip_gains(self, terms: Terms) -> Array:
        """Return the change of ln p(y, terms) by the flip of each term, shape (n_terms,)."""
        chosen = sorted(terms)
        inverse = np.linalg.inv(self.precision(chosen))
        theta = inverse @ self.data.moment[chosen]
        left = self.data.power - float(theta @ self.data.moment[chosen])
        across = self.data.gram[:, chosen]
        slab = self.slab
        unexplained = np.diag(self.data.gram) + slab - np.einsum("ij,jk,ik->i", across, inverse, across)
        volume = 0.5 * np.log(slab / unexplained)
        change = -((self.data.moment - across @ theta) ** 2) / unexplained
        volume[chosen] = -0.5 * np.log(slab[chosen] * np.diag(inverse))
        change[chosen] = theta**2 / np.diag(inverse)
        prior = np.full(self.n_terms, self._prior(len(chosen) + 1) if len(chosen) < self.n_terms else 0.0)
        prior[chosen] = self._prior(len(chosen) - 1) if chosen else 0.0
        return np.asarray(
            volume + self._fit(left + change) - self._fit(left) + prior - self._prior(len(chosen)), dtype=np.float64
        )

    def draw(self, terms: Terms, count: int, rng: np.random.Generator) -> tuple[list[int], Array]:
        """Draw parameters of one structure. Shapes: returns (count, n_chosen)."""
        chosen = sorted(terms)
        precision, moment = self.precision(chosen), self.data.moment[chosen]
        mean = np.linalg.solve(precision, moment)
        shape = self.priors.a0 + self.data.n_samples / 2
        rate = self.priors.b0 + 0.5 * (self.data.power - float(mean @ moment))
        noise = rate / rng.gamma(shape, size=(count, 1))
        root = np.linalg.inv(np.linalg.cholesky(precision))
        return chosen, mean + np.sqrt(noise) * (rng.standard_normal((count, len(chosen))) @ root)

    def _fit(self, left: Array | float) -> Array:
        shape = self.priors.a0 + self.data.n_samples / 2
        return np.asarray(-shape * np.log(self.priors.b0 + 0.5 * np.asarray(left)), dtype=np.float64)

    def _prior(self, m: int) -> float:
        return lgamma(m + 1) + lgamma(self.n_terms - m + 1) - lgamma(self.n_terms + 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Structures:
    """Sampled structures."""

    inclusion: Array
    weights: Mapping[Terms, float]  # Share of the chain's samples at each set of terms

    @property
    def median(self) -> Terms:
        """Return the terms with a probability above one half."""
        return frozenset(np.flatnonzero(self.inclusion > 0.5).tolist())

    def parameters(self, posterior: SpikeSlab, count: int, rng: np.random.Generator) -> Array:
        """Draw parameters over all structures. Shapes: returns (count, n_terms)."""
        sets = list(self.weights)
        counts = rng.multinomial(count, list(self.weights.values()))
        theta = np.zeros((count, posterior.n_terms))
        start = 0
        for terms, times in zip(sets, counts, strict=True):
            if times and terms:
                chosen, drawn = posterior.draw(terms, int(times), rng)
                theta[start : start + times, chosen] = drawn
            start += times
        return theta


def sample_structures(
    posterior: SpikeSlab, rng: np.random.Generator, *, flips: int, burn_in: int, start: Terms = frozenset()
) -> Structures:
    """Sample sets of terms."""
    terms = start
    weights: dict[Terms, float] = {}
    inclusion, total = np.zeros(posterior.n_terms), 0.0
    seen: dict[Terms, Array] = {}
    for step in range(burn_in + flips):
        if terms not in seen:
            seen[terms] = expit(posterior.flip_gains(terms))
        rates = seen[terms]
        if step >= burn_in:
            rest = 1.0 / float(rates.sum())
            inside = rates.copy()
            inside[list(terms)] = 1.0 - rates[list(terms)]
            inclusion += rest * inside
            weights[terms] = weights.get(terms, 0.0) + rest
            total += rest
        flip = int(rng.choice(posterior.n_terms, p=rates / rates.sum()))
        terms = terms ^ {flip}
    return Structures(inclusion=inclusion / total, weights={terms: weight / total for terms, weight in weights.items()})


@dataclass(frozen=True, kw_only=True)
class Margin:
    """Range of thresholds, from `false` to `true`, that select exactly the true terms."""

    true: float = field(metadata=UNBOUNDED)
    false: float = field(metadata=UNBOUNDED)


def full_margin(rows: Array, target: Array, true: Indices) -> Margin:
    """Compare abs(t) of true and false terms in least squares on all candidates; `rows` (n_terms, n_samples)."""
    from scipy.linalg import solve_triangular

    q, r = np.linalg.qr((rows / np.linalg.norm(rows, axis=1)[:, None]).T)
    theta = solve_triangular(r, q.T @ target)
    spread = np.linalg.norm(solve_triangular(r, np.eye(theta.size)), axis=1)
    left = target - q @ (q.T @ target)
    sizes = np.abs(theta) / (spread * np.sqrt(left @ left / (target.size - theta.size)))
    return Margin(true=float(sizes[true].min()), false=float(np.delete(sizes, true).max()))


def near_margin(rows: Array, target: Array, true: Indices) -> Margin:
    """Compare the true terms with all sets that differ from them by one term, or by one exchange."""
    left, gains = _gains(rows, target, true)
    freedom = target.size - true.size
    most = float(np.delete(gains, true).max())
    false = np.sqrt(most / ((left - most) / (freedom - 1)))
    costs = []
    for term in true:
        others = true[true != term]
        worse, instead = _gains(rows, target, others)
        costs.append(worse - left)
        if worse - float(np.delete(instead, true).max()) < left:
            false = np.inf
    return Margin(true=float(np.sqrt(min(costs) / (left / freedom))), false=float(false))


def _gains(rows: Array, target: Array, chosen: Indices) -> tuple[float, Array]:
    """Return the residual sum of squares of chosen terms, and how much each further term would remove."""
    q = np.linalg.qr(rows[chosen].T)[0]
    left = target - q @ (q.T @ target)
    beyond = rows - (rows @ q) @ q.T
    squares = np.einsum("ij,ij->i", beyond, beyond)
    new = squares > 1e-12 * np.einsum("ij,ij->i", rows, rows)  # the chosen terms have no part beyond themselves
    gains = np.where(new, (beyond @ left) ** 2 / np.where(new, squares, 1.0), 0.0)
    return float(left @ left), np.asarray(gains, dtype=np.float64)


def fit_variational(terms: tuple[Term, ...], recording: Recording) -> NarxModel:
    """Fit known terms by variational Bayes, as `SvbNarx` does each of its steps."""
    usual = SvbNarx()
    data = Regression.on(recording, TermTable(terms))
    given = data.statistics()
    priors = Priors(a0=usual.a0, b0=usual.b0, c0=usual.c0, d0=usual.d0)
    found = fit_relevance(
        given.divided(given.root_mean_squares, given.output_size),
        priors,
        np.full(given.moment.size, priors.c0 / priors.d0),
        tolerance=usual.tolerance,
        max_iterations=usual.max_iterations,
    )
    return model_of(found.posterior, data, given, usual)


def fit_with_noise(terms: tuple[Term, ...], noise_terms: tuple[Term, ...], recording: Recording) -> NarxModel:
    """Fit known process and noise terms by the smallest prediction error."""
    process = Regression.on(recording, TermTable(terms))
    found = prediction_error_fit(process, noise_terms).estimate
    whole = replace(process, table=TermTable(terms + noise_terms))
    return whole.model(found.theta, found.theta_cov, found.noise_variance, identifier=Fixed(terms=terms))
