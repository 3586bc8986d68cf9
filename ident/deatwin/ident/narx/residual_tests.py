"""Test the residual of a NARX model by five correlations, and for whiteness.

.. [1] Billings, Voon, Int. J. Control 44 (1986) 235-244, doi:10.1080/00207178608933593.
.. [2] Ljung, Box, Biometrika 65 (1978) 297-303, doi:10.1093/biomet/65.2.297.
.. [3] Haugh, J. Am. Stat. Assoc. 71 (1976) 378-385.
.. [4] Sidak, J. Am. Stat. Assoc. 62 (1967) 626-633, doi:10.1080/01621459.1967.10482935.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np

from deatwin.plant.arrays import Array, Integers
from deatwin.plant.copies import Frozen
from deatwin.plant.drawing import Axes, axes_or_new

Series = Sequence[Array]  # One stretch of a signal for each recording, shape (n_r,) each

TESTS: Mapping[str, str] = MappingProxyType(
    {
        "ee": r"\phi_{ee}(\tau)",
        "ue": r"\phi_{ue}(\tau)",
        "e(eu)": r"\phi_{e(eu)}(\tau)",
        "(u2)'e": r"\phi_{(u^2)'e}(\tau)",
        "(u2)'e2": r"\phi_{(u^2)'e^2}(\tau)",
        "ee'": r"\phi_{ee'}(\tau)",
    }
)
"""Names of the tests and their formulas; the last is between the residuals of two outputs."""

_ROUNDING = 1e-20  # relative power below which the centred square of an input is zero, as for two levels
_SYMMETRIC = 1e-2  # skewness below which no p-value changes
_LEAST_TAIL = 1e-300  # least probability of a tail, so that its normal quantile stays finite
_LEAST_SHOWN = 1e-4  # least p-value that a figure shows as a number
_QUANTILE = 1.959963984540054  # 97.5 % quantile of the normal law


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrelationTest(Frozen):
    """Test whether a correlation of the residual differs from zero by more than chance.

    Parameters
    ----------
    name : str
        Name of the test, such as "ue"; `Validation.test` lists the names.
    output : int
        Row index of the output whose residual e is tested.
    other : int or None
        Row index of the input u, or of the other output in test "ee'"; None in test "ee".
    lags : ndarray of int, shape (n_lags,)
        Tested lags tau in samples.
    values : ndarray, shape (n_lags,)
        Normalised correlation at each lag, between -1 and 1.
    n_samples : int
        Number of residuals.
    p_value : float
        Probability of correlations at least as large if the model is adequate. It is twice the smaller p-value of two
        statistics: the sum of the squared correlations, and the largest correlation. In test "(u2)'e2", the squares are
        first replaced by the values that their ranks would have if u and e were normal. Otherwise, a few large
        residuals alone would make the test fail.
    level : float
        Significance level; the test fails if ``p_value`` is below ``level``.
    """

    name: str
    output: int
    other: int | None
    lags: Integers
    values: Array
    n_samples: int
    p_value: float
    level: float

    @property
    def band(self) -> float:
        """Half width of the 95 % band, 1.96 / sqrt(n_samples), in which a single correlation should lie."""
        return _QUANTILE / float(np.sqrt(self.n_samples))

    @property
    def passed(self) -> bool:
        """True if ``p_value`` is at least ``level``."""
        return self.p_value >= self.level

    @property
    def share_outside(self) -> float:
        """Share of the lags at which the correlation lies outside the band; 0.05 is expected by chance."""
        return float(np.mean(np.abs(self.values) > self.band))

    @property
    def largest(self) -> float:
        """Correlation with the largest magnitude."""
        return float(self.values[np.argmax(np.abs(self.values))])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the correlation over its lags with the 95 % band, on `ax` or new axes."""
        axes = axes_or_new(ax)
        outside = np.abs(self.values) > self.band
        axes.axhspan(-self.band, self.band, color="0.88", zorder=0)
        axes.axhline(0.0, color="0.5", linewidth=0.8)
        for chosen, colour in ((~outside, "C0"), (outside, "C3")):
            axes.vlines(self.lags[chosen], 0.0, self.values[chosen], color=colour, linewidth=1.2)
            axes.plot(self.lags[chosen], self.values[chosen], "o", color=colour, markersize=3)
        reach = 1.15 * max(1.5 * self.band, float(np.abs(self.values).max()))
        axes.set_ylim(-reach, reach)
        axes.set(xlabel=r"lag $\tau$ (samples)", ylabel=f"${TESTS[self.name]}$")
        chance = f"p = {self.p_value:.2g}" if self.p_value >= _LEAST_SHOWN else f"p < {_LEAST_SHOWN:g}"
        axes.set_title(f"{'passes' if self.passed else 'fails'}, {chance}", loc="right", fontsize="small")
        return axes


