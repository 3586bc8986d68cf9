"""Random rigs that no check has seen, with random designs: is the verdict of the check confirmed by the true rig?"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.control import Check, Specification, Verdict, check, linearise, linearise_many
from deatwin.control.checking.trial import Trial
from deatwin.control.checking.verdict import judge_runs, worst
from deatwin.control.design.named import Wanted, design_named
from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.narx import Frols, NarxIdentifier, NarxModel, Semp, refine
from deatwin.ident.narx.fleet import linear_in_output
from deatwin.plant import (
    CalibratedPlant,
    Creep,
    DeatwinError,
    Delay,
    Effect,
    ElectrodeRC,
    Experiment,
    ModelError,
    PermittivityDrift,
    Plant,
    QuadraticDamping,
    Recording,
    SensorLag,
    specification,
)
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.fleet import fabricated
from deatwin.plant.records import read
from deatwin.studies.missing_physics import experiment_of
from deatwin.studies.rates import Rate
from deatwin.studies.sweep.seal import SweepSeal, sources_digest
from deatwin.studies.sweep.store import CaseStore

WIDER = 2.0  # Multiple of the tolerances of the fleet, which is of one batch: these rigs are not
LIMITS = (1.3, 3.6)
"""Range of the command, V: inside the noise of the recordings, whose ends of 1.1 and 3.75 V are seldom visited."""


METHODS: tuple[Callable[[], NarxIdentifier], ...] = (
    lambda: Semp(output_lags=2, input_lags=(0, 1, 2), degree=3, max_terms=12),
    lambda: Semp(output_lags=2, input_lags=(0, 1, 2), degree=4, max_terms=12, rule=linear_in_output),
    lambda: Frols(output_lags=3, input_lags=(0, 1, 2, 3), degree=3, max_terms=20),
)
"""Rows are read at the end of the hold, so that a row's command acts on the row's reading: input lags from 0 on."""
STABLE_AT = 24  # Commands at which an identified model must be stable
CALIBRATED = ("permittivity", "shear_modulus", "branch_modulus", "damping", "hysteresis.force")
"""Parameters of the specification that are known least."""
CONCEALED = 0.6  # Share of the rigs that have physics which their specification lacks


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """A rig with its recording."""

    plant: Plant  # The truth, which no check sees
    concealed: tuple[str, ...]  # Effects that its specification does not have
    recording: Recording
    band_Hz: float  # Upper end of the noise, Hz


def random_bench(rng: np.random.Generator) -> Bench:
    """Fabricate a rig and record it."""
    concealed = _concealed(rng) if rng.uniform() < CONCEALED else ()
    plant = fabricated(rng, WIDER).with_effects(*concealed)
    band = float(rng.uniform(0.8, 4.0))
    commands = band_limited_noise(rng, float(rng.uniform(60.0, 120.0)), plant.rig.sample_time, band=band)
    recording = recorded(plant, commands, rng)
    return Bench(plant=plant, concealed=tuple(e.name for e in concealed), recording=recording, band_Hz=band)


def recorded(plant: Plant, commands: NDArray[np.float64], rng: np.random.Generator) -> Recording:
    """Record one sequence of commands from rest. Shapes: `commands` (n,)."""
    silent = experiment_of(plant.rig, commands, np.zeros_like(commands))
    return plant.record(silent, rng).recordings[0]


def _concealed(rng: np.random.Generator) -> tuple[Effect, ...]:
    """Draw one of the effects that change a loop's dynamics."""
    makers = (
        lambda: Creep(modulus=float(rng.uniform(5e3, 25e3)), time=float(10 ** rng.uniform(0.5, 2.0))),
        lambda: ElectrodeRC(time=float(10 ** rng.uniform(-1.6, -0.5))),
        lambda: Delay(time=float(rng.uniform(0.02, 0.1))),
        lambda: SensorLag(time=float(rng.uniform(0.02, 0.15))),
        lambda: QuadraticDamping(coefficient=float(10 ** rng.uniform(-0.5, 1.0))),
        lambda: PermittivityDrift(relative_change=float(rng.uniform(-0.08, 0.08)), time=float(rng.uniform(30, 200))),
    )
    return (makers[int(rng.integers(len(makers)))](),)


def identified(recording: Recording) -> NarxModel:
    """Identify a model for control: stable at all commands, with an invertible curve if possible, of least error."""
    found = []
    for method in METHODS:
        with suppress(ModelError):  # the free run of a first guess may diverge
            model = refine(method().fit(recording).model_, recording)
            at_rest = linearise_many(model, np.linspace(*LIMITS, STABLE_AT))
            if at_rest.stable.all():
                turns = bool(np.ptp(np.sign(at_rest.static_gains)))  # then its curve has no inverse
                found.append((turns, model.simulate(recording).rms_error, model))
    if not found:
        raise ModelError("no method found a model of this recording that is stable at all commands")
    return min(found, key=lambda entry: entry[:2])[2]


