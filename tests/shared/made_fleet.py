"""Made-up actuators of one law, and the models of one structure that are fitted to them."""

import numpy as np

from deatwin.ident.narx.fleet import (
    DEGREES,
    LAGS,
    OPERATING_INPUT,
    VARIANTS,
    Fleet,
    Orders,
    Plan,
    Prepared,
    identify_alike,
)
from deatwin.ident.narx.preprocess import choose_sampling, choose_sections, inspect_recordings
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.fleet import fleet as fabricated
from deatwin.plant.recording import Recording

PERIOD, STEP, NOISE = 60, 0.12, 1e-6
"""Samples of the probing tones; sample time and noise, s and m, of the made-up actuators."""
GAINS = (1.0, 1.2, 1.5)
"""Of the made-up actuators."""


def made_up(gain: float, n: int = 3000, seed: int = 0) -> Recording:
    """y(k) = 0.55 y(k-1) + gain 1e-5 (u(k)^2 + u(k-1)^2 + u(k) u(k-1)) + e(k)."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.uniform(-2.5, 2.5, n + 4), np.ones(5) / 5, "valid") + OPERATING_INPUT
    e, y = NOISE * rng.standard_normal(n), np.zeros(n)
    y[0] = 3.8e-4 * gain
    for k in range(1, n):
        y[k] = 0.55 * y[k - 1] + 1e-5 * gain * (u[k] ** 2 + u[k - 1] ** 2 + u[k] * u[k - 1]) + e[k]
    return Recording.from_arrays(
        u, y, STEP, input_names=("command",), input_units=("V",), output_names=("displacement",), output_units=("m",)
    )


def of_second_degree(n: int, seed: int = 0, drift: float = 0.0) -> Recording:
    """y(k) = 0.6 y(k-1) + 1e-4 u(k)^2 - 2e-5 u(k-1)^2 + 0.02 y(k-1) u(k) + e(k), read with a drift that grows."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.uniform(-2.5, 2.5, n + 4), np.ones(5) / 5, "valid") + 2.4
    e = NOISE * rng.standard_normal(n)
    y = np.zeros(n)
    y[0] = 3e-4
    for k in range(1, n):
        y[k] = 0.6 * y[k - 1] + 1e-4 * u[k] ** 2 - 2e-5 * u[k - 1] ** 2 + 0.02 * y[k - 1] * u[k] + e[k]
    return Recording.from_arrays(u, y + drift * np.linspace(0, 1, n) ** 2, 0.02)


def of_growing_gain(drift: float, seed: int = 0, duration: float = 1100.0) -> Recording:
    """y(k) = 0.6 y(k-1) + g(t) u(k)^2 + e(k), g growing by a share of itself along the record."""
    rng = np.random.default_rng(seed)
    u = band_limited_noise(rng, duration, STEP)
    gain = 1e-5 * (1 + drift * np.linspace(0, 1, u.size))
    e = 2e-7 * rng.standard_normal(u.size)
    y = np.full(u.size, 1.5e-4)
    for k in range(1, u.size):
        y[k] = 0.6 * y[k - 1] + gain[k] * u[k] ** 2 + e[k]
    return Recording.from_arrays(u, y, STEP)


def plan_of(lags: tuple[int, int] = (1, 1), degree: int = 2, count: int = 3) -> Plan:
    """Every sample, and one of the orders that are tried; as they stand: y(k-1), u(k) and u(k-1), second degree."""
    errors = np.ones((count, len(LAGS), len(DEGREES)))
    errors[:, LAGS.index(lags), DEGREES.index(degree)] = 0.1
    return Plan(orders=(Orders(factor=1, errors=errors),), chosen=0)


def made_fleet() -> Fleet:
    """Three actuators of one law and three gains, recorded for 360 s."""
    prepared = []
    for number, gain in enumerate(GAINS):
        record = made_up(gain, seed=number)
        prepared.append(
            Prepared(
                actuator=fabricated(0)[number],
                recordings=dict.fromkeys(VARIANTS, record),
                sections=choose_sections(record, n_segments=20),
                sampling=choose_sampling(record, n_lags=50),
                findings=inspect_recordings(record),
            )
        )
    return identify_alike(prepared, plan_of())