@dataclass(frozen=True, kw_only=True)
class Whiteness:
    """Portmanteau test of Ljung and Box [2]_ of one output's residual."""

    output: int  # Row of the output
    statistic: float
    dof: int  # Number of lags: degrees of freedom of the statistic's chi-square law for white noise
    p_value: float  # Probability of a larger statistic for white noise
    share_outside: float  # Share of the lags outside of ±1.96 / sqrt(N)
    usual_outside: tuple[float, float]  # 95 % interval of that share for white noise (binomial)


def correlation(delayed: Series, signal: Series, lags: Integers) -> Array:
    """Return sum_k a(k - tau) b(k) / sqrt(sum a^2 sum b^2), (n_lags,), without products across recordings."""
    sums = np.zeros(len(lags))
    for a, b in zip(delayed, signal, strict=True):
        for i, lag in enumerate(lags.tolist()):
            if abs(lag) < a.size:
                sums[i] += a[: a.size - lag] @ b[lag:] if lag >= 0 else a[-lag:] @ b[:lag]
    return np.asarray(sums / np.sqrt(_power(delayed) * _power(signal)), dtype=np.float64)


def correlation_tests(
    residuals: Sequence[Array], inputs: Sequence[Array], *, max_lag: int, level: float
) -> tuple[CorrelationTest, ...]:
    """Test residuals (n_outputs, n_r) of records by correlations with inputs (n_inputs, n_r) (Billings and Voon [1]_).

    With residual e, input u without its mean, and ' for a signal without its mean: phi_ee at lags from 1; phi_ue,
    phi_(u2)'e and phi_(u2)'e2 at lags of both signs; phi_e(eu) at lags 0 to ``max_lag - 1``. The mean of e is kept: it is
    a fault. Bartlett's covariance between lags [3]_ lets the tests with u test dependence on the input only. The p-value
    of phi_(u2)'e2 is that of the squares' chi-square scores, because outliers of the residual spoil a gamma law.
    """
    both, later = np.arange(-max_lag, max_lag + 1), np.arange(1, max_lag + 1)
    n_outputs, n_inputs = residuals[0].shape[0], inputs[0].shape[0]
    errors = [_row(residuals, i) for i in range(n_outputs)]
    tests = []
    for i, e in enumerate(errors):
        tests.append(_tested("ee", i, None, later, later, e, e, level))
        e2 = _centred([x**2 for x in e])
        for j in range(n_inputs):
            u = _centred(_row(inputs, j))
            u2 = _centred([x**2 for x in u])
            if np.ptp(np.concatenate(_row(inputs, j))) == 0.0:
                continue
            eu = [x * y for x, y in zip(e, u, strict=True)]
            tests.append(_tested("ue", i, j, both, both, u, e, level))
            tests.append(_tested("e(eu)", i, j, later - 1, later, eu, e, level))
            if _power(u2) > _ROUNDING * _power([x**2 for x in u]) and _power(e2) > 0.0:
                tests.append(_tested("(u2)'e", i, j, both, both, u2, e, level))
                tests.append(_tested("(u2)'e2", i, j, both, both, u2, e2, level, (_scored(u2), _scored(e2))))
    for i, j in combinations(range(n_outputs), 2):
        tests.append(_tested("ee'", i, j, both[both != 0], both[both != 0], errors[j], errors[i], level))
    return tuple(tests)


def whiteness_of(residuals: Sequence[Array], output: int, *, max_lag: int) -> Whiteness:
    """Test whether one output's residual is white. Shapes: `residuals` (n_outputs, n_r)."""
    from scipy.stats import binom, chi2

    e, lags = _row(residuals, output), np.arange(1, max_lag + 1)
    n, values = sum(x.size for x in e), correlation(e, e, lags)
    statistic = float(np.sum(_standardised(values, e, lags) ** 2)) * (n + 2) / n
    low, high = binom.interval(0.95, max_lag, 0.05)
    return Whiteness(
        output=output,
        statistic=statistic,
        dof=max_lag,
        p_value=float(chi2.sf(statistic, max_lag)),
        share_outside=float(np.mean(np.abs(values) > _QUANTILE / np.sqrt(n))),
        usual_outside=(float(low) / max_lag, float(high) / max_lag),
    )


