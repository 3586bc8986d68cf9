"""Errors of tests: an absolute and a relative part, a scale factor per specimen, and correlated residuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from deatwin.ident.materials.observations import Observations
from deatwin.plant.arrays import Array

FIRST_GUESS = 0.02  # Relative error from which the estimate starts, that of a careful test
SMALLEST = 1e-6  # Least error, relative to the largest sample; no machine is more accurate
ROUNDING = 0.01  # Mean square of residuals, in units of their errors, up to which they are rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Noise:
    """Sizes of the errors."""

    absolute: tuple[float, ...]  # Absolute errors of stresses and of moduli, Pa
    relative: tuple[float, ...]
    scatter: float  # Relative standard deviation between specimens
    repeats: tuple[float, ...]  # For each test, the number of samples that count as one independent sample

    @classmethod
    def guess(cls, data: Observations) -> Noise:
        """Return assumed errors, before any fit."""
        sizes = [float(np.sqrt(np.mean(data.measured[group] ** 2))) for group in data.groups]
        return cls(
            absolute=tuple(0.5 * FIRST_GUESS * size for size in sizes),
            relative=(FIRST_GUESS,) * len(sizes),
            scatter=0.0,
            repeats=(1.0,) * len(data.blocks),
        )

    def deviations(self, data: Observations, modelled: Array) -> Array:
        """Return the standard deviation of each sample's own error, Pa. Shapes: (n,) both."""
        found = np.empty(modelled.size)
        for group, absolute, relative in zip(data.groups, self.absolute, self.relative, strict=True):
            found[group] = np.hypot(absolute, relative * modelled[group])
        for place, repeats in zip(data.places, self.repeats, strict=True):
            found[place] *= np.sqrt(repeats)
        return found

    def whitener(self, data: Observations, modelled: Array) -> Whitener:
        """Return the map that makes errors independent and of size 1. Shapes: (n,)."""
        own = self.deviations(data, modelled)
        return Whitener(data=data, own=own, common=self.scatter * modelled / own)

    def count(self, data: Observations) -> float:
        """Number of independent samples."""
        return float(sum(b.measured.size / r for b, r in zip(data.blocks, self.repeats, strict=True)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Whitener:
    r"""Inverse root of the covariance :math:`D^2 + s^2 m m^T` of each specimen's errors."""

    data: Observations
    own: Array  # (n,): standard deviation of each sample's own error, Pa
    common: Array  # (n,): standard deviation of the error common to a specimen, in units of `own`

    def __call__(self, values: Array) -> Array:
        """Whiten values of shape (n,) or (n, k)."""
        white = (values.T / self.own).T
        for samples, common, length in self._shared():
            share = (1.0 - 1.0 / np.sqrt(1.0 + length)) / length
            white[samples] -= share * np.multiply.outer(common, common @ white[samples])
        return white

    @property
    def log_size(self) -> float:
        """Half the logarithm of the covariance's determinant."""
        return float(np.sum(np.log(self.own)) + sum(0.5 * np.log1p(length) for _, _, length in self._shared()))

    def _shared(self) -> Iterator[tuple[NDArray[np.intp], Array, float]]:
        for samples in self.data.specimens:
            common = self.common[samples]
            if (length := float(common @ common)) > 1e-12:
                yield samples, common, length


def estimate_noise(data: Observations, residual: Array, modelled: Array, slopes: Array) -> Noise:
    """Estimate the errors by restricted maximum likelihood. Shapes: (n,), (n,), (n, k)."""
    sizes = [float(np.max(np.abs(data.measured[group]))) for group in data.groups]
    scattered = len(data.specimens) > 1
    alone = (1.0,) * len(data.blocks)  # the size of the errors does not depend on their correlation

    def noise(logs: Array, repeats: tuple[float, ...]) -> Noise:
        found = np.exp(np.clip(logs, np.log(SMALLEST), 0.0))
        count = len(sizes)
        return Noise(
            absolute=tuple(float(v * s) for v, s in zip(found[:count], sizes, strict=True)),
            relative=tuple(map(float, found[count : 2 * count])),
            scatter=float(found[2 * count]) if scattered else 0.0,
            repeats=repeats,
        )

    columns = np.column_stack([slopes, residual])

    def loss(logs: Array) -> float:
        white = noise(logs, alone).whitener(data, modelled)
        triangle = np.asarray(np.linalg.qr(white(columns), mode="r"))
        rest, parts = triangle[-1, -1], np.abs(np.diag(triangle)[:-1])
        return 0.5 * float(rest**2) + white.log_size + float(np.sum(np.log(np.maximum(parts, 1e-300))))

    start = np.log(np.array([*(0.1 * FIRST_GUESS for _ in sizes), *(FIRST_GUESS for _ in sizes), FIRST_GUESS]))
    start = start if scattered else start[:-1]
    bounds, options = [(np.log(SMALLEST), 0.0)] * start.size, {"ftol": 1e-6, "gtol": 0.01}
    found = minimize(loss, start, method="L-BFGS-B", bounds=bounds, options=options)
    white = noise(found.x, alone).whitener(data, modelled)(residual)
    return noise(found.x, tuple(_correlated(white[place]) for place in data.places))


def _correlated(residual: Array) -> float:
    """Return one plus twice the sum of the correlations before the first insignificant one. Shapes: (n,)."""
    size, energy = residual.size, float(residual @ residual)
    # Too few samples to distinguish a correlation from chance, or residuals of rounding, which is no noise
    if energy <= ROUNDING * size or size < 8:
        return 1.0
    total = 1.0
    for lag in range(1, size // 2):
        correlation = float(residual[:-lag] @ residual[lag:]) / energy
        if correlation < 2.0 / np.sqrt(size):
            break
        total += 2.0 * correlation
    return min(total, size / 4.0)
