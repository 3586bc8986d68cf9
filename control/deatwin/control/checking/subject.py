"""A controller with the models and plants on which it is judged, and its judgement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.amounts import three_digits
from deatwin.control.checking.cycles import judge_cycles
from deatwin.control.checking.result import Check
from deatwin.control.checking.rows import MarginRow, OperatingPoint, row_of_band, rows_of_family
from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.trial import Trial
from deatwin.control.checking.verdict import (
    Finding,
    Runs,
    judge_draws,
    judge_margins,
    judge_prediction,
    judge_raised,
    judge_runs,
    judge_width,
    late_rms_error,
    worst,
)
from deatwin.control.controllers.base import Controller
from deatwin.control.linear.family import linearise_many
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.plant import draw_plants, linearise_plants
from deatwin.control.linear.schedule import linearise_along
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.loop.predicted import PredictedLoop, predict_loop
from deatwin.control.progress import Progress, part
from deatwin.control.stability.bands import band_margins
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.narx import NarxModel, ThetaTrajectory
from deatwin.ident.narx.excited import Excitation
from deatwin.ident.narx.residual import Residual
from deatwin.plant.amplitudes import amount, written_amplitude
from deatwin.plant.arrays import Array
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.model import Plant
from deatwin.plant.rest_path import rest_under
from deatwin.plant.rigs.base import ReadingTime

STICKING = ("hysteresis", "coulomb_friction")
"""Effects that act as a spring or a damper on small motions, and do not affect the dynamics of large ones. Margins are
judged for both, because the loop meets both."""
PLANTS = 20  # Number of plants drawn from a calibration
FILMS = 8  # Number of plants, including the calibrated one, on which the film's limits are tested
TIME_SAMPLES = 50  # Number of draws at each time of a varying model


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject:
    """A controller with the models and plants on which it is judged."""

    model: NarxModel
    linear: LinearModel
    controller: Controller
    plant: CalibratedPlant
    others: Mapping[str, CalibratedPlant]
    rng: np.random.Generator
    samples: int
    points: Array
    specification: Specification
    residual: Residual | None
    excited: Excitation | None
    trajectory: ThetaTrajectory | None
    caveats: tuple[str, ...]

    @property
    def band_Hz(self) -> float | None:
        return None if self.excited is None else self.excited.highest_Hz

    def judged(self, progress: Progress | None) -> Check:
        """Return the findings: on margins first, then on the prediction, then on runs on the plant."""
        spec, linear = self.specification, self.linear
        trial = Trial(controller=self.controller, linear=self.linear, rng=self.rng)
        here, rows = self._model_rows()
        plants = draw_plants(self.plant, self.rng, PLANTS) if self.plant.names else ()
        physics = self._plant_rows("plant", (self.plant.plant, *plants))
        findings = [*_judged(rows, linear, spec), *_judged(physics, linear, spec)]
        crossovers = [row.crossover_Hz for row in rows]
        findings.append(judge_unknown_band() if self.excited is None else judge_band(crossovers, self.excited))
        predicted = self._predicted(trial.step_reference, part(progress, 0.1, 0.2))
        if predicted is not None:
            findings.append(judge_draws(predicted, spec))
            predicted = predicted if predicted.diverged < 1.0 else None
        if predicted is not None:
            findings.append(judge_width(predicted, trial.amplitude, spec))
        runs = trial.runs("plant", self.plant.plant, part(progress, 0.2, 0.4))
        sine_predicted = self._sine_error(trial, part(progress, 0.4, 0.5))
        findings += self._judged_runs(trial, runs, sine_predicted, self.plant.plant)
        if runs.steps.status.ok:
            findings += self._on_plant(trial, runs.steps, predicted, part(progress, 0.5, 0.7))
            tried = (self.plant.plant, *plants[: FILMS - 1])
            findings.append(judge_film("plant", tried, _commands(runs), self.controller))
        if (training := judge_training(self.model, self.points.tolist(), _commands(runs))) is not None:
            findings.append(training)
        seen, more = {}, list(physics)
        for number, (name, other) in enumerate(self.others.items()):
            table = self._plant_rows(name, (other.plant,))
            first, last = (0.7 + 0.3 * (number + i) / len(self.others) for i in (0, 1))
            steps = trial.runs(name, other.plant, part(progress, first, last))
            findings += [*_judged(table, linear, spec), *self._judged_runs(trial, steps, sine_predicted, other.plant)]
            if steps.steps.status.ok:
                findings.append(judge_film(name, (other.plant,), _commands(steps), self.controller))
            seen[name], more = steps.steps, [*more, *table]
        if progress is not None:
            progress(1.0)
        return Check(
            findings=tuple(findings),
            operating=OperatingPoint.of(self.linear),
            controller=self.controller,
            margins=here,
            table=(*rows, *more),
            excited_band_Hz=self.band_Hz,
            steps=runs.steps,
            sine=runs.sine,
            others=seen,
            predicted=predicted,
            sine_predicted=sine_predicted,
            caveats=self.caveats,
        )

    def _judged_runs(self, trial: Trial, runs: Runs, sine_predicted: float, plant: Plant) -> list[Finding]:
        """Return the findings on runs on a plant; the first says if the plant rests elsewhere than the model."""
        findings = list(judge_runs(runs, sine_predicted, self.specification.on_a_stand_in))
        c = self.controller
        if worst(findings).verdict is Verdict.PASS:
            return findings
        inputs = np.array([c.command_min, c.operating_input, c.command_max])
        rests = linearise_plants((plant,), inputs).operating_outputs[:, 0]
        apart = judge_rests(self.linear, trial.amplitude, rests, runs, worst(findings).verdict)
        return findings if apart is None else [apart, *findings]

    def _model_rows(self) -> tuple[MarginRow, tuple[MarginRow, ...]]:
        """Return margins at the controller's own operating point, and at all points and times."""
        reading = self.plant.plant.rig.reading
        thetas = np.vstack([self.model.theta, draw_theta(self.model, self.rng, self.samples)])
        family = linearise_many(self.model, self.points, thetas).in_loop(reading)
        rows = rows_of_family("model", family, self.controller)
        here = rows[int(np.flatnonzero(self.points == self.controller.operating_input)[0])]
        if here.gain > 0.0:  # otherwise the loop of the model itself is unstable, and has no band
            law = self.controller.local(self.controller.operating_input)
            rows = (*rows, row_of_band(band_margins(self.linear, *law.feedback), self.linear, here.crossover_Hz))
        if self.trajectory is None:
            return here, rows
        return here, (*rows, *self._along(self.trajectory, reading))

    def _along(self, trajectory: ThetaTrajectory, reading: ReadingTime) -> tuple[MarginRow, ...]:
        """Return margins at each time of a varying model."""
        along = linearise_along(
            trajectory, self.controller.operating_input, rng=self.rng, samples=min(self.samples, TIME_SAMPLES)
        )
        return rows_of_family("model", along.family.in_loop(reading), self.controller, along.timepts.tolist())

    def _plant_rows(self, source: str, plants: tuple[Plant, ...]) -> tuple[MarginRow, ...]:
        """Return margins for small motions and, if the plant has friction, also for large ones."""
        reading = plants[0].rig.reading
        small = rows_of_family(source, linearise_plants(plants, self.points).in_loop(reading), self.controller)
        sticking = [name for name in STICKING if name in plants[0].effect_names]
        if not sticking:
            return small
        loose = linearise_plants(tuple(plant.without_effects(*sticking) for plant in plants), self.points)
        return (*small, *rows_of_family(f"{source} in large motions", loose.in_loop(reading), self.controller))

    def _sine_error(self, trial: Trial, progress: Progress | None) -> float:
        """Return the rms error that the model predicts for the sine; by its linear part if its residual is unknown."""
        predicted = self._predicted(trial.sine_reference, progress)
        if predicted is None or predicted.diverged == 1.0:
            return trial.sine_error()
        return predicted.interval(late_rms_error)[0]

    def _predicted(self, reference: Array, progress: Progress | None) -> PredictedLoop | None:
        if self.residual is None:
            return None
        rig = self.plant.plant.rig
        return predict_loop(
            self.model,
            self.controller,
            reference,
            reading=rig.reading,
            residual=self.residual,
            noise=rig.noise,
            rng=self.rng,
            progress=progress,
        )

    def _on_plant(
        self, trial: Trial, steps: ClosedLoop, predicted: PredictedLoop | None, progress: Progress | None
    ) -> list[Finding]:
        """Return further findings for a plant that survived the steps."""
        spec, plant = self.specification, self.plant.plant
        factors = (spec.gain.poor, spec.gain.good)
        raised = [
            (factor, trial.raised(plant, factor, part(progress, 0.25 * n, 0.25 * (n + 1))))
            for n, factor in enumerate(factors)
        ]
        cycles = judge_cycles(
            plant, self.controller, self.linear, trial.amplitude, spec, progress=part(progress, 0.5, 1.0)
        )
        found = [judge_raised(raised, spec), cycles]
        if predicted is not None:
            found.append(judge_prediction(predicted, steps, spec))
        return found


