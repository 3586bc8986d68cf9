"""Random rigs with random designs: is the verdict of the check confirmed by the true rig?"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.control import Check, Specification, Verdict, check, linearise
from deatwin.control.checking.trial import Trial
from deatwin.control.checking.verdict import judge_runs, worst
from deatwin.control.design.named import Wanted, design_named
from deatwin.ident.narx import NarxModel
from deatwin.plant import DeatwinError
from deatwin.plant.records import read
from deatwin.scenarios.control_check.rigs import LIMITS, Bench, calibrated, identified, random_bench
from deatwin.studies.rates import Rate
from deatwin.studies.sweep.seal import SweepSeal, sources_digest
from deatwin.studies.sweep.store import CaseStore

SCHEMA = "deatwin/control-trial/1"
PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control")
OWN = ("rigs.py", "trials.py")  # Packages and modules whose code decides an outcome
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


# --- on the disk ----------------------------------------------------------------------------------------------------


class _Seal(SweepSeal):
    """Seed and code version, which each trial stores."""

    def stamp(self, name: str) -> dict[str, Any]:
        return {"schema": self.schema, **self.parts}


class Trials(CaseStore):
    """The trials of a study, all of one seed and one version of the code."""

    def __init__(self, folder: Path, seed: int) -> None:
        super().__init__(folder, _Seal(schema=SCHEMA, parts={"seed": seed, "code": _digest()}), cases="trials")

    def outcomes(self, numbers: Iterable[int]) -> tuple[Outcome, ...]:
        """Read trials."""
        return tuple(self.read(name_of(number), partial(read, Outcome), "trial") for number in numbers)


def name_of(number: int) -> str:
    """Name the file of a trial."""
    return f"{number:03d}"


def _digest() -> str:
    return sources_digest(PACKAGES, [Path(__file__).parent / name for name in OWN])


# --- rates ----------------------------------------------------------------------------------------------------------


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
