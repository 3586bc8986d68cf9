"""Judge numbers against their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from deatwin.control.checking.amounts import amount, three_digits
from deatwin.control.checking.rows import BAND, MarginRow
from deatwin.control.checking.specification import Limit, Specification, Verdict
from deatwin.control.linear.model import LinearModel
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.loop.predicted import PredictedLoop
from deatwin.plant.amplitudes import amount as with_unit
from deatwin.plant.amplitudes import written_amplitude


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Judgement of one quantity, such as the phase margin, in a `Check`.

    Parameters
    ----------
    subject : str
        Name of the quantity that was judged.
    value : float or None
        Value of the quantity, in the unit that `text` names; None if the finding has no value.
    verdict : Verdict
        Verdict on this quantity alone.
    text : str
        Finding as one plain sentence.
    room : float or None
        Distance from the limit to the value, divided by the distance from the limit to the best possible value
        (`Limit.room`). None if the quantity was not judged by a limit.
    """

    subject: str
    value: float | None
    verdict: Verdict
    text: str
    room: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Runs:
    """The simulated runs of one controller on one physics plant."""

    source: str
    steps: ClosedLoop  # Run of a step reference
    sine: ClosedLoop  # Run of a slow sine reference

    @property
    def where(self) -> str:
        """Return, in words, on which plant the runs were made."""
        return f"in simulation with {'the plant model' if self.source == 'plant' else self.source}"

    def subject(self, name: str) -> str:
        """Subject of a finding on these runs."""
        return name if self.source == "plant" else f"{name} ({self.source})"


def worst(findings: Sequence[Finding]) -> Finding:
    """Return the most severe finding, the first of equals; if all pass, the one nearest its limit."""
    decides = max(findings, key=lambda finding: finding.verdict.severity)
    if decides.verdict is not Verdict.PASS:
        return decides
    return min(findings, key=lambda finding: inf if finding.room is None else finding.room)


def judge_margins(rows: Sequence[MarginRow], linear: LinearModel, specification: Specification) -> tuple[Finding, ...]:
    """Judge the margins of one source at its worst operating point."""
    spec, unit = specification, linear.input_unit
    least = min(rows, key=lambda row: row.stable_share)
    text = _stable(rows, unit) if least.stable_share == 1.0 else _partly_stable(least, unit)
    stability = _finding(_subject("stability", least), least.stable_share, spec.stable_share, text)
    if stability.verdict is not Verdict.PASS:
        return (stability,)  # the margins of unstable loops would only repeat this
    by = (
        ("gain margin", lambda r: r.gain_low, spec.gain, "{:.2f}"),
        ("phase margin", lambda r: r.phase_low_deg, spec.phase_deg, "{:.0f}°"),
        ("delay margin", lambda r: r.delay_low / linear.sample_time, spec.delay_samples, "{:.1f} samples"),
        ("disk margin", lambda r: r.disk_low, spec.disk, "{:.2f}"),
    )
    found = [stability]
    for name, measure, limit, written in by:
        row = min(rows, key=measure)
        value = measure(row)
        size = written.format(value) if isfinite(value) else "infinite"
        found.append(_finding(_subject(name, row), value, limit, _margin(name, size, row, unit)))
    return tuple(found)


def judge_runs(runs: Runs, sine_predicted: float, specification: Specification) -> tuple[Finding, ...]:
    """Judge the closed loop on a physics plant."""
    for run in (runs.steps, runs.sine):
        if not run.status.ok:
            return (_failed(runs, run),)
    steps, sine, spec = runs.steps, runs.sine, specification
    ratio = late_rms_error(sine) / sine_predicted if sine_predicted > 0.0 else inf
    saturated = max(steps.saturated_share, sine.saturated_share)
    over, off, moves = (
        amount(100 * share, form, " %")
        for share, form in ((steps.overshoot, ".0f"), (steps.steady_error, ".1f"), (steps.ripple, ".1f"))
    )
    times = amount(ratio, ".2f", " times")
    measured = (
        ("overshoot", steps.overshoot, spec.overshoot, f"the output overshoots by {over} of the step"),
        (
            "steady-state error",
            steps.steady_error,
            spec.steady_error,
            f"the mean error in the last third of a step is {off} of the height of the step",
        ),
        (
            "ripple",
            steps.ripple,
            spec.ripple,
            f"the rms ripple in the last third of a step is {moves} of the height of the step",
        ),
        (
            "saturation",
            saturated,
            spec.saturated,
            f"the command is at one of its limits in {100 * saturated:.0f} % of the samples",
        ),
        (
            "tracking",
            ratio,
            spec.tracking,
            f"the rms error on a slow sine is {times} the error that the identified model predicts",
        ),
    )
    return tuple(
        _finding(runs.subject(name), value, limit, f"{runs.where}, {text}") for name, value, limit, text in measured
    )


def judge_draws(predicted: PredictedLoop, specification: Specification) -> Finding:
    """Judge whether the closed loop of the model's draws remains stable."""
    text = f"the closed loop diverges for {100 * predicted.diverged:.0f} % of the models drawn from the posterior"
    return _finding("model in closed loop", predicted.diverged, specification.diverged, text)


def judge_width(predicted: PredictedLoop, step: float, specification: Specification) -> Finding:
    """Judge whether the predicted band is narrow enough; a wide band would contain any run."""
    share = float(np.median(predicted.half_width)) / abs(step)
    text = f"the half-width of the predicted band is {amount(share, '.3g', ' times')} the height of the step"
    return _finding("width of the prediction", share, specification.width, text)


