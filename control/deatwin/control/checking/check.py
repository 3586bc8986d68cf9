"""Would a controller designed on an identified model survive the actuator? Margins, closed loop, verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import finite, function, generator, instance, numbers, pair, positive, taking, whole
from deatwin.control.checking.cycles import judge_cycles
from deatwin.control.checking.designed import SAME, Design, UndesignedError, designed
from deatwin.control.checking.film import judge_film
from deatwin.control.checking.given import (
    integral_only,
    known_caveats,
    known_excitation,
    known_residual,
    require_controller,
    require_inside,
    require_laws,
    require_limits,
    require_others,
    require_pair,
    trained_range,
)
from deatwin.control.checking.operating import OperatingPoint
from deatwin.control.checking.result import Check
from deatwin.control.checking.rows import MarginRow, row_of_band, rows_of_family
from deatwin.control.checking.scope import judge_band, judge_training, judge_unknown_band
from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.trial import STEP_SHARE, Trial, require_short_runs
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
)
from deatwin.control.controllers.base import Controller
from deatwin.control.design.lambda_tuning import lambda_tuning
from deatwin.control.errors import ControlError
from deatwin.control.linear.family import draw, linearise_many
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.narx import linearise
from deatwin.control.linear.plant import draw_plants, linearise_plants
from deatwin.control.linear.varying import linearise_along
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.loop.predicted import PredictedLoop, predict_loop
from deatwin.control.loop.residual import DivergedError, Residual
from deatwin.control.progress import Progress, part
from deatwin.control.stability.bands import band_margins
from deatwin.control.stability.excited import Excitation
from deatwin.ident.frequency.checks import real_numbers
from deatwin.ident.narx import NarxModel, ThetaTrajectory
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.model import Plant
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime

Array = NDArray[np.float64]

STICKING = ("hysteresis", "coulomb_friction")
"""Effects that are a spring or a damper to small motions and nothing to the dynamics of large ones: the loop meets
both."""
POINTS = 5
"""Operating points at which margins are judged, where none are given."""
PLANTS = 20
"""Plants drawn from a calibration."""
TIME_SAMPLES = 50
"""Draws at each time of a model that varies."""
FILMS = 8
"""Of them, those on which the film's limits are tried."""


