"""From numbers to a verdict: limits with their sources, and one finding for each."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf

import numpy as np

from deatwin.control.checking.promise import LoopMargins
from deatwin.control.loop.closed_loop import ClosedLoop

__all__ = ["Finding", "Limit", "Verdict", "judge_band", "judge_margins", "judge_plant", "worst"]


class Verdict(Enum):
    """Whether a controller would survive the actuator; the value is its name in files."""

    PASS = "pass"
    MARGINAL = "marginal"
    FAIL = "fail"

    @property
    def severity(self) -> int:
        """0 for pass, 2 for fail."""
        return list(Verdict).index(self)


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Where a number stops to be good, and where it becomes bad.

    Parameters
    ----------
    good, poor : float
        Limits of `pass` and of `marginal`, in the number's own unit; a good one above the poor one means that
        more is better.
    """

    good: float
    poor: float

    def judge(self, value: float) -> Verdict:
        """Verdict on a number.

        Parameters
        ----------
        value : float
            In the number's own unit.

        Returns
        -------
        Verdict
        """
        sign = 1.0 if self.good > self.poor else -1.0
        if sign * value >= sign * self.good:
            return Verdict.PASS
        return Verdict.MARGINAL if sign * value >= sign * self.poor else Verdict.FAIL


GAIN = Limit(good=2.0, poor=1.5)
"""Gain margin. Åström & Murray, Feedback Systems (2008), section 9.3: 2 to 5 is reasonable; Skogestad &
Postlethwaite, Multivariable Feedback Control (2005), section 2.4.3: more than 2."""
PHASE_DEG = Limit(good=45.0, poor=30.0)
"""Phase margin, degrees. Åström & Murray, section 9.3: 30 to 60; Skogestad & Postlethwaite: more than 30."""
DELAY_SAMPLES = Limit(good=1.0, poor=0.5)
"""Delay margin, samples: a command that comes one sample late must not upset the loop (our choice)."""
STABLE_SHARE = Limit(good=0.975, poor=0.9)
"""Share of the posterior's samples with a stable closed loop: the quantile at which margins are judged."""
OVERSHOOT = Limit(good=0.25, poor=0.5)
"""Overshoot of a step, as a share of it: about what phase margins of 45 and 30 degrees give in a second-order
loop (Åström & Murray, sections 6.3 and 9.3)."""
STEADY_ERROR = Limit(good=0.05, poor=0.15)
"""Mean error late after a step, as a share of the step (our choice; with integral action it goes to zero)."""
RIPPLE = Limit(good=0.1, poor=0.3)
"""Rms motion late after a step, as a share of the step (our choice): more is ringing or a limit cycle."""
SATURATED = Limit(good=0.05, poor=0.25)
"""Share of samples with the command at a limit (our choice)."""
TRACKING_RATIO = Limit(good=1.5, poor=3.0)
"""Error on a slow sine, achieved against predicted (our choice)."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One number that was judged.

    Parameters
    ----------
    subject : str
        What was judged.
    value : float or None
        The number in the unit that the text names; None where there is none.
    verdict : Verdict
        On it alone.
    text : str
        One plain sentence.
    """

    subject: str
    value: float | None
    verdict: Verdict
    text: str


def worst(findings: tuple[Finding, ...]) -> Finding:
    """The finding that decides: the first of the most severe ones.

    Parameters
    ----------
    findings : tuple of Finding
        At least one.

    Returns
    -------
    Finding
    """
    return max(findings, key=lambda finding: finding.verdict.severity)


def judge_margins(margins: LoopMargins, sample_time: float) -> tuple[Finding, ...]:
    """Judge what the model promises at the 2.5 % quantile of its posterior.

    Parameters
    ----------
    margins : LoopMargins
        Of the loop.
    sample_time : float
        s.

    Returns
    -------
    tuple of Finding
    """
    late = margins.delay_low / sample_time
    shares = f"{100 * margins.stable_share:.0f} % of the model's posterior"
    stability = _finding("stability", margins.stable_share, STABLE_SHARE, f"the loop is stable in {shares}")
    if stability.verdict is not Verdict.PASS:
        return (stability,)  # margins of loops that are unstable would say the same once more
    low = "at the 2.5 % quantile of the model's posterior"
    gain, phase = (
        f"the gain margin is {margins.gain_low:.2f}",
        f"the phase margin is {margins.phase_low_deg:.0f}°",
    )
    return (
        stability,
        _finding("gain margin", margins.gain_low, GAIN, f"{gain} {low}"),
        _finding("phase margin", margins.phase_low_deg, PHASE_DEG, f"{phase} {low}"),
        _finding("delay margin", late, DELAY_SAMPLES, f"the delay margin is {late:.1f} samples {low}"),
    )