def _scored(squares: Series) -> list[Array]:
    """Return the chi-square quantiles (1 degree of freedom) of the values' ranks, less their mean."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    ranks = rankdata(np.concatenate(squares))
    scores = ndtri(0.5 - 0.5 * ranks / (ranks.size + 1)) ** 2  # a chi-square variable is the square of a normal one
    return _centred(np.split(scores, np.cumsum([x.size for x in squares])[:-1]))


def _tested(
    name: str,
    output: int,
    other: int | None,
    lags: Integers,
    shifts: Integers,
    a: Series,
    b: Series,
    level: float,
    judged: tuple[Series, Series] | None = None,
) -> CorrelationTest:
    """Test the correlation of a, delayed by the shifts, with b; the p-value is that of the pair ``judged`` if given."""
    values = correlation(a, b, shifts)
    a, b = judged or (a, b)
    spread = np.eye(1, shifts.size)[0]  # correlations at the lags are independent, because e is white
    if name in ("ue", "(u2)'e", "(u2)'e2"):
        spread = _bartlett(a, b, shifts.size, int(shifts[-1]))
    tested = values if judged is None else correlation(a, b, shifts)
    scores = _normal_scores(_standardised(tested, b, shifts) / np.sqrt(spread[0]), _skewness(a) * _skewness(b))
    return CorrelationTest(
        name=name,
        output=output,
        other=other,
        lags=lags,
        values=values,
        n_samples=sum(x.size for x in b),
        p_value=_p_value(scores, spread / spread[0]),
        level=level,
    )


def _standardised(values: Array, series: Series, lags: Integers) -> Array:
    """Return the correlations with unit variance for white noise; shape (n_lags,)."""
    n = sum(x.size for x in series)
    products = sum(np.maximum(x.size - np.abs(lags), 0) for x in series)
    return np.divide(n * values, np.sqrt(products), out=np.zeros(lags.size), where=products > 0)


def _bartlett(a: Series, b: Series, count: int, reach: int) -> Array:
    """Return N cov(phi_ab(tau), phi_ab(tau + d)), d = 0 ... count - 1, of independent a and b: the sum over s of
    rho_b(s) and rho_a(s + d), rho_b being tapered to zero beyond ``reach`` so that it stays a covariance."""
    shifts = np.arange(-reach, reach + 1)
    of_b = correlation(b, b, np.abs(shifts)) * (1.0 - np.abs(shifts) / (reach + 1))
    of_a = correlation(a, a, np.arange(count + reach))
    return np.array([of_b @ of_a[np.abs(shifts + d)] for d in range(count)])


def _skewness(series: Series) -> float:
    """Return the skewness of a signal over n^(1/4); a sum of n products has the product of two of these."""
    x = np.concatenate(series)
    x = x - x.mean()
    square = x * x
    return float(np.mean(square * x) / np.mean(square) ** 1.5) / x.size**0.25


def _normal_scores(scores: Array, skewness: float) -> Array:
    """Return normal quantiles of skewed scores by a gamma law (Pearson type III), whose far tail is heavier."""
    from scipy.special import gammainc, gammaincc, ndtri

    if abs(skewness) < _SYMMETRIC:
        return scores
    shape, turned = 4.0 / skewness**2, scores * np.sign(skewness)
    place = np.maximum(shape + turned * np.sqrt(shape), 0.0)
    lower, upper = (np.maximum(tail(shape, place), _LEAST_TAIL) for tail in (gammainc, gammaincc))
    return np.asarray(np.where(turned < 0, ndtri(lower), -ndtri(upper)) * np.sign(skewness))


def _p_value(scores: Array, spread: Array) -> float:
    """Return the p-value of normal scores with Toeplitz correlation ``spread``: twice the smaller of those of the sum of
    squares (Satterthwaite's chi-square) and of the largest (Sidak [4]_, exact for independent lags)."""
    from scipy.special import chdtrc, ndtr

    count = scores.size
    half_variance = count + 2 * float((count - np.arange(1, count)) @ spread[1:] ** 2)
    dof = count**2 / half_variance
    by_sum = float(chdtrc(dof, float(scores @ scores) * dof / count))
    single = 2 * float(ndtr(-np.abs(scores).max()))
    by_largest = -float(np.expm1(count * np.log1p(-min(single, 1 - 1e-16))))
    return min(1.0, 2 * min(by_sum, by_largest))


def _row(signals: Sequence[Array], row: int) -> list[Array]:
    return [signal[row] for signal in signals]


def _power(series: Series) -> float:
    return float(sum(x @ x for x in series))


def _centred(series: Series) -> list[Array]:
    """Remove the mean over all recordings."""
    mean = float(np.concatenate(series).mean())
    return [x - mean for x in series]