def _commands(runs: Runs) -> Array:
    """Return the commands of all runs, one after another."""
    return np.concatenate([runs.steps.command, runs.sine.command])


def _judged(rows: Sequence[MarginRow], linear: LinearModel, specification: Specification) -> list[Finding]:
    """Return the findings on the margins of each source."""
    sources = dict.fromkeys(row.source for row in rows)
    return [
        finding
        for source in sources
        for finding in judge_margins([row for row in rows if row.source == source], linear, specification)
    ]


_HOLD = 2.0  # Time at the largest command, and at the smallest one, s


def judge_band(crossovers_Hz: Sequence[float], excited: Excitation) -> Finding:
    """Judge whether the recording excited the crossover frequencies of the model's loops, Hz."""
    crossover, band = max(crossovers_Hz), excited.highest_Hz
    if crossover > band:
        text = (
            f"the highest crossover frequency is {crossover:.2f} Hz, but the recording excited the actuator only up to "
            f"{band:.2f} Hz, so the margins are extrapolated; record with an input up to {2 * crossover:.2g} Hz"
        )
        return Finding(subject="excitation", value=crossover, verdict=Verdict.MARGINAL, text=text)
    for inside in sorted(crossovers_Hz, reverse=True):
        if (hole := excited.hole_at(inside)) is not None:
            low, high = hole
            text = (
                f"a crossover frequency is {inside:.2g} Hz, but the input of the recording has no power from {low:.2g} to "
                f"{high:.2g} Hz, so the margins are extrapolated; record with an input that has power there, such as noise "
                f"up to {max(2 * inside, band):.2g} Hz"
            )
            return Finding(subject="excitation", value=inside, verdict=Verdict.MARGINAL, text=text)
    text = (
        f"the recording excited the actuator up to {band:.2f} Hz, and the highest crossover frequency is only "
        f"{crossover:.2f} Hz"
    )
    return Finding(subject="excitation", value=crossover, verdict=Verdict.PASS, text=text)