def judge_band(crossover_Hz: float, band_Hz: float) -> Finding:
    """Judge whether the recording knew the frequencies that the controller works at.

    Parameters
    ----------
    crossover_Hz : float
        Of the model's loop, Hz.
    band_Hz : float
        Band that the recording excited, Hz.

    Returns
    -------
    Finding
        At most marginal outside the band.
    """
    place = f"the crossover at {crossover_Hz:.2f} Hz lies"
    if crossover_Hz <= band_Hz:
        text = f"{place} inside the band that the recording excited, up to {band_Hz:.2f} Hz"
        return Finding(subject="excitation", value=crossover_Hz, verdict=Verdict.PASS, text=text)
    text = (
        f"{place} outside the band that the recording excited, up to {band_Hz:.2f} Hz: the margins there are "
        f"extrapolated; a recording excited up to {2 * crossover_Hz:.2g} Hz would settle it"
    )
    return Finding(subject="excitation", value=crossover_Hz, verdict=Verdict.MARGINAL, text=text)


def judge_plant(
    steps: ClosedLoop, sine: ClosedLoop, sine_predicted: float, raised: tuple[tuple[float, ClosedLoop], ...]
) -> tuple[Finding, ...]:
    """Judge the closed loop on the physics plant.

    Parameters
    ----------
    steps, sine : ClosedLoop
        Runs with a step and with a sine reference.
    sine_predicted : float
        Rms error on the sine that the model predicts, in the output's unit.
    raised : tuple of (float, ClosedLoop)
        Runs with the step reference and both gains of the controller raised by a factor.

    Returns
    -------
    tuple of Finding
    """
    for run in (steps, sine):
        if not run.status.ok:
            return (_failed(run),)
    ratio = late_rms_error(sine) / sine_predicted if sine_predicted > 0.0 else inf
    saturated = max(steps.saturated_share, sine.saturated_share)
    measured = (
        ("overshoot", steps.overshoot, OVERSHOOT, f"steps overshoot by {100 * steps.overshoot:.0f} %"),
        ("steady error", steps.steady_error, STEADY_ERROR, f"steps end {100 * steps.steady_error:.1f} % off"),
        ("ripple", steps.ripple, RIPPLE, f"late after a step {100 * steps.ripple:.1f} % of it still moves"),
        ("saturation", saturated, SATURATED, f"{100 * saturated:.0f} % of the commands are at a limit"),
        ("tracking", ratio, TRACKING_RATIO, f"the error on a slow sine is {ratio:.2f} times the predicted"),
    )
    on = "on the physics plant"
    return (*(_finding(name, value, limit, f"{text} {on}") for name, value, limit, text in measured),
            judge_raised(raised))  # fmt: skip


def _failed(run: ClosedLoop) -> Finding:
    """The finding on a run that did not reach its end."""
    when = "before" if not run.timepts.size else f"{run.timepts[-1]:.2f} s after"
    text = f"the physics plant failed {when} the loop was closed: {run.status.value}"
    return Finding(subject="plant", value=None, verdict=Verdict.FAIL, text=text)


def judge_raised(raised: tuple[tuple[float, ClosedLoop], ...]) -> Finding:
    """Judge the gain margin that the physics plant showed: the model may not know its fast mode.

    Parameters
    ----------
    raised : tuple of (float, ClosedLoop)
        Factors, and runs with a step reference.

    Returns
    -------
    Finding
    """
    calm = [factor for factor, run in raised if run.status.ok and run.ripple <= RIPPLE.poor]
    reached = max(calm, default=1.0)
    if calm:
        text = f"the physics plant stays calm with the controller's gain raised {reached:g} times"
    else:
        text = f"the physics plant rings or fails with the gain raised {min(f for f, _ in raised):g} times"
    return _finding("gain margin on the plant", reached, GAIN, text)


def late_rms_error(run: ClosedLoop) -> float:
    """Rms error over the last two thirds of a run, when it has settled.

    Parameters
    ----------
    run : ClosedLoop
        With at least three samples.

    Returns
    -------
    float
        In the output's unit.
    """
    return float(np.sqrt(np.mean(run.error[run.error.size // 3 :] ** 2)))


def _finding(subject: str, value: float, limit: Limit, text: str) -> Finding:
    verdict = limit.judge(value)
    relation = "at least" if limit.good > limit.poor else "at most"
    wanted = "" if verdict is Verdict.PASS else f" ({relation} {limit.good:g} is wanted)"
    return Finding(subject=subject, value=value, verdict=verdict, text=text + wanted)
