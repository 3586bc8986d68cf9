"""Speed of `propagate` against Monte Carlo: ``python tests/benchmarks/bench_propagate.py``.

The model has 16 terms and an offset, as identified from 40,000 samples. Monte Carlo draws parameters and computes the
response of all draws in blocks of arrays that stay in the processor's cache, with the equilibria of all of them by one
Newton iteration, and the covariance of real and imaginary part: `sample`. (One by one, as a user would write it with
`gfrf` and a loop, it takes far longer; that is printed too, from 100 draws.) Propagation is timed as one computes it,
with the operating point, the response, its derivatives and the nonlinearity index; and without the index.

Equal accuracy: the error of the linear law is measured against a million draws, as the largest departure of an
ellipse over frequency, made round, less what the sampling of these draws adds. A covariance of N draws departs by about
c/sqrt(N), where c is measured as well, over repetitions. Equal are both at N = (c/error)², which is what is compared;
the conventional 20,000 draws stand beside it. Where the error cannot be told from the sampling of a million draws, N
is at least a million and the ratio a lower bound.

Times are of processor time with one thread, the shortest of a few runs.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from stopwatch import timed

from deatwin.ident.frequency import FrequencyResponse, gfrf, output_spectrum
from deatwin.ident.frequency.uncertainty.parameters import draw_theta, with_theta
from deatwin.ident.frequency.uncertainty.propagate import propagate
from deatwin.ident.frequency.uncertainty.sampling import sample
from deatwin.ident.narx import Fixed, NarxModel
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]
Quantity = Callable[[NarxModel], FrequencyResponse]

CONVENTIONAL, CHUNK, CHUNKS, LOOP = 20_000, 20_000, 50, 100
OMEGA = np.geomspace(0.02, 3.0, 200)
TERMS = {
    "1": 0.05,
    "y(k-1)": 1.1,
    "y(k-2)": -0.3,
    "u(k-1)": 0.3,
    "u(k-2)": 0.1,
    "u(k-1)^2": 0.2,
    "y(k-1)u(k-1)": -0.1,
    "y(k-1)^2": -0.03,
    "y(k-1)y(k-2)": 0.02,
    "u(k-1)u(k-2)": 0.05,
    "y(k-2)u(k-1)": 0.03,
    "y(k-1)^3": -0.05,
    "u(k-1)^3": 0.02,
    "y(k-1)u(k-1)^2": -0.02,
    "y(k-1)^2u(k-1)": -0.02,
    "y(k-2)u(k-2)": 0.02,
}


def identified() -> NarxModel:
    """Least squares on a run with white equation noise."""
    rng = np.random.default_rng(0)
    inputs, noise = 0.8 * rng.standard_normal(40_000), 0.05 * rng.standard_normal(40_000)
    driven = {text.replace("u(", "u1("): value for text, value in TERMS.items()} | {"u2(k)": 1.0}
    system = NarxModel.from_terms(driven, sample_time=1.0)
    run = system.simulate(Recording.from_arrays([inputs, noise], np.zeros(inputs.size), 1.0))
    return Fixed(terms=list(TERMS)).fit(Recording.from_arrays(inputs, run.outputs[0], 1.0)).model_


def quantities() -> dict[str, Quantity]:
    """Each at 200 frequencies or combinations; the spectrum at the 201 lines of a period of 400 samples."""
    period = sum(np.cos(2 * np.pi * k * np.arange(400) / 400 + 0.7 * k * k) for k in range(3, 60, 4)) / 8
    return {
        "H_1": partial(gfrf, order=1, omega=OMEGA),
        "H_2": partial(gfrf, order=2, omega=np.c_[OMEGA, OMEGA[::-1]]),
        "H_3": partial(gfrf, order=3, omega=np.c_[OMEGA, OMEGA, -OMEGA[::-1]]),
        "Y, orders 1 to 3": partial(output_spectrum, excitation=period, order=3),
    }


def departure(reference: Array, covariance: Array) -> float:
    """Largest eigenvalue, over frequency, of a difference of covariances where the reference's ellipses are round."""
    sizes, axes = np.linalg.eigh(reference)
    kept = sizes > np.maximum(1e-13 * sizes[:, -1:], 1e-24 * sizes.max())
    whiten = np.where(kept, 1 / np.sqrt(np.where(kept, sizes, 1.0)), 0.0)[:, :, None] * axes.swapaxes(1, 2)
    return float(np.abs(np.linalg.eigvalsh(whiten @ (covariance - reference) @ whiten.swapaxes(1, 2))).max())


def accuracy(model: NarxModel, quantity: Quantity, propagated: Array) -> tuple[float, float]:
    """Departure of the linear law from a million draws, and that of a chunk of draws on the average."""
    rng = np.random.default_rng(1)
    chunks = np.array([sample(model, quantity, rng, CHUNK).covariance for _ in range(CHUNKS)])
    pooled = chunks.mean(axis=0)
    return departure(pooled, propagated), float(np.mean([departure(pooled, chunk) for chunk in chunks]))


def in_a_loop(model: NarxModel, quantity: Quantity) -> None:
    for theta in draw_theta(model, np.random.default_rng(2), LOOP):
        quantity(with_theta(model, theta))


def measure(name: str, model: NarxModel, quantity: Quantity) -> None:
    """Print times and ratios of one quantity."""
    found = propagate(model, quantity)
    error, chunk_error = accuracy(model, quantity, found.covariance)
    floor = chunk_error / np.sqrt(CHUNKS)  # what a million draws depart by themselves
    equal = CHUNK * (chunk_error / np.sqrt(max(error**2 - floor**2, floor**2))) ** 2
    bound = ">= " if error**2 - floor**2 < floor**2 else ""
    own = timed(lambda: propagate(model, quantity).covariance, 20)
    bare = timed(lambda: quantity(model).covariance, 20)
    drawn = timed(lambda: sample(model, quantity, np.random.default_rng(2), CONVENTIONAL).covariance, 2)
    alone = timed(lambda: in_a_loop(model, quantity), 1) / LOOP
    print(f"{name}: nonlinearity up to {found.nonlinearity.max():.3f}, {found.status.name}")
    print(f"  propagate {own * 1e3:.2f} ms, without the index {bare * 1e3:.2f} ms")
    print(f"  20,000 draws at once {drawn:.2f} s, one by one {alone * CONVENTIONAL:.0f} s")
    print(
        f"  departure of the linear law {error:.1%}, of 20,000 draws {chunk_error:.1%}: "
        f"equal at {bound}{equal:,.0f} draws"
    )
    for what, draws in (("20,000 draws", CONVENTIONAL), ("draws of equal accuracy", equal)):
        ratio = drawn * draws / CONVENTIONAL / np.array([own, bare])
        print(f"  faster than {what}: {ratio[0]:,.0f} times, without the index {ratio[1]:,.0f} times")


if __name__ == "__main__":
    subject = replace(identified(), sample_time=1.0)
    print(f"{len(TERMS)} terms, 200 frequencies, one thread")
    for title, wanted in quantities().items():
        measure(title, subject, wanted)