def judge_rests(
    linear: LinearModel, amplitude: float, rests: NDArray[np.float64], runs: Runs, verdict: Verdict
) -> Finding | None:
    """Return a finding if the plant's positions at rest, `rests` (3,), do not allow it to follow the references."""
    centre = linear.operating_output
    if centre is None or not np.isfinite(rests).all():
        return None
    if rests.min() <= centre - amplitude and centre + amplitude <= rests.max():
        return None
    unit, size = written_amplitude(linear.output_unit)
    text = (
        f"at a constant input of {amount(three_digits(linear.operating_input), linear.input_unit)} the model's output is "
        f"{centre / size:.3g} {unit} and the plant's is {rests[1] / size:.3g} {unit}, a difference of "
        f"{abs(centre - rests[1]) / size:.3g} {unit}; within the limits of the command, the plant reaches only "
        f"{rests.min() / size:.3g} to {rests.max() / size:.3g} {unit}, so it cannot follow the steps planned with the model"
    )
    return Finding(subject=runs.subject("operating point"), value=float(rests[1] - centre), verdict=verdict, text=text)


def judge_training(model: NarxModel, points: Sequence[float], commands: NDArray[np.float64]) -> Finding | None:
    """Judge whether the loop stays where the model was trained. Shapes: `commands` (n,)."""
    if model.operating is None:
        return None
    low, high = float(model.operating.input_min[0]), float(model.operating.input_max[0])
    least, most = min(*points, *commands), max(*points, *commands)
    outside, unit = least < low or most > high, model.input_units[0]
    text = (
        f"the closed loop uses commands from {amount(f'{three_digits(least)} to {three_digits(most)}', unit)}, "
        f"{'beyond' if outside else 'inside'} the range of the training data, {amount(f'{three_digits(low)} to {three_digits(high)}', unit)}"
    )
    verdict = Verdict.MARGINAL if outside else Verdict.PASS
    return Finding(subject="training data", value=None, verdict=verdict, text=text)


