"""Would a controller designed on an identified model survive the actuator? Margins, closed loop, verdict."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import finite, function, generator, instance, numbers, pair, positive, taking, whole
from deatwin.control.checking.given import (
    SAME,
    Design,
    UndesignedError,
    designed,
    integral_only,
    known_caveats,
    known_excitation,
    known_residual,
    require_controller,
    require_effect,
    require_inside,
    require_laws,
    require_limits,
    require_others,
    require_pair,
    trained_range,
)
from deatwin.control.checking.result import Check
from deatwin.control.checking.rows import OperatingPoint
from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.subject import Subject
from deatwin.control.checking.trial import STEP_SHARE, require_short_runs
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.base import Controller, room_of
from deatwin.control.design.lambda_tuning import lambda_tuning
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.narx import linearise
from deatwin.control.progress import Progress
from deatwin.ident.arguments import real_numbers
from deatwin.ident.narx import NarxModel, ThetaTrajectory
from deatwin.ident.narx.residual import DivergedError
from deatwin.plant.arrays import Array
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.model import Plant
from deatwin.plant.recording import Recording

POINTS = 5  # Number of operating points at which margins are judged if none are given


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
    """Design a controller on an identified model, and judge the controller on the uncertain model and on plants.

    Parameters
    ----------
    model : NarxModel
        Model identified from recordings of the actuator.
    plant : Plant or CalibratedPlant
        Physics model that stands for the actuator. If the plant is calibrated, the controller is also judged on draws
        of the plant's parameters.
    rng : numpy.random.Generator
        Random generator for all draws of parameters and for the sensor noise.
    design : callable, optional
        Function that returns a controller, called as ``design(linear, command_limits=(low, high))``; `lambda_tuning`
        by default. ``linear`` is the linearised model with the delay of the loop (`LinearModel.in_loop`).
    controller : Controller, optional
        Existing controller to judge instead of designing one. The loop is then closed at the controller's operating
        input; `design`, `operating_input`, `closed_loop_time` and `command_limits` cannot be given.
    operating_input : float, optional
        Constant input about which the loop is closed, in its unit; the mean of the training inputs by default.
    operating_inputs : array_like, shape (n,), optional
        Further constant inputs at which margins are judged, in the input's unit. By default five, evenly spaced over
        the commands that the simulated references need. The controller's operating input is always included.
    closed_loop_time : float, optional
        Desired time constant lambda of the closed loop for the default design, s; see `lambda_tuning`. For another
        design, give ``design=partial(lqg, closed_loop_time=0.5)``.
    command_limits : (float, float), optional
        Least and largest command, in its unit; the range of the training data by default.
    recording : Recording, optional
        Recording from which the model was identified. The excited band and the size of the free-run residual are
        computed from the recording. Without a recording, both are read from ``model.provenance``. If the band is
        unknown, the verdict is at best marginal. If the residual is unknown, the model's prediction is not judged.
    specification : Specification, optional
        Requirements on the closed loop; by default ``Specification()``, with margins that textbooks recommend.
    others : mapping of str to Plant or CalibratedPlant, optional
        Further plants, by name, such as alternative explanations from a diagnosis or other actuators of a fleet. The
        controller's margins and simulated runs are judged on these plants, too, with their nominal parameters.
    trajectory : ThetaTrajectory, optional
        Trajectory of the parameters of a time-varying model; margins are then judged along the trajectory, too.
    samples : int
        Number of draws of the model's parameters from their posterior, on which margins are judged.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1.

    Returns
    -------
    Check
        Result of the check. The verdict is ``FAIL``, with the reason, if no controller can be designed or if the
        model's free run diverges on the recording.

    Raises
    ------
    ModelError
        If model, plants and recording do not belong together, for example because units or sampling times differ, or
        if an operating input lies outside the training data.
    ControlError
        If an argument is invalid, if the closed-loop time is too long to be simulated, or if the user's `design` or
        `Controller.local` returns a wrong type or raises a foreign exception (which is chained).
    """
    if controller is not None:
        require_controller(controller, model)
    require_effect(
        controller,
        design,
        operating_input=operating_input,
        closed_loop_time=closed_loop_time,
        command_limits=command_limits,
    )
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
    subject = Subject(
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


def _refused(linear: LinearModel, subject: str, text: str, *, caveats: tuple[str, ...]) -> Check:
    finding = Finding(subject=subject, value=None, verdict=Verdict.FAIL, text=text)
    return Check(findings=(finding,), operating=OperatingPoint.of(linear), caveats=caveats)


def _known(plant: Plant | CalibratedPlant) -> CalibratedPlant:
    return plant if isinstance(plant, CalibratedPlant) else CalibratedPlant.nominal(plant)


def _points(model: NarxModel, controller: Controller, operating_inputs: ArrayLike | None) -> Array:
    """Return the operating inputs at which margins are judged, each once, including that of the controller."""
    c = controller
    if operating_inputs is not None:
        points = real_numbers(operating_inputs, "operating_inputs").ravel()
        if points.size == 0 or not np.all(np.isfinite(points)):
            raise ControlError("operating_inputs must be one or more finite numbers")
        require_inside(model, points.tolist())
    else:
        room = STEP_SHARE * room_of(c)
        points = np.linspace(c.operating_input - room, c.operating_input + room, POINTS)
    # The middle of the range equals the operating input except in its last digits.
    others = points[np.abs(points - c.operating_input) > SAME * (c.command_max - c.command_min)]
    return np.unique(np.append(others, c.operating_input))
