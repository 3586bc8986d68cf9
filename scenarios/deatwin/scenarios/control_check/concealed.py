"""A concealed effect: controllers designed on the base plant and on the amended plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.control import Check, Controller, Finding, Specification, check, lambda_tuning, linearise, linearise_plant
from deatwin.control.checking.trial import Trial
from deatwin.control.checking.verdict import Runs, judge_runs, worst
from deatwin.ident.mismatch import Diagnosis, diagnose
from deatwin.plant import CalibratedPlant, Creep, Diaphragm, Effect, ElectrodeRC, Experiment, Plant
from deatwin.plant.excitation import band_limited_noise
from deatwin.scenarios.control_check.trials import identified, recorded

EFFECTS: Mapping[str, Callable[[], Effect]] = {"electrode_rc": lambda: ElectrodeRC(time=0.4), "creep": Creep}
"""Concealed effects. A grease electrode of 0.4 s makes a design slow; one of 0.05 s does not (it would be no story)."""
OPERATING = 2.6
LIMITS = (1.2, 3.7)
CLOSED_LOOP_TIME = 0.4  # As slow as the electrode, s
OTHER_TIMES = (0.2, 0.6)
"""Closed-loop times at which the designs are made as well, s: what they show is reported, nothing is demanded."""
SECONDS, BAND = 120.0, 5.0
"""Length of each recording in s, and upper end of the noise of that which is diagnosed, in Hz."""
MEAN, VARIANCE, LOWER, UPPER = 2.4, 0.36, 1.1, 3.75
"""Commands of the recording that is identified: those of the thesis' noise, in V, V² before the limits, V and V."""
FAST = 20.0
"""Upper end of the noise that has half of the variance, Hz: beyond the 16 Hz at which the nominal plant's loop has its
gain margin."""
SLOW = 1.0 / (2 * np.pi * CLOSED_LOOP_TIME)
"""Upper end of the other half's noise, Hz: the bandwidth of the loop. Behind an electrode fast noise alone never moves
the film as far as the steps of a check, and beyond its training data no posterior tells how wrong a polynomial is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Designed:
    """A design from one of the physics models."""

    source: str  # ``base`` or ``amended``
    controller: Controller
    check: Check
    runs: Runs
    truth: Finding  # Worst finding on the true rig


@dataclass(frozen=True, kw_only=True, eq=False)
class Concealed:
    """A concealed effect, its diagnosis, and both designs."""

    effect: str  # Canonical name
    diagnosis: Diagnosis
    designs: tuple[Designed, ...]  # From the base plant, then from the amended one
    at_other_times: tuple[Designed, ...] = ()  # Likewise, for closed loops that are faster and slower


def conceal(effect: str, rng: np.random.Generator, *, jobs: int, seed: int) -> Concealed:
    """Record a rig with an effect that its model does not have, diagnose, design twice, check, and try."""
    nominal = Plant(rig=Diaphragm())
    true = nominal.with_effects(EFFECTS[effect]())
    h = nominal.rig.sample_time
    seen = recorded(true, band_limited_noise(rng, SECONDS, h, band=BAND), rng)
    diagnosis = diagnose(nominal, [Experiment(recordings=(seen,))], jobs=jobs, seed=seed)
    recording = recorded(true, excitation(rng, h), rng)
    base, amended = diagnosis.base_model, diagnosis.model
    if base is None or amended is None:
        raise RuntimeError("a diagnosis that has just been made has both models")
    model, reading = identified(recording), true.rig.reading

    def designed(source: str, known: CalibratedPlant, closed_loop_time: float) -> Designed:
        """Design on a plant, check, and try on the true rig."""
        linear = linearise_plant(known.plant, OPERATING).in_loop(reading)
        controller = lambda_tuning(linear, command_limits=LIMITS, closed_loop_time=closed_loop_time)
        others = diagnosis.rival_models
        found = check(model, amended, rng=rng, controller=controller, recording=recording, others=others)
        trial = Trial(controller=controller, linear=linearise(model, OPERATING).in_loop(reading), rng=rng)
        runs = trial.runs("plant", true)
        truth = worst(judge_runs(runs, found.sine_predicted or trial.sine_error(), Specification()))
        return Designed(source=source, controller=controller, check=found, runs=runs, truth=truth)

    designs = tuple(
        designed(source, known, time)
        for time in (CLOSED_LOOP_TIME, *OTHER_TIMES)
        for source, known in (("base", base), ("amended", amended))
    )
    return Concealed(effect=effect, diagnosis=diagnosis, designs=designs[:2], at_other_times=designs[2:])


def excitation(rng: np.random.Generator, sample_time: float) -> NDArray[np.float64]:
    """Noise that reaches the levels of the loop's steps and the frequencies of its margins. Shapes: returns (n,)."""
    halves = [
        band_limited_noise(
            rng, SECONDS, sample_time, mean=0.0, variance=0.5 * VARIANCE, band=band, lower=-np.inf, upper=np.inf
        )
        for band in (SLOW, FAST)
    ]
    return np.clip(MEAN + halves[0] + halves[1], LOWER, UPPER)