def judge_prediction(predicted: PredictedLoop, achieved: ClosedLoop, specification: Specification) -> Finding:
    """Judge whether the physics plant behaved as the model predicted."""
    share = predicted.inside(achieved)
    where = f"in simulation with the plant model{_beyond(predicted.trained, achieved)}"
    text = f"{where}, {100 * share:.1f} % of the output lies inside the band that the identified model predicts"
    return _finding("prediction", share, specification.inside, text)


def judge_raised(raised: Sequence[tuple[float, ClosedLoop]], specification: Specification) -> Finding:
    """Judge the gain margin measured on the plant model, which may have a fast mode that the identified model lacks."""
    calm: list[float] = []
    for factor, run in sorted(raised, key=lambda entry: entry[0]):
        if not (run.status.ok and run.ripple <= specification.ripple.poor):
            break
        calm.append(factor)
    reached = max(calm, default=1.0)
    if calm:
        text = (
            f"the loop with the plant model does not oscillate when the controller's gain is multiplied by {reached:g}"
        )
    else:
        text = f"the loop with the plant model oscillates or fails when the controller's gain is multiplied by {min(f for f, _ in raised):g}"
    return _finding("gain margin on the plant", reached, specification.gain, text)


def late_rms_error(run: ClosedLoop) -> float:
    """Return the rms error over the last two thirds of a run. `run` has at least three samples."""
    return float(np.sqrt(np.mean(run.error[run.error.size // 3 :] ** 2)))


def _beyond(trained: tuple[float, float] | None, achieved: ClosedLoop) -> str:
    """Return a sentence on how far a run left the output range of the training data; empty if it did not."""
    low, high = float(achieved.output.min()), float(achieved.output.max())
    if trained is None or trained[0] <= low <= high <= trained[1]:
        return ""
    unit, size = written_amplitude(achieved.output_unit)
    ends = " to ".join(f"{value / size:.3g}" for value in (low, high))
    data = " to ".join(f"{value / size:.3g}" for value in trained)
    return f" (output {ends} {unit}, beyond the range of the training data, {data} {unit})"


def _failed(runs: Runs, run: ClosedLoop) -> Finding:
    """Return the finding on a run that ended early."""
    when = "before" if not run.timepts.size else f"{run.timepts[-1]:.2f} s after"
    who = "the plant model" if runs.source == "plant" else runs.source
    text = f"the simulation with {who} failed {when} the loop was closed: {run.status.value}"
    return Finding(subject=runs.subject("plant"), value=None, verdict=Verdict.FAIL, text=text)


def _subject(name: str, row: MarginRow) -> str:
    return name if row.source == "model" else f"{name} ({row.source})"


def _margin(name: str, size: str, row: MarginRow, unit: str) -> str:
    """Return a margin with its operating point and source, in words."""
    where = _where(row, unit)
    least = size if size == "infinite" else f"at least {size}"
    if row.source == BAND:
        of = "with 95 % confidence, to first order in the parameters"
        return f"{where}, the {name} is {least} ({of})"
    if row.samples > 1:
        return f"{where}, the {name} is {least} for 97.5 % of the {_draws(row)}"
    return f"{where}, the {name} is {size} for {_whose(row)}"


def _partly_stable(row: MarginRow, unit: str) -> str:
    where = _where(row, unit)
    share = f"{100 * row.stable_share:.0f} %"
    if row.source == BAND:
        of = "to first order in the parameters"
        return f"{where}, the model's loop is stable with a probability of {share} ({of})"
    if row.samples > 1:
        return f"{where}, the loop is stable for {share} of the {_draws(row)}"
    return f"{where}, the loop of {_whose(row)} is stable with a probability of {share}"


def _where(row: MarginRow, unit: str) -> str:
    """Return the operating point of a row of margins, in words."""
    when = "" if row.time is None else f" and {row.time:.0f} s after the start"
    return f"at a constant input of {with_unit(three_digits(row.operating_input), unit)}{when}"


def _draws(row: MarginRow) -> str:
    """Return the draws from which a row comes, in words."""
    return "models drawn from the posterior" if row.source == "model" else f"draws of {_whose(row)}"


def _whose(row: MarginRow) -> str:
    """Return the source from which a margin comes, in words."""
    names = {"model": "the model", "plant": "the plant model"}
    for name, words in names.items():
        if row.source == name or row.source.startswith(f"{name} "):
            return row.source.replace(name, words, 1)
    return row.source


def _stable(rows: Sequence[MarginRow], unit: str) -> str:
    """Return the finding that all loops of one source are stable, in words."""
    if rows[0].source == BAND:
        where = _where(rows[0], unit)
        return f"{where}, the loop is stable for every response within the model's 95 % band (to first order in the parameters)"
    whose = _whose(rows[0])
    kind = "operating points" if all(row.time is None for row in rows) else "operating points and times"
    count = f" at all {len(rows)} {kind}" if len(rows) > 1 else ""
    if rows[0].samples == 1:
        return f"the loop is stable with {whose}{count}"
    each = "model drawn from the posterior" if rows[0].source == "model" else f"draw of {whose}"
    return f"the loop is stable{count}, with every {each}"


def _finding(subject: str, value: float, limit: Limit, text: str) -> Finding:
    verdict = limit.judge(value)
    if verdict is not Verdict.PASS:
        text = f"{text[:-1]}; required: {limit.wanted})" if text.endswith(")") else f"{text} (required: {limit.wanted})"
    return Finding(subject=subject, value=value, verdict=verdict, text=text, room=limit.room(value))
