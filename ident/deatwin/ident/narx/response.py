"""What a NARX model answers over a recording, and the free run that computes it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


class ResponseStatus(Enum):
    """How a prediction or free run ended; the value is the advice."""

    OK = "done"
    DIVERGED = (
        "the free run diverged; the outputs after that time hold the last value: "
        "stay within the operating range of the model, or choose another structure"
    )

    @property
    def ok(self) -> bool:
        """Whether every sample was computed."""
        return self is ResponseStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class NarxResponse:
    """Outputs of a model over a recording, one step ahead or in free run.

    Parameters
    ----------
    outputs : ndarray, shape (1, n)
        Model outputs in the recording's unit; the samples before ``first`` are the measured ones. Always
        finite.
    measured : ndarray, shape (1, n)
        The recording's outputs.
    timepts : ndarray, shape (n,)
        Times of the samples on the recording's clock in s.
    first : int
        The first computed sample.
    status : ResponseStatus
        Whether the run is sound.
    failed_at_s : float or None
        Time at which a free run diverged, in s.
    unit : str
        Unit of the outputs.
    """

    outputs: Array
    measured: Array
    timepts: Array
    first: int
    status: ResponseStatus = ResponseStatus.OK
    failed_at_s: float | None = None
    unit: str = ""

    @property
    def residuals(self) -> Array:
        """Measured minus computed outputs of the computed samples, shape (1, n - first)."""
        return np.asarray((self.measured - self.outputs)[:, self.first :], dtype=np.float64)

    @property
    def rms_error(self) -> float:
        """Root mean square of the residuals, in the recording's unit."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw measured and computed outputs over time.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        axes.plot(self.timepts, self.measured[0], label="measured")
        axes.plot(self.timepts, self.outputs[0], label="model")
        axes.set_xlabel("time (s)")
        axes.set_ylabel(f"output ({self.unit})" if self.unit else "output")
        axes.legend()
        return axes


def free_run(
    table: TermTable, theta: Array, inputs: Array, measured: Array, limit: float
) -> tuple[Array, int | None]:
    """Run a model of one output free.

    With the inputs known, y(k) = sum_j c_j(k) m_j(y(k-1), y(k-2), ...): the c_j, one for each monomial m_j of
    lagged outputs, are computed at once for all samples; only the short sum runs sample by sample, in plain
    floats.

    Parameters
    ----------
    table : TermTable
        The terms.
    theta : ndarray, shape (n_terms,)
        Parameters.
    inputs : ndarray, shape (n_inputs, n)
        Inputs.
    measured : ndarray, shape (n,)
        Outputs; only the first ``table.max_lag`` are used.
    limit : float
        Outputs beyond ± this are divergence, in the output's unit.

    Returns
    -------
    outputs : ndarray, shape (n,)
        After a divergence the last value is held.
    failed : int or None
        Sample of the divergence.
    """
    first, n = table.max_lag, inputs.shape[1]
    output_parts = [tuple(v.lag for v in term.expanded if v.kind == "y") for term in table.terms]
    input_parts = TermTable(
        tuple(Term.product(v for v in term.expanded if v.kind == "u") for term in table.terms)
    )
    monomials = sorted(set(output_parts))
    coefficients = np.zeros((len(monomials), n - first))
    np.add.at(
        coefficients,
        [monomials.index(part) for part in output_parts],
        theta[:, None] * input_parts.rows(inputs, measured[None], first, n),
    )
    run: list[float] = measured.tolist()
    for k, row in enumerate(coefficients.T.tolist(), start=first):
        value = 0.0
        for factor, lags in zip(row, monomials, strict=True):
            for lag in lags:
                factor *= run[k - lag]
            value += factor
        if not -limit < value < limit:
            run[k:] = [run[k - 1] if k else 0.0] * (n - k)
            return np.array(run), k
        run[k] = value
    return np.array(run), None
