"""The computed outputs of a NARX model over a recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only
from deatwin.ident.narx.drive import Drive
from deatwin.ident.narx.operating import OperatingRange
from deatwin.plant.datasets import Described, attribute, coordinate, one_unit, status_of, variable
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

DIVERGED = 1e3  # Multiple of the outputs of the training data beyond which a free run has diverged
# A model without training data has no scale of its own, so that only outputs that cannot be intended count as diverged.
_DIVERGED_UNTRAINED = 1e9


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
        """True if every sample was computed."""
        return self is ResponseStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class NarxResponse(Described):
    """Outputs of a model over a recording, predicted some steps ahead or simulated in free run.

    Parameters
    ----------
    outputs : ndarray, shape (n_outputs, n)
        Model outputs in the recording's units, always finite; the samples before ``first`` are the measured ones.
    measured : ndarray, shape (n_outputs, n)
        Measured outputs, in the recording's units.
    timepts : ndarray, shape (n,)
        Times of the samples on the recording's clock in s.
    first : int
        Index of the first computed sample.
    status : ResponseStatus
        Outcome of the run.
    failed_at_s : float or None
        Time in s at which a free run, or the first prediction several steps ahead, diverged; None without divergence.
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
        """Measured minus computed outputs of the computed samples, shape (n_outputs, n - first)."""
        return np.asarray((self.measured - self.outputs)[:, self.first :], dtype=np.float64)

    @property
    def rms_error(self) -> float:
        """Root mean square of the residuals of the first output and all others in its unit, in this unit."""
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
        axes.set_xlabel("time (s)")
        axes.set_ylabel(f"output ({', '.join(units)})" if units else "output")
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
