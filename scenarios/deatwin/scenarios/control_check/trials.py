"""A random rig, a random design, a check, and then the truth: did the verdict keep its word?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from deatwin.control.checking.check import check
from deatwin.control.checking.result import Check
from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.trial import Trial
from deatwin.control.checking.verdict import judge_runs, worst
from deatwin.control.controllers.base import Controller
from deatwin.control.design.inverse import static_curve, with_inverse
from deatwin.control.design.lambda_tuning import lambda_tuning
from deatwin.control.design.loop_shaping import loop_shaping
from deatwin.control.design.lqg import lqg
from deatwin.control.design.pid import Limits
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.narx import linearise
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import DeatwinError
from deatwin.scenarios.control_check.calibration import calibrated
from deatwin.scenarios.control_check.rigs import LIMITS, Bench, identified, random_bench


def _pi(model: NarxModel, time: float, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return lambda_tuning(linear, command_limits=command_limits, closed_loop_time=time)


def _shaped(model: NarxModel, time: float, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return loop_shaping(linear, command_limits=command_limits, crossover_Hz=1.0 / (2 * np.pi * time))


def _lqg(model: NarxModel, time: float, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return lqg(linear, command_limits=command_limits, closed_loop_time=time)


def _inverse(model: NarxModel, time: float, linear: LinearModel, *, command_limits: Limits) -> Controller:
    curve = static_curve(model, command_limits)
    return with_inverse(linear, curve, partial(lambda_tuning, closed_loop_time=time), command_limits=command_limits)


DESIGNS: Mapping[str, Callable[..., Controller]] = {
    "lambda tuning": _pi,
    "loop shaping": _shaped,
    "LQG": _lqg,
    "inverse": _inverse,
}
"""Each takes the NARX model, the closed-loop time in s, and what a design of a check takes."""


NO_MODEL = "no model"
"""Verdict of a trial whose recording gave no model to design on, or none of the physics to check it on."""
_NOTHING: dict[str, Any] = {"inside": None, "sound": None, "truth": "no controller"}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a design."""

    number: int
    concealed: str  # Effect that the specification does not have; empty without one
    design: str  # How the controller was designed
    closed_loop_time: float  # That was asked for, s
    band_Hz: float  # That the recording excited, Hz
    verdict: str
    reason: str
    inside: float | None
    sound: bool | None  # Whether the true rig kept every limit on its runs; None where there was no controller
    truth: str  # What was worst on the true rig

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Outcome:
        """The outcome that `to_dict` described."""
        return cls(**data)


def try_one(number: int, seed: int) -> Outcome:
    """Fabricate a rig, identify and calibrate it, design, check, and run the design on the truth."""
    rng = np.random.default_rng((seed, number))
    bench = random_bench(rng)
    name, closed_loop_time = str(rng.choice(list(DESIGNS))), float(10 ** rng.uniform(-1.3, 0.0))
    operating_input = float(rng.uniform(1.9, 3.1))
    told = {
        "number": number,
        "concealed": "+".join(bench.concealed),
        "design": name,
        "closed_loop_time": closed_loop_time,
        "band_Hz": bench.band_Hz,
    }
    try:
        model, known = identified(bench.recording), calibrated(bench.recording)
    except DeatwinError as error:
        return Outcome.from_dict({**told, "verdict": NO_MODEL, "reason": str(error), **_NOTHING})
    found = check(
        model,
        known,
        rng=rng,
        design=partial(DESIGNS[name], model, closed_loop_time),
        operating_input=operating_input,
        command_limits=LIMITS,
        recording=bench.recording,
    )
    return Outcome.from_dict(
        {**told, "verdict": found.verdict.value, "reason": found.reason, **_truth(found, bench, model, rng)}
    )


def _truth(found: Check, bench: Bench, model: NarxModel, rng: np.random.Generator) -> dict[str, Any]:
    """What the design does on the rig that the check did not see."""
    if found.controller is None:
        return _NOTHING
    linear = linearise(model, found.controller.operating_input).in_loop(bench.plant.rig.reading)
    trial = Trial(controller=found.controller, linear=linear, rng=rng)
    runs = trial.runs("plant", bench.plant)
    findings = judge_runs(runs, trial.sine_error(), Specification())
    judged = worst([f for f in findings if f.subject != "tracking"])  # which compares with the model, not with a wish
    return {
        "inside": None if found.predicted is None else found.predicted.inside(runs.steps),
        "sound": judged.verdict is Verdict.PASS,
        "truth": judged.text,
    }
