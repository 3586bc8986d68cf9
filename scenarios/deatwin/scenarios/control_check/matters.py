"""Compare one design rule on five models of one actuator: predicted and achieved performance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from deatwin.control import (
    ClosedLoop,
    Controller,
    LinearFamily,
    closed_loop,
    draw_plants,
    lambda_tuning,
    linearise_many,
    linearise_plants,
    predict_loop,
    sine_response,
)
from deatwin.control.checking.rows import rows_of_family
from deatwin.control.checking.subject import STICKING
from deatwin.control.checking.trial import Trial
from deatwin.control.stability.margins import bandwidth_Hz
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.narx import Fixed, Frols, NarxModel, Semp, SvbNarx, free_run_residual
from deatwin.ident.narx.fleet import linear_in_output
from deatwin.plant import CalibratedPlant, DeatwinError, Plant, ReadingTime, Recording
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.fleet import fabricated
from deatwin.scenarios.control_check.trials import WIDER, calibrated, recorded

OPERATING = 2.6
LIMITS = (1.2, 3.7)
CLOSED_LOOP_TIME = 0.2
SAMPLES = 200
PLANTS = 40
AMPLITUDES = (0.1, 0.3)  # Sines that measure the plant, as shares of the room to the limits: as large as the steps are
LINES = 24  # Frequencies at which it is measured
CANDIDATES: Mapping[str, Any] = {"output_lags": 2, "input_lags": (0, 1, 2), "degree": 3, "rule": linear_in_output}
"""Rows are read at the end of the hold: input lags from 0 on."""
ARX = ("1", "y(k-1)", "y(k-2)", "u(k)", "u(k-1)", "u(k-2)")
_design = partial(lambda_tuning, command_limits=LIMITS, closed_loop_time=CLOSED_LOOP_TIME)
MODELS: Mapping[str, Callable[[Recording], NarxModel]] = {
    "linear ARX": lambda r: Fixed(terms=ARX).fit(r).model_,
    "NARX by FROLS": lambda r: Frols(**CANDIDATES, max_terms=15).fit(r).model_,
    "NARX by SEMP": lambda r: Semp(**CANDIDATES, max_terms=12).fit(r).model_,
    "NARX by SVB": lambda r: SvbNarx(**CANDIDATES).fit(r).model_,
}


@dataclass(frozen=True)
class Interval:
    """A predicted number with its 95 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def over(cls, values: Array | list[float]) -> Interval:
        """Take the first value for the model's own, the others for its draws."""
        spread = np.asarray(values, dtype=np.float64)
        low, high = np.quantile(spread, [0.025, 0.975])
        return cls(value=float(spread[0]), low=float(min(low, spread[0])), high=float(max(high, spread[0])))


QUANTITIES = {"bandwidth": ("Hz", 1.0), "overshoot": ("%", 100.0), "gain margin": ("", 1.0), "rms error": ("µm", 1e6)}
"""Numbers that a model predicts of its closed loop: their unit, and the factor from SI to it."""


@dataclass(frozen=True, kw_only=True)
class Promise:
    """A predicted number and the value achieved on the plant, in the quantity's unit."""

    model: str
    quantity: str  # One of `QUANTITIES`
    predicted: Interval
    achieved: float

    @classmethod
    def of(cls, model: str, quantity: str, predicted: Interval, achieved: float) -> Promise:
        """Convert from SI to the quantity's unit."""
        _, s = QUANTITIES[quantity]
        scaled = Interval(s * predicted.value, s * predicted.low, s * predicted.high)
        return cls(model=model, quantity=quantity, predicted=scaled, achieved=s * achieved)

    @property
    def kept(self) -> bool:
        """True if the plant's number lies inside the predicted interval."""
        return self.predicted.low <= self.achieved <= self.predicted.high


@dataclass(frozen=True, kw_only=True, eq=False)
class Matter:
    """One model, with the predicted and the achieved performance of its design."""

    name: str
    residual: float | None  # Rms that its free run leaves of the recording, in the output's unit
    reason: str = ""  # Why the model allows no design
    promises: tuple[Promise, ...] = ()  # One for each quantity; none without a design


@dataclass(frozen=True, kw_only=True, eq=False)
class Matters:
    """Every model of one actuator."""

    models: tuple[Matter, ...]
    output_rms: float

    @property
    def promises(self) -> tuple[Promise, ...]:
        """Predicted and achieved numbers of every model that allowed a design."""
        return tuple(promise for matter in self.models for promise in matter.promises)