@taking(
    model=instance(NarxModel),
    plant=instance(Plant, CalibratedPlant),
    rng=generator,
    design=function,
    operating_input=finite,
    operating_inputs=numbers,
    closed_loop_time=positive,
    command_limits=pair,
    recording=instance(Recording),
    specification=instance(Specification),
    others=require_others,
    trajectory=instance(ThetaTrajectory),
    samples=whole(1),
    progress=function,
)
def check(
    model: NarxModel,
    plant: Plant | CalibratedPlant,
    *,
    rng: np.random.Generator,
    design: Design | None = None,
    controller: Controller | None = None,
    operating_input: float | None = None,
    operating_inputs: ArrayLike | None = None,
    closed_loop_time: float | None = None,
    command_limits: tuple[float, float] | None = None,
    recording: Recording | None = None,
    specification: Specification | None = None,
    others: Mapping[str, Plant | CalibratedPlant] | None = None,
    trajectory: ThetaTrajectory | None = None,
    samples: int = 200,
    progress: Progress | None = None,
) -> Check:
    """Design a controller on an identified model and judge it, on the model's posterior and on physics plants.

    Parameters
    ----------
    model : NarxModel
        Identified from recordings of the actuator.
    plant : Plant or CalibratedPlant
        The physics that stands for the actuator; of a calibrated one, draws of its parameters count as well.
    rng : numpy.random.Generator
        Source of draws and sensor noise.
    design : callable, optional
        Makes the controller from the model as it sees it and ``command_limits``; `lambda_tuning` by default.
    controller : Controller, optional
        To be judged instead of a designed one; its operating input counts.
    operating_input : float, optional
        At which the loop is closed, in the input's unit; the centre of the training data by default.
    operating_inputs : array_like, shape (n,), optional
        Operating points at which margins are judged, in the input's unit, beside the controller's own; by default
        five over the range in which the references of the check move.
    closed_loop_time : float, optional
        Lambda of the default design, s; see `lambda_tuning`.
    command_limits : (float, float), optional
        Least and largest command, in its unit; the range of the training data by default.
    recording : Recording, optional
        From which the model was identified: tells the excited band, and how large the residual of the model's
        free run is. Without it the model's provenance may tell them; what is not known is not judged.
    specification : Specification, optional
        What is asked; the textbooks' margins by default.
    others : mapping of str to Plant or CalibratedPlant, optional
        Further plants that the actuator may be: with effects that a diagnosis could not tell apart, or other
        actuators of a fleet. They are judged like the plant.
    trajectory : ThetaTrajectory, optional
        Of the model's parameters, where they vary in time: margins are judged along it.
    samples : int
        Number of draws from the model's posterior.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Check
        Where no controller can be designed, or the model's free run diverges on the recording, it fails with the
        reason.

    Raises
    ------
    ModelError
        If model and plants do not belong together, or the operating input lies outside the training data.
    ControlError
        If an argument is of another kind, the limits of the command make no sense, the controller is none, has another
        sample time or so long a closed-loop time that its runs have no end, or the design or the controller's `local`
        raises what is no error of deatwin's (chained) or returns something else.
    """
    if controller is not None:
        require_controller(controller, model)
    known = _known(plant)
    everyone = {name: _known(other) for name, other in (others or {}).items()}
    for one in (known, *everyone.values()):
        require_pair(model, one.plant)
    linear = linearise(model, operating_input if controller is None else controller.operating_input)
    require_inside(model, [linear.operating_input])
    caveats = known_caveats(model)
    refused = partial(_refused, caveats=caveats)
    if not linear.status.ok:
        return refused(linear, "model", linear.status.value + (f" ({linear.detail})" if linear.detail else ""))
    asked = controller is None
    try:
        excited, residual = known_excitation(model, recording), known_residual(model, recording)
    except DivergedError as error:
        return refused(linear, "model", str(error))
    seen = linear.in_loop(known.plant.rig.reading)
    if controller is None:
        band = None if excited is None else excited.highest_Hz
        limits = trained_range(model) if command_limits is None else command_limits
        require_limits(limits, seen)
        chosen = partial(lambda_tuning, closed_loop_time=closed_loop_time, band_Hz=band) if design is None else design
        try:
            controller = designed(chosen, seen, limits)
        except UndesignedError as error:
            return refused(seen, "design", str(error))
    require_short_runs(controller)
    points = _points(model, controller, operating_inputs)
    require_laws(controller, [controller.operating_input, *points])
    subject = _Subject(
        model=model,
        linear=seen,
        controller=controller,
        plant=known,
        others=everyone,
        rng=rng,
        samples=samples,
        points=points,
        specification=specification or Specification(),
        residual=residual,
        excited=excited,
        trajectory=trajectory,
        caveats=(*caveats, *(integral_only(controller) if asked else ())),
    )
    return subject.judged(progress)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Subject:
    """A controller with all that it is judged on."""

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
        """Margins first, then the prediction, then the physics."""
        spec, h = self.specification, self.linear.sample_time
        trial = Trial(controller=self.controller, linear=self.linear, rng=self.rng)
        here, rows = self._model_rows()
        plants = draw_plants(self.plant, self.rng, PLANTS) if self.plant.names else ()
        physics = self._plant_rows("plant", (self.plant.plant, *plants))
        findings = [*_judged(rows, h, spec), *_judged(physics, h, spec)]
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
        findings += judge_runs(runs, sine_predicted, spec.on_a_stand_in)
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
            findings += [*_judged(table, h, spec), *judge_runs(steps, sine_predicted, spec.on_a_stand_in)]
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

    def _model_rows(self) -> tuple[MarginRow, tuple[MarginRow, ...]]:
        """Margins at the controller's own point, and at all points and times."""
        reading = self.plant.plant.rig.reading
        thetas = np.vstack([self.model.theta, draw(self.model, self.rng, self.samples)])
        family = linearise_many(self.model, self.points, thetas).in_loop(reading)
        rows = rows_of_family("model", family, self.controller)
        here = rows[int(np.flatnonzero(self.points == self.controller.operating_input)[0])]
        if here.gain > 0.0:  # else the loop of the model itself is unstable and has no band
            law = self.controller.local(self.controller.operating_input)
            rows = (*rows, row_of_band(band_margins(self.linear, *law.feedback), self.linear, here.crossover_Hz))
        if self.trajectory is None:
            return here, rows
        return here, (*rows, *self._along(self.trajectory, reading))

    def _along(self, trajectory: ThetaTrajectory, reading: ReadingTime) -> tuple[MarginRow, ...]:
        """Margins along time."""
        along = linearise_along(
            trajectory, self.controller.operating_input, rng=self.rng, samples=min(self.samples, TIME_SAMPLES)
        )
        return rows_of_family("model", along.family.in_loop(reading), self.controller, along.timepts.tolist())

    def _plant_rows(self, source: str, plants: tuple[Plant, ...]) -> tuple[MarginRow, ...]:
        """Margins for small motions, and, where something sticks, for large ones as well."""
        reading = plants[0].rig.reading
        small = rows_of_family(source, linearise_plants(plants, self.points).in_loop(reading), self.controller)
        sticking = [name for name in STICKING if name in plants[0].effect_names]
        if not sticking:
            return small
        loose = linearise_plants(tuple(plant.without_effects(*sticking) for plant in plants), self.points)
        return (*small, *rows_of_family(f"{source} in large motions", loose.in_loop(reading), self.controller))

    def _sine_error(self, trial: Trial, progress: Progress | None) -> float:
        """Rms error on the sine that the model predicts; by its linear part where no residual is known."""
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
        """What more is judged where the plant lived through the steps."""
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
    """All commands of the runs."""
    return np.concatenate([runs.steps.command, runs.sine.command])


