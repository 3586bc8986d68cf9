"""How well outputs of a model agree with the measured ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.operating import read_only
from deatwin.ident.narx.response import NarxResponse

Array = NDArray[np.float64]


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
        """Return the fit over all recordings, infinite if a free run diverged."""
        residuals = np.concatenate([response.residuals for response in responses], axis=1)
        measured = np.concatenate([response.measured[:, response.first :] for response in responses], axis=1)
        square = np.sum(residuals**2, axis=1)
        if not all(response.status.ok for response in responses):
            square = np.full(len(square), np.inf)
        around = np.sum((measured - measured.mean(axis=1, keepdims=True)) ** 2, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return cls(mean_square=square / residuals.shape[1], nrmse=np.sqrt(square / around))

    @property
    def percent(self) -> Array:
        """100 (1 - nrmse), shape (n_outputs,); 100 is perfect, the mean of the output gives 0."""
        return np.asarray(100.0 * (1.0 - self.nrmse), dtype=np.float64)

    @property
    def rms(self) -> Array:
        """Root of `mean_square`, shape (n_outputs,), in the outputs' units."""
        return np.asarray(np.sqrt(self.mean_square), dtype=np.float64)
