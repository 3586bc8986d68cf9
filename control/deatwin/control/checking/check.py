"""Would a controller designed on an identified model survive the actuator? Margins, closed loop, verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from deatwin.control.checking.checkfile import SCHEMA, from_document, to_document
from deatwin.control.checking.promise import LoopMargins, OperatingPoint, loop_margins
from deatwin.control.checking.trial import Trial
from deatwin.control.checking.verdict import GAIN, Finding, Verdict, judge_band, judge_margins, judge_plant, worst
from deatwin.control.design.lambda_tuning import PiController, lambda_tuning
from deatwin.control.linear.narx import linearise, linearise_posterior
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.stability.excited import BAND_KEY, excited_band
from deatwin.ident.narx import NarxModel
from deatwin.plant.documents import read_document, write_document
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Check", "check"]

Progress = Callable[[float], None]

_POSTERIOR_SHARE = 0.3  # of the time, as far as progress is concerned


@dataclass(frozen=True, kw_only=True, eq=False)
class Check:
    """What the check found.

    Parameters
    ----------
    findings : tuple of Finding
        All that was judged; the most severe one decides.
    operating : OperatingPoint
        Where the model was linearised.
    controller : PiController or None
        None where none could be designed; so for all that follows.
    margins : LoopMargins or None
        What the model promises.
    excited_band_Hz : float or None
        Band that the recording excited, Hz; None where it is not known.
    steps, sine : ClosedLoop or None
        Runs on the physics plant.
    sine_predicted : float or None
        Rms error on the sine that the model predicts, in the output's unit.
    """

    findings: tuple[Finding, ...]
    operating: OperatingPoint
    controller: PiController | None = None
    margins: LoopMargins | None = None
    excited_band_Hz: float | None = None
    steps: ClosedLoop | None = None
    sine: ClosedLoop | None = None
    sine_predicted: float | None = None

    @property
    def verdict(self) -> Verdict:
        """The verdict of the worst finding."""
        return self.worst_case.verdict

    @property
    def worst_case(self) -> Finding:
        """The finding that decides."""
        return worst(self.findings)

    @property
    def reason(self) -> str:
        """The texts of all findings that are as severe as the verdict, if it is not `pass`."""
        if self.verdict is Verdict.PASS:
            return "every limit is kept"
        return "; ".join(f.text for f in self.findings if f.verdict is self.verdict)

    @property
    def sentence(self) -> str:
        """The check in one plain sentence; every number in it is a field of the file."""
        if self.controller is None or self.margins is None:
            return f"{self.verdict.value}: {self.reason}."
        tuned, promised, at = self.controller, self.margins, self.operating
        kind = "a PI controller" if tuned.proportional else "an integral controller"
        return (
            f"{self.verdict.value}: {kind} with a closed-loop time of {tuned.closed_loop_time:.2g} s at "
            f"{at.input:.3g} {at.input_unit} (crossover {promised.crossover_Hz:.2g} Hz, gain margin "
            f"{promised.gain_low:.2g}, phase margin {promised.phase_low_deg:.0f}°): {self.reason}."
        )

    def save(self, path: str | Path) -> None:
        """Write the check as JSON ("deatwin/check/1"), beside the target first and then renamed.

        Parameters
        ----------
        path : str or Path
            File to write.
        """
        write_document(path, to_document(self))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a check that `save` wrote.

        Parameters
        ----------
        path : str or Path
            File to read.

        Returns
        -------
        Check

        Raises
        ------
        ModelError
            If the file is missing, not JSON, of another schema, or malformed.
        """
        return read_document(path, SCHEMA, lambda document: cls(**from_document(document)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the step reference and what the physics plant made of it.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        if self.steps is not None:
            self.steps.plot(axes)
        axes.set_title(f"{self.verdict.value}: {self.worst_case.text}", fontsize="small", wrap=True)
        return axes


def check(
    model: NarxModel,
    plant: Plant,
    *,
    rng: np.random.Generator,
    operating_input: float | None = None,
    controller: PiController | None = None,
    closed_loop_time: float | None = None,
    command_limits: tuple[float, float] | None = None,
    recording: Recording | None = None,
    samples: int = 200,
    progress: Progress | None = None,
) -> Check:
    """Design a controller on an identified model and judge it, on the model's posterior and on the plant.

    Parameters
    ----------
    model : NarxModel
        Identified from recordings of the actuator.
    plant : Plant
        The physics that stands for the actuator.
    rng : numpy.random.Generator
        Source of posterior samples and sensor noise.
    operating_input : float, optional
        In the input's unit; the centre of the training data by default.
    controller : PiController, optional
        To be judged instead of the one of `lambda_tuning`; its operating input counts.
    closed_loop_time : float, optional
        Lambda, s; see `lambda_tuning` for the default.
    command_limits : (float, float), optional
        Least and largest command, in its unit; the range of the training data by default.
    recording : Recording, optional
        From which the model was identified: tells the excited band. Without it the model's provenance may
        tell it, under the key `BAND_KEY`; else it is not judged.
    samples : int
        Number of posterior samples.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Check

    Raises
    ------
    ModelError
        If model and plant do not belong together, or the operating input lies outside the training data.
    ControlError
        If limits or closed-loop time make no sense.
    """
    if samples < 1:
        raise ModelError(f"samples = {samples}; it must be at least 1")
    _require_pair(model, plant)
    linear = linearise(model, operating_input if controller is None else controller.operating_input)
    _require_inside(model, linear.operating_input)
    if not linear.status.ok:
        text = linear.status.value + (f" ({linear.detail})" if linear.detail else "")
        finding = Finding(subject="model", value=None, verdict=Verdict.FAIL, text=text)
        return Check(findings=(finding,), operating=OperatingPoint.of(linear))
    band = _known_band(model, recording)
    reading = plant.rig.reading
    linear = linear.in_loop(reading)
    if controller is None:
        limits = _trained_range(model) if command_limits is None else command_limits
        controller = lambda_tuning(
            linear, command_limits=limits, closed_loop_time=closed_loop_time, band_Hz=band
        )
    posterior = linearise_posterior(
        model, linear.operating_input, rng, samples, _part(progress, 0.0, _POSTERIOR_SHARE)
    )
    promised = loop_margins(linear, [sample.in_loop(reading) for sample in posterior], controller)
    return _tried(
        Trial(plant=plant, controller=controller, linear=linear, rng=rng), promised, band,
        _part(progress, _POSTERIOR_SHARE, 1.0),
    )  # fmt: skip


def _tried(trial: Trial, promised: LoopMargins, band_Hz: float | None, progress: Progress | None) -> Check:
    """Run the trials on the plant and judge everything."""
    steps = trial.steps(1.0, _part(progress, 0.0, 0.25))
    sine = trial.sine(_part(progress, 0.25, 0.5))
    harder = (
        trial.steps(GAIN.poor, _part(progress, 0.5, 0.75)),
        trial.steps(GAIN.good, _part(progress, 0.75, 1.0)),
    )
    predicted = trial.sine_error()
    return Check(
        findings=(
            *judge_margins(promised, trial.linear.sample_time),
            *(() if band_Hz is None else (judge_band(promised.crossover_Hz, band_Hz),)),
            *judge_plant(steps, sine, predicted, ((GAIN.poor, harder[0]), (GAIN.good, harder[1]))),
        ),
        operating=OperatingPoint.of(trial.linear),
        controller=trial.controller,
        margins=promised,
        excited_band_Hz=band_Hz,
        steps=steps,
        sine=sine,
        sine_predicted=predicted,
    )


def _require_pair(model: NarxModel, plant: Plant) -> None:
    rig = plant.rig
    if abs(model.sample_time / rig.sample_time - 1.0) > 1e-6:
        raise ModelError(
            f"the model is sampled every {model.sample_time:g} s, the rig every {rig.sample_time:g} s; a "
            "NARX model is not resampled: identify it at the rig's rate, or correct sample_rate_Hz in the "
            "rig file"
        )
    if "deviations_from" in model.provenance:
        raise ModelError(
            f"the model is one of deviations from {model.provenance['deviations_from']}; give the model with "
            "its operating point, as it was identified"
        )
    for signal, unit, known in (
        ("input", model.input_units[0], rig.input_unit), ("output", model.output_units[0], rig.output_unit)
    ):  # fmt: skip
        if unit and unit != known:
            raise ModelError(f"the model's {signal} is in {unit}, the rig's in {known}")


def _require_inside(model: NarxModel, operating_input: float) -> None:
    if model.operating is None:
        return
    low, high = float(model.operating.input_min[0]), float(model.operating.input_max[0])
    if not low <= operating_input <= high:
        raise ModelError(
            f"the operating input {operating_input:g} lies outside of the training data, "
            f"{low:g} to {high:g} {model.input_units[0]}"
        )


def _trained_range(model: NarxModel) -> tuple[float, float]:
    if model.operating is None:
        raise ModelError("the model does not know the range of its training data: give command_limits")
    return float(model.operating.input_min[0]), float(model.operating.input_max[0])


def _known_band(model: NarxModel, recording: Recording | None) -> float | None:
    if recording is not None:
        return excited_band(recording)
    written = model.provenance.get(BAND_KEY)
    try:
        return None if written is None else float(written)
    except ValueError:
        text = f"the model's provenance has {BAND_KEY} = {written!r}: it must be a number"
        raise ModelError(text) from None


def _part(progress: Progress | None, first: float, last: float) -> Progress | None:
    """Progress of a part of the work, as a share of the whole."""
    if progress is None:
        return None
    return lambda share: progress(first + (last - first) * share)