def calibrated(recording: Recording) -> CalibratedPlant:
    """Fit the least known parameters of the specification, to represent an actuator without a known plant."""
    wished = specification()
    part = Part.whole(Experiment(recordings=(recording,)))
    fit = calibrate(wished, [part], names=CALIBRATED, starts=1, evaluations=30, tolerance=1e-4)
    left = float(np.sqrt(np.mean(fit.residuals**2)))
    return CalibratedPlant(
        plant=fit.plant, noise=wished.rig.noise, model_error=left, names=fit.names, covariance=fit.covariance
    )


SCHEMA = "deatwin/control-trial/1"
PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control")  # Their code, and this module's, decides an outcome
NO_MODEL = "no model"
"""Verdict of a trial whose recording gave no model to design on, or none of the physics to check it on."""
PASS = Verdict.PASS.value
_NOTHING: dict[str, Any] = {"inside": None, "sound": None, "truth": "no controller"}
DESIGNS = {"lambda tuning": "pi", "loop shaping": "shaped", "LQG": "lqg", "inverse": "inverse"}
"""Designs that are tried, by what the page calls them, as `design_named` knows them."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The verdict on a design, and the truth."""

    number: int
    concealed: str  # Effect that the specification does not have; empty without one
    design: str  # Method of design
    closed_loop_time: float  # Demanded, s
    band_Hz: float  # Excited by the recording, Hz
    verdict: str
    reason: str
    inside: float | None  # Share of the true steps inside the predicted band; None without a prediction
    sound: bool | None  # True if the true rig kept every limit on its runs; None where there was no controller
    truth: str  # The worst finding on the true rig


def try_one(number: int, seed: int) -> Outcome:
    """Fabricate a rig, identify and calibrate it, design, check, and run the design on the true rig."""
    rng = np.random.default_rng((seed, number))
    bench = random_bench(rng)
    name, closed_loop_time = str(rng.choice(list(DESIGNS))), float(10 ** rng.uniform(-1.3, 0.0))
    operating_input = float(rng.uniform(1.9, 3.1))
    told = partial(
        Outcome,
        number=number,
        concealed="+".join(bench.concealed),
        design=name,
        closed_loop_time=closed_loop_time,
        band_Hz=bench.band_Hz,
    )
    try:
        model, known = identified(bench.recording), calibrated(bench.recording)
    except DeatwinError as error:
        return told(verdict=NO_MODEL, reason=str(error), **_NOTHING)
    reading = bench.plant.rig.reading
    wanted = Wanted(
        model=model, reading=reading, closed_loop_time=closed_loop_time, band_Hz=None, operating_range=LIMITS
    )
    found = check(
        model,
        known,
        rng=rng,
        design=design_named(DESIGNS[name], wanted),
        operating_input=operating_input,
        command_limits=LIMITS,
        recording=bench.recording,
    )
    truth = _truth(found, bench, model, rng)
    return told(verdict=found.verdict.value, reason=found.reason, **truth)


def _truth(found: Check, bench: Bench, model: NarxModel, rng: np.random.Generator) -> dict[str, Any]:
    """Run the design on the rig that the check did not see."""
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


class _Seal(SweepSeal):
    """Seed and code version, which each trial stores."""

    def stamp(self, name: str) -> dict[str, Any]:
        return {"schema": self.schema, **self.parts}


class Trials(CaseStore):
    """The trials of a study, all of one seed and one version of the code."""

    def __init__(self, folder: Path, seed: int) -> None:
        code = sources_digest(PACKAGES, [Path(__file__)])
        super().__init__(folder, _Seal(schema=SCHEMA, parts={"seed": seed, "code": code}), cases="trials")

    def outcomes(self, numbers: Iterable[int]) -> tuple[Outcome, ...]:
        """Read trials."""
        return tuple(self.read(name_of(number), partial(read, Outcome), "trial") for number in numbers)


def name_of(number: int) -> str:
    """Name the file of a trial."""
    return f"{number:03d}"


def inside(outcomes: Iterable[Outcome]) -> Rate:
    """Count passed designs whose steps on the true rig lie entirely inside the predicted band."""
    return Rate.of(o.inside == 1.0 for o in outcomes if o.verdict == PASS)


def sound(outcomes: Iterable[Outcome]) -> Rate:
    """Count passed designs that kept every limit on the true rig."""
    return Rate.of(o.sound is True for o in outcomes if o.verdict == PASS)


def caught(outcomes: Iterable[Outcome]) -> Rate:
    """Count designs that broke a limit on the true rig and were not passed."""
    return Rate.of(o.verdict != PASS for o in outcomes if o.sound is False)


def broken(outcomes: Iterable[Outcome]) -> tuple[Outcome, ...]:
    """Select passed trials whose true run left the predicted band or broke a limit."""
    return tuple(o for o in outcomes if o.verdict == PASS and not (o.sound and o.inside == 1.0))


def in_words(rate: Rate) -> str:
    """Write a rate with its one-sided lower 95 % bound."""
    if not rate.count:
        return "no trial"
    bound = f"with 95 % confidence at least {rate.least_percent} %"
    return f"{rate.hits} of {rate.count}, {100 * rate.share:.0f} % ({bound})"