def judge_unknown_band() -> Finding:
    """Return the finding for a recording whose excited band is unknown."""
    text = (
        "it is unknown up to which frequency the recording excited the actuator; give the recording (--recording), or a "
        "model from `deatwin identify`, which states this frequency"
    )
    return Finding(subject="excitation", value=None, verdict=Verdict.MARGINAL, text=text)


def judge_film(source: str, plants: Sequence[Plant], commands: NDArray[np.float64], controller: Controller) -> Finding:
    """Judge whether the film tolerates the commands of the controller, given and possible. Shapes: `commands` (n,)."""
    # A run may jump across a pull-in within a sample, so the plant must also have a state of rest at the largest and at
    # the smallest command.
    from deatwin.ident.mismatch.advise.waveforms import HEADROOM, bears  # importing it takes half a second

    rig = plants[0].rig
    rest = rig.start.rest_command
    used = sum(not (_rests(plant, commands, HEADROOM) and bears(plant, commands, rest)) for plant in plants)
    own = "the plant model" if source == "plant" else source
    many = len(plants) > 1
    who = f"of {len(plants)} simulated actuators (parameters within the calibration's intervals)" if many else ""
    who += f" of {source}" if many and source != "plant" else ""
    subject = "film" if source == "plant" else f"film ({source})"

    def film(of: int) -> str:
        return f"in {of} {who}, the film" if many else f"the film in {own}"

    if used:
        text = f"{film(used)} would pull in, break down or lose tension with {100 * (HEADROOM - 1):.0f} % more voltage"
        return Finding(subject=subject, value=float(used), verdict=Verdict.FAIL, text=text)
    count = max(round(_HOLD / rig.sample_time), 2)
    ends = np.repeat([controller.command_max, controller.command_min], count)
    lost = sum(not (_rests(plant, ends, 1.0) and bears(plant, ends, rest, headroom=1.0)) for plant in plants)
    if lost:
        text = f"{film(lost)} would pull in, break down or lose tension if the command reached the controller's limits"
        return Finding(subject=subject, value=float(lost), verdict=Verdict.MARGINAL, text=text)
    none = f"in none {who} does the film" if many else f"the film in {own} does not"
    text = f"{none} pull in, break down or lose tension, even if the command reaches the controller's limits"
    return Finding(subject=subject, value=0.0, verdict=Verdict.PASS, text=text)


def _rests(plant: Plant, commands: NDArray[np.float64], headroom: float) -> bool:
    """Return whether a plant has a state of rest at the largest and at the smallest command."""
    rest = plant.rig.start.rest_command
    ends = rest + headroom * (np.array([commands.min(), commands.max()]) - rest)
    return all(rest_under(plant, float(end)) is not None for end in ends)
