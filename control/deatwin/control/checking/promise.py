"""What an identified model promises: its operating point, and margins over its posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from deatwin.control.design.lambda_tuning import PiController
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.stability.margins import margins

__all__ = ["QUANTILE", "LoopMargins", "OperatingPoint", "loop_margins"]

QUANTILE = 0.025
"""Of the posterior, at which margins are judged."""


@dataclass(frozen=True, kw_only=True)
class OperatingPoint:
    """Where the model was linearised.

    Parameters
    ----------
    input : float
        In the input's unit.
    output : float or None
        Output at rest there, in its unit; None where the model does not settle.
    static_gain : float or None
        Output unit by input unit; None where the model does not settle.
    status : LinearStatus
        Whether a controller could be designed there.
    sample_time : float
        s.
    input_unit, output_unit : str
        Units.
    """

    input: float
    output: float | None
    static_gain: float | None
    status: LinearStatus
    sample_time: float
    input_unit: str
    output_unit: str

    @classmethod
    def of(cls, linear: LinearModel) -> Self:
        """Describe where a model was linearised.

        Parameters
        ----------
        linear : LinearModel
            Sound or not.

        Returns
        -------
        OperatingPoint
        """
        settles = linear.operating_output is not None
        return cls(
            input=linear.operating_input,
            output=linear.operating_output,
            static_gain=linear.static_gain if settles else None,
            status=linear.status,
            sample_time=linear.sample_time,
            input_unit=linear.input_unit,
            output_unit=linear.output_unit,
        )


@dataclass(frozen=True, kw_only=True)
class LoopMargins:
    """Margins that the model promises; infinite where nothing bounds them, zero where the loop is unstable.

    Parameters
    ----------
    gain, phase_deg, delay, crossover_Hz : float
        Of the model itself: factor, degrees, s, Hz.
    gain_low, phase_low_deg, delay_low : float
        The 2.5 % quantile over the posterior.
    stable_share : float
        Share of the posterior's samples with a stable closed loop.
    samples : int
        Number of samples.
    """

    gain: float
    phase_deg: float
    delay: float
    crossover_Hz: float
    gain_low: float
    phase_low_deg: float
    delay_low: float
    stable_share: float
    samples: int


def loop_margins(
    linear: LinearModel, posterior: Sequence[LinearModel], controller: PiController
) -> LoopMargins:
    """Margins of a controller with a model and with the samples of its posterior.

    Parameters
    ----------
    linear : LinearModel
        As the controller sees it (`LinearModel.in_loop`).
    posterior : sequence of LinearModel
        Samples, likewise; one without an equilibrium counts as unstable.
    controller : PiController
        In the loop.

    Returns
    -------
    LoopMargins
    """
    members = [linear, *(sample for sample in posterior if sample.operating_output is not None)]
    found = margins(
        [np.convolve(m.numerator, controller.numerator) for m in members],
        [np.convolve(m.denominator, controller.denominator) for m in members],
        linear.sample_time,
    )
    missing = np.zeros(1 + len(posterior) - len(members))

    def low(values: np.ndarray) -> float:
        # An order statistic: interpolation between infinite margins is not a number.
        worst = np.quantile(np.concatenate([values[1:], missing]), QUANTILE, method="lower")
        return float(min(worst, values[0]))

    return LoopMargins(
        gain=float(found.gain[0]),
        phase_deg=float(found.phase_deg[0]),
        delay=float(found.delay[0]),
        crossover_Hz=float(found.crossover[0] / (2 * np.pi)),
        gain_low=low(found.gain),
        phase_low_deg=low(found.phase_deg),
        delay_low=low(found.delay),
        stable_share=float(found.stable[1:].sum() / len(posterior)) if found.stable[0] else 0.0,
        samples=len(posterior),
    )
