"""Random rigs that no check has seen, with models identified from their recordings."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.control import linearise_many
from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.narx import Frols, NarxIdentifier, NarxModel, Semp, refine
from deatwin.ident.narx.fleet.alike import linear_in_output
from deatwin.plant import (
    CalibratedPlant,
    Creep,
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
from deatwin.studies.missing_physics.case import experiment_of

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