def compare_models(rng: np.random.Generator) -> Matters:
    """Record an actuator, model it in five ways, design a controller on each, and run all loops."""
    plant = fabricated(rng, WIDER)
    recording = recorded(plant, band_limited_noise(rng, 120.0, plant.rig.sample_time, band=2.0), rng)
    truth = _Truth.of(plant)
    noise = int(rng.integers(2**32))
    found = [_of_narx(name, make, recording, truth, np.random.default_rng(noise)) for name, make in MODELS.items()]
    found.append(_of_plant("calibrated plant", calibrated(recording), truth, np.random.default_rng(noise)))
    return Matters(models=tuple(found), output_rms=float(recording.outputs[0].std()))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Truth:
    """The plant, and its response to sines of the steps' size."""

    plant: Plant
    omega: Array
    response: Complex

    @classmethod
    def of(cls, plant: Plant) -> _Truth:
        h = plant.rig.sample_time
        omega = np.geomspace(2 * np.pi * 0.05, 0.95 * np.pi / h, LINES)
        room = min(OPERATING - LIMITS[0], LIMITS[1] - OPERATING)
        measured = sine_response(plant, OPERATING, room * np.array(AMPLITUDES), omega)
        if measured is None:
            raise RuntimeError("the actuator did not survive the sines that measure it")
        return cls(plant=plant, omega=omega, response=measured.values[-1])

    def achieved(self, controller: Controller, steps: ClosedLoop) -> tuple[float, ...]:
        """Return the quantities, SI."""
        law = controller.local(controller.operating_input)
        reading = self.plant.rig.reading
        loose = self.plant.without_effects(*(name for name in STICKING if name in self.plant.effect_names))
        families = [linearise_plants((plant,), [OPERATING]).in_loop(reading) for plant in (self.plant, loose)]
        loop = law.feedback_response(self.omega, controller.sample_time) * self.response
        gain = min(rows_of_family("plant", family, controller)[0].gain for family in families)
        return float(bandwidth_Hz(self.omega, loop[None])[0]), steps.overshoot, gain, steps.rms_error


def _of_narx(
    name: str, make: Callable[[Recording], NarxModel], recording: Recording, truth: _Truth, rng: np.random.Generator
) -> Matter:
    residual = None
    try:
        model = make(recording)
        run = model.simulate(recording)
        residual = run.rms_error if run.status.ok else None
        family = linearise_many(model, [OPERATING], np.vstack([model.theta, draw_theta(model, rng, SAMPLES)]))
        family = family.in_loop(truth.plant.rig.reading)
        controller = _design(family.at(0, 0))
        left = free_run_residual(model, recording)
        reference = Trial(controller=controller, linear=family.at(0, 0), rng=rng).step_reference
        end, noise = ReadingTime.END_OF_HOLD, truth.plant.rig.noise
        predicted = predict_loop(model, controller, reference, reading=end, residual=left, noise=noise, rng=rng)
        overshoot = Interval(*predicted.interval(lambda r: r.overshoot))
        rms = Interval(*predicted.interval(lambda r: r.rms_error))
    except DeatwinError as error:
        return Matter(name=name, residual=residual, reason=str(error))
    return _matter(name, residual, family, controller, (overshoot, rms), truth, reference, rng)


def _of_plant(name: str, known: CalibratedPlant, truth: _Truth, rng: np.random.Generator) -> Matter:
    plants = (known.plant, *draw_plants(known, rng, PLANTS))
    family = linearise_plants(plants, [OPERATING]).in_loop(truth.plant.rig.reading)
    controller = _design(family.at(0, 0))
    reference = Trial(controller=controller, linear=family.at(0, 0), rng=rng).step_reference
    runs = [closed_loop(plant, controller, reference, rng=rng) for plant in plants]
    steps = Interval.over([run.overshoot for run in runs]), Interval.over([run.rms_error for run in runs])
    return _matter(name, known.model_error, family, controller, steps, truth, reference, rng)


def _matter(
    name: str,
    residual: float | None,
    family: LinearFamily,
    controller: Controller,
    steps: tuple[Interval, Interval],
    truth: _Truth,
    reference: Array,
    rng: np.random.Generator,
) -> Matter:
    """Try a design on the plant; `steps` has the predicted overshoot and rms error."""
    achieved = truth.achieved(controller, closed_loop(truth.plant, controller, reference, rng=rng))
    bandwidth, gain = _predicted(family, controller)
    predicted = (bandwidth, steps[0], gain, steps[1])
    made = (Promise.of(name, *each) for each in zip(QUANTITIES, predicted, achieved, strict=True))
    return Matter(name=name, residual=residual, promises=tuple(made))


def _predicted(family: LinearFamily, controller: Controller) -> tuple[Interval, Interval]:
    """Predict bandwidth and gain margin from the samples with an equilibrium; the first is the model itself."""
    single = [family.at(0, int(s)) for s in np.flatnonzero(family.exists[0])]
    omega = np.geomspace(2 * np.pi * 0.02, 0.95 * np.pi / controller.sample_time, 400)
    law = controller.local(OPERATING).feedback_response(omega, controller.sample_time)
    bandwidth = Interval.over(bandwidth_Hz(omega, np.array([law * linear.response(omega) for linear in single])))
    gains = [rows_of_family("model", LinearFamily.of([[linear]]), controller)[0].gain for linear in single]
    (row,) = rows_of_family("model", family, controller)
    low = float(np.quantile(gains, 0.025, method="lower"))
    high = float(np.quantile(gains, 0.975, method="higher"))
    return bandwidth, Interval(value=row.gain, low=low, high=high)
