"""Measure the agreement of model outputs with measured outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only
from deatwin.ident.narx.response import NarxResponse

Array = NDArray[np.float64]
_WRITTEN = ("mean_square", "nrmse")
_TWO_SIDED = 1.96  # 97.5 % quantile of the normal law, for two-sided intervals of 95 %


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Agreement of model outputs with measured outputs, over all recordings together."""

    mean_square: Array
    nrmse: Array  # shape (n_outputs,): sqrt( sum (y - yhat)^2 / sum (y - mean y)^2 )

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, read_only(getattr(self, item.name)))

    @classmethod
    def of(cls, responses: Sequence[NarxResponse]) -> Fit:
        """Compute the agreement over all recordings; errors are infinite if a free run diverged."""
        residuals = np.concatenate([response.residuals for response in responses], axis=1)
        measured = np.concatenate([response.measured[:, response.first :] for response in responses], axis=1)
        square = np.sum(residuals**2, axis=1)
        if not all(response.status.ok for response in responses):
            square = np.full(len(square), np.inf)
        around = np.sum((measured - measured.mean(axis=1, keepdims=True)) ** 2, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return cls(mean_square=square / residuals.shape[1], nrmse=np.sqrt(square / around))

    @classmethod
    def read(cls, document: Mapping[str, Sequence[float | None]]) -> Fit:
        """Return the fit from the data that `document` returned."""
        return cls(**{name: np.array([math.inf if v is None else v for v in document[name]]) for name in _WRITTEN})

    @property
    def document(self) -> dict[str, list[float | None]]:
        """Plain data, with None for infinite values."""
        return {name: [v if math.isfinite(v) else None for v in getattr(self, name).tolist()] for name in _WRITTEN}

    @property
    def percent(self) -> Array:
        """100 (1 - nrmse), shape (n_outputs,): 100 for a perfect model, 0 for the mean of the output."""
        return np.asarray(100.0 * (1.0 - self.nrmse), dtype=np.float64)

    @property
    def rms(self) -> Array:
        """Root of `mean_square`, shape (n_outputs,), in the outputs' units."""
        return np.asarray(np.sqrt(self.mean_square), dtype=np.float64)


def gain_error(responses: Sequence[NarxResponse]) -> tuple[float, float] | None:
    """Slope b of ``y - y_s = a + b y_s`` over the first output y_s, and its 95 % half width; None at rest.
    Autocovariances are summed up to the first negative pair of lags (Geyer, Stat. Sci. 7 (1992) 473-483)."""
    runs, readings = [run.outputs[0] for run in responses], [run.measured[0] for run in responses]
    swings = [run - run.mean() for run in runs]
    power = sum(float(swing @ swing) for swing in swings)
    scale = sum(float(np.sum(reading**2)) for reading in readings)
    if power <= np.finfo(np.float64).eps * scale:  # the model's output does not move, so it has no gain
        return None
    errors = [reading - run for reading, run in zip(readings, runs, strict=True)]
    slope = sum(float(swing @ error) for swing, error in zip(swings, errors, strict=True)) / power
    products = [swing * (error - error.mean() - slope * swing) for swing, error in zip(swings, errors, strict=True)]
    variance = sum(_variance_of_sum(product) for product in products) / power**2
    return slope, _TWO_SIDED * math.sqrt(variance)


def _variance_of_sum(values: Array) -> float:
    """Return the variance of the sum of a correlated series with mean zero."""
    size = 1 << (2 * values.size - 1).bit_length()
    sums = np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: values.size]
    pairs = sums[: sums.size // 2 * 2].reshape(-1, 2).sum(axis=1)
    first_negative = int(np.argmax(np.append(pairs <= 0.0, True)))
    return max(2.0 * float(pairs[:first_negative].sum()) - float(sums[0]), float(sums[0]))
