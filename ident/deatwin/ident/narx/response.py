"""The computed outputs of a NARX model over a recording."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from deatwin.ident.arguments import read_only
from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.drive import Drive
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.datasets import Described, attribute, coordinate, one_unit, status_of, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.recording import Recording

DIVERGED = 1e3  # Multiple of the outputs of the training data beyond which a free run has diverged
_DIVERGED_UNTRAINED = 1e9  # The same for a model without training data, which has no scale of its own
_WRITTEN = ("mean_square", "nrmse")
_TWO_SIDED = 1.96  # 97.5 % quantile of the normal law, for two-sided intervals of 95 %


class ResponseStatus(Enum):
    """Outcome of a prediction or free run. The value of each member is a message for the user."""

    OK = "done"
    DIVERGED = (
        "the free run diverged; the outputs after that time hold the last value: "
        "stay within the operating range of the model, or choose another structure"
    )
    SOME_DIVERGED = (
        "predictions several steps ahead diverged, the first at that time; they hold an earlier value: "
        "predict fewer steps ahead, or choose another structure"
    )

    @property
    def ok(self) -> bool:
        """True if nothing diverged."""
        return self is ResponseStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class NarxResponse(Described):
    """Outputs of a model over a recording, predicted some steps ahead or simulated in free run.

    Parameters
    ----------
    outputs : ndarray, shape (n_outputs, n)
        Model outputs in the recording's units. Before ``first``, they are the measured outputs. From `failed_at_s` on,
        they keep their last value, and are no predictions.
    measured : ndarray, shape (n_outputs, n)
        Measured outputs, in the recording's units.
    timepts : ndarray, shape (n,)
        Times of the samples on the recording's clock in s.
    first : int
        Index of the first computed sample.
    status : ResponseStatus
        Outcome of the run.
    failed_at_s : float or None
        Time in s of the first sample at which the free run or a prediction several steps ahead diverged; None if
        nothing diverged.
    units : tuple of str
        Unit of each output.
    """

    outputs: Array = field(metadata=variable("output", "time", name="computed", unit=one_unit))
    measured: Array = field(metadata=variable("output", "time", unit=one_unit))
    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    first: int = field(metadata=attribute())
    status: ResponseStatus = field(default=ResponseStatus.OK, metadata=status_of())
    failed_at_s: float | None = field(default=None, metadata=attribute())
    units: tuple[str, ...] = field(default=("",), metadata=coordinate("output", name="unit"))

    @property
    def residuals(self) -> Array:
        """Measured minus computed outputs from sample ``first`` on, shape (n_outputs, n - first)."""
        return np.asarray((self.measured - self.outputs)[:, self.first :], dtype=np.float64)

    @property
    def rms_error(self) -> float:
        """Root mean square of the residuals, over all outputs that have the same unit as the first."""
        alike = [row for row, unit in enumerate(self.units) if unit == self.units[0]]
        return float(np.sqrt(np.mean(self.residuals[alike] ** 2)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw measured and computed outputs over time, on `ax` or new axes."""
        axes = axes_or_new(ax)
        several = len(self.outputs) > 1
        for row, (measured, computed) in enumerate(zip(self.measured, self.outputs, strict=True), start=1):
            number = f" {row}" if several else ""
            axes.plot(self.timepts, measured, label=f"measured{number}")
            axes.plot(self.timepts, computed, label=f"model{number}")
        units = sorted({unit for unit in self.units if unit})
        axes.set(xlabel="time (s)", ylabel=f"output ({', '.join(units)})" if units else "output")
        axes.legend()
        return axes


def response_over(
    run: Recording | Drive,
    outputs: Array,
    first: int,
    units: tuple[str, ...],
    status: ResponseStatus = ResponseStatus.OK,
    failed_at_s: float | None = None,
) -> NarxResponse:
    """Return the response of a model to the inputs of a run. Shapes: `outputs` (n_outputs, n)."""
    return NarxResponse(
        outputs=read_only(outputs),
        measured=run.outputs if isinstance(run, Recording) else run.measured,
        timepts=run.timepts,
        first=first,
        status=status,
        failed_at_s=failed_at_s,
        units=units,
    )


def divergence_limit(operating: OperatingRange | None, measured: Array, origin: Array | float = 0.0) -> float:
    """Return the largest output beyond which a free run has diverged; `measured` (n_outputs, n)."""
    about = np.asarray(origin)
    largest = float(np.abs(measured - about[..., None]).max())
    if operating is None:
        return _DIVERGED_UNTRAINED * max(1.0, largest)
    seen = np.abs([operating.output_min - about, operating.output_max - about])
    return DIVERGED * max(float(seen.max()), largest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Frozen):
    """Agreement of model outputs with measured outputs, over all recordings together."""

    mean_square: Array
    nrmse: Array  # shape (n_outputs,): sqrt( sum (y - yhat)^2 / sum (y - mean y)^2 )

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
    """Slope b of ``y - y_s = a + b y_s`` and its 95 % half width (Geyer, Stat. Sci. 7 (1992) 473); None at rest."""
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


def lagged_products(values: Array) -> Array:
    """Return the sums over k of x(k) x(k+l) for the lags l = 0, 1, ..., n - 1."""
    size = 1 << (2 * values.size - 1).bit_length()
    return np.asarray(np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: values.size])


def _variance_of_sum(values: Array) -> float:
    """Return the variance of the sum of a correlated series with mean zero."""
    sums = lagged_products(values)
    pairs = sums[: sums.size // 2 * 2].reshape(-1, 2).sum(axis=1)
    first_negative = int(np.argmax(np.append(pairs <= 0.0, True)))
    return max(2.0 * float(pairs[:first_negative].sum()) - float(sums[0]), float(sums[0]))
