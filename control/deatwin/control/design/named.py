"""The designs that ``deatwin check --design`` offers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import pi

import numpy as np

from deatwin.control.controllers.base import Controller
from deatwin.control.design.hinf import hinf
from deatwin.control.design.inverse import static_curve, with_inverse
from deatwin.control.design.lambda_tuning import (
    default_closed_loop_time,
    lambda_tuning,
    lambda_tuning_pid,
    require_time,
)
from deatwin.control.design.loop_shaping import loop_shaping
from deatwin.control.design.lqg import lqg
from deatwin.control.design.pid import Limits
from deatwin.control.design.scheduling import scheduled
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.narx import linearise
from deatwin.ident.narx import NarxModel
from deatwin.plant.rigs.base import ReadingTime

SCHEDULE_POINTS = 5
SCHEDULE_SHARE = 0.6
"""Range of a schedule's laws, as a share of the distance from operating input to the nearer end of the known range."""


SLOWER = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Shares of the usual bandwidth tried in turn for an H-infinity design, whose bounds are stricter than a PI's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Wanted:
    """Requirements of a design, besides the linear model and the limits that `deatwin.control.check` gives it."""

    model: NarxModel  # Identified model
    reading: ReadingTime  # Instant within a row at which its reading is taken
    closed_loop_time: float | None  # Closed-loop time, s; None for the one that lambda tuning chooses
    band_Hz: float | None  # Band that the recording excited, Hz
    operating_range: tuple[float, float] | None

    def time(self, linear: LinearModel) -> float:
        """Time constant of the closed loop, s."""
        asked = require_time(self.closed_loop_time, linear.sample_time)
        return default_closed_loop_time(linear, self.band_Hz) if asked is None else asked

    def bandwidth_Hz(self, linear: LinearModel) -> float:
        """Bandwidth that corresponds to `time`, Hz."""
        return 1.0 / (2 * pi * self.time(linear))

    def known_range(self, limits: Limits) -> Limits:
        """Requested inputs; by default, those of the training data inside the limits."""
        if self.operating_range is not None:
            return self.operating_range
        trained = self.model.operating
        if trained is None:
            return limits
        return max(limits[0], float(trained.input_min[0])), min(limits[1], float(trained.input_max[0]))


def design_named(name: str, wanted: Wanted) -> Callable[..., Controller]:
    """Return the design with a given name from `DESIGNS`, in the form that `deatwin.control.check` expects."""
    return partial(DESIGNS[name], wanted)


def _pi(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return lambda_tuning(linear, command_limits=command_limits, closed_loop_time=wanted.time(linear))


def _pid(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return lambda_tuning_pid(
        linear, command_limits=command_limits, closed_loop_time=wanted.closed_loop_time, band_Hz=wanted.band_Hz
    )


def _inverse(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    curve = static_curve(wanted.model, wanted.known_range(command_limits))
    tuned = partial(lambda_tuning, closed_loop_time=wanted.time(linear))
    return with_inverse(linear, curve, tuned, command_limits=command_limits)


def _lqg(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return lqg(linear, command_limits=command_limits, closed_loop_time=wanted.time(linear))


def _hinf(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    fastest = wanted.bandwidth_Hz(linear)
    if wanted.closed_loop_time is None:  # without a requested time, the fastest that can be designed
        for share in SLOWER:
            with suppress(ControlError):
                return hinf(linear, command_limits=command_limits, bandwidth_Hz=share * fastest)
    return hinf(linear, command_limits=command_limits, bandwidth_Hz=fastest)


def _shaped(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    return loop_shaping(linear, command_limits=command_limits, crossover_Hz=wanted.bandwidth_Hz(linear))


def _scheduled(wanted: Wanted, linear: LinearModel, *, command_limits: Limits) -> Controller:
    centre, (low, high) = linear.operating_input, wanted.known_range(command_limits)
    if wanted.operating_range is None:
        room = SCHEDULE_SHARE * min(centre - low, high - centre)
        low, high = centre - room, centre + room
    points = np.union1d(np.linspace(low, high, SCHEDULE_POINTS), [centre])
    models = [linearise(wanted.model, float(point)).in_loop(wanted.reading) for point in points]
    tuned = partial(lambda_tuning, closed_loop_time=wanted.time(linear))
    return scheduled(models, tuned, command_limits=command_limits, operating_input=centre)


DESIGNS: Mapping[str, Callable[..., Controller]] = {
    "pi": _pi,
    "pid": _pid,
    "inverse": _inverse,
    "lqg": _lqg,
    "hinf": _hinf,
    "shaped": _shaped,
    "scheduled": _scheduled,
}
