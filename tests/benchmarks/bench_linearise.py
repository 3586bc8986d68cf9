"""Speed of linearisation over a posterior and operating points: ``python tests/benchmarks/bench_linearise.py``.

A NARX model of ten terms, identified from a minute of the diaphragm, at 20 operating points from 1.1 to 3.75 V: 2000
samples of its posterior at once, against one call of `linearise` a sample (timed on some, as they would take minutes),
with the largest difference between the two. Then the physics plant with creep and a resistance, per sample and point.
Times are of processor time with one thread, the shortest of a few runs.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dataclasses import replace

import numpy as np
from stopwatch import timed

from deatwin.control.linear.family import LinearFamily, draw, linearise_many
from deatwin.control.linear.narx import linearise
from deatwin.control.linear.plant import draw_plants, linearise_plants
from deatwin.ident.narx import Frols, NarxModel
from deatwin.plant import CalibratedPlant, Creep, Diaphragm, ElectrodeRC, Experiment, Plant, Recording, thesis_plant
from deatwin.plant.excitation import band_limited_noise

SAMPLES, ALONE, PLANTS = 2000, 100, 20
POINTS = np.linspace(1.1, 3.75, 20)


def identified() -> NarxModel:
    """Ten terms from a minute of noise up to 1 Hz."""
    rng = np.random.default_rng(20)
    command = band_limited_noise(rng, 60.0, 0.02)
    bare = Recording.from_arrays(command, np.zeros_like(command), 0.02, start=5.0)
    recording = Plant(rig=Diaphragm()).record(Experiment(recordings=(bare,)), rng).recordings[0]
    return Frols(output_lags=2, input_lags=(0, 1, 2), degree=2, max_terms=10).fit(recording).model_


def difference(model: NarxModel, family: LinearFamily, thetas: np.ndarray) -> float:
    """Largest relative departure of some members from those samples linearised alone."""
    worst = 0.0
    for number in range(0, SAMPLES, SAMPLES // ALONE):
        for point in range(0, POINTS.size, 5):
            one = linearise(replace(model, theta=thetas[number]), POINTS[point])
            for mine, own in ((family.numerators, one.numerator), (family.denominators, one.denominator)):
                worst = max(worst, float(np.abs(mine[point, number] - own).max() / np.abs(own).max()))
    return worst


def calibrated() -> CalibratedPlant:
    """The thesis' plant with two effects, four parameters of which are uncertain."""
    return CalibratedPlant(
        plant=thesis_plant().with_effects(Creep(), ElectrodeRC()),
        noise=1e-6,
        model_error=0.0,
        names=("shear_modulus", "permittivity", "creep.modulus", "creep.time"),
        covariance=np.diag([0.03, 0.03, 4e3, 0.1]) ** 2,
    )


if __name__ == "__main__":
    subject = identified()
    drawn = draw(subject, np.random.default_rng(1), SAMPLES)
    together = timed(lambda: linearise_many(subject, POINTS, drawn), 3)
    some = [replace(subject, theta=theta) for theta in drawn[:ALONE]]
    alone = timed(lambda: [linearise(model, 2.5) for model in some], 3) / ALONE * SAMPLES * POINTS.size
    print(
        f"NARX, {SAMPLES} samples x {POINTS.size} points: {together:.3f} s at once, {alone:.0f} s one by one "
        f"({alone / together:,.0f} times)"
    )
    print(f"  largest difference {difference(subject, linearise_many(subject, POINTS, drawn), drawn):.1e}")
    plants = draw_plants(calibrated(), np.random.default_rng(2), PLANTS)
    linearise_plants(plants[:1], POINTS[:1])  # writes the derivatives once
    each = timed(lambda: linearise_plants(plants, POINTS), 2) / (PLANTS * POINTS.size)
    print(f"plant of {len(plants[0].equations.states)} states: {each * 1e3:.1f} ms a sample and point")