def _judged(rows: Sequence[MarginRow], sample_time: float, specification: Specification) -> list[Finding]:
    """Findings on the margins of each source in the rows."""
    sources = dict.fromkeys(row.source for row in rows)
    return [
        finding
        for source in sources
        for finding in judge_margins([row for row in rows if row.source == source], sample_time, specification)
    ]


def _refused(linear: LinearModel, subject: str, text: str, *, caveats: tuple[str, ...]) -> Check:
    finding = Finding(subject=subject, value=None, verdict=Verdict.FAIL, text=text)
    return Check(findings=(finding,), operating=OperatingPoint.of(linear), caveats=caveats)


def _known(plant: Plant | CalibratedPlant) -> CalibratedPlant:
    return plant if isinstance(plant, CalibratedPlant) else CalibratedPlant.nominal(plant)


def _points(model: NarxModel, controller: Controller, operating_inputs: ArrayLike | None) -> Array:
    """Operating inputs at which margins are judged, the controller's own among them; each once."""
    c = controller
    if operating_inputs is not None:
        points = real_numbers(operating_inputs, "operating_inputs").ravel()
        if points.size == 0 or not np.all(np.isfinite(points)):
            raise ControlError("operating_inputs must be one or more finite numbers")
        require_inside(model, points.tolist())
    else:
        room = STEP_SHARE * min(c.operating_input - c.command_min, c.command_max - c.operating_input)
        points = np.linspace(c.operating_input - room, c.operating_input + room, POINTS)
    # The middle of a range is the operating input but for its last digit.
    others = points[np.abs(points - c.operating_input) > SAME * (c.command_max - c.command_min)]
    return np.unique(np.append(others, c.operating_input))
