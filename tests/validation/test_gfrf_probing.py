"""Harmonic probing by simulation: tones in, and the line of their sum out, extrapolated to no amplitude.

The input A_1 cos(w_1 t + p_1) + ... + A_n cos(w_n t + p_n) about the operating input makes, at the sum of its
frequencies, n! H_n prod (A_i e^(jp_i) / 2) and what falls with a higher power of the amplitudes. Lines are chosen
such that no other combination of up to n tones reaches that sum. Nothing of this knows of recursions.
"""

from itertools import product
from math import factorial

import numpy as np
import pytest

from deatwin.ident.frequency import equilibrium, gfrf
from deatwin.ident.narx import NarxModel
from deatwin.plant.recording import Recording

SAMPLE_TIME, PERIOD = 0.02, 200
LEVELS = 0.15 * np.cos(np.pi * (np.arange(14) + 0.5) / 14)  # of both signs: even and odd powers are told apart
POWERS = 10  # that are fitted to 14 levels, from that of the order on
LINES = {1: [(9,), (57,), (-100,)], 2: [(9, 31), (57, -12), (90, 75)], 3: [(9, 31, 70), (13, -44, 71), (95, 84, 68)]}

MODELS = {
    "quadratic and cubic in the output": (
        {"y(k-1)": 1.1, "y(k-2)": -0.5, "u(k-1)": 0.4, "y(k-1)^2": -0.1, "y(k-1)y(k-2)^2": 0.05},
        0.0,
    ),
    "mixed, about an operating point": (
        {
            "1": 0.1,
            "y(k-1)": 0.5,
            "y(k-2)^2": -0.2,
            "y(k-1)u(k-1)": 0.15,
            "u(k)": 0.4,
            "u(k-2)^3": 0.1,
            "y(k-1)y(k-3)u(k)": 0.1,
        },
        0.7,
    ),
    "inputs alone": ({"u(k)": 1.0, "u(k-1)u(k-4)": 0.3, "u(k-2)^2u(k-3)": -0.2}, -0.4),
}


def is_alone(lines):
    """Whether no other combination of up to as many tones, of either sign, has the same sum."""
    others = [sign * line for line in lines for sign in (1, -1)]
    reached = [
        tuple(sorted(chosen))
        for count in range(1, len(lines) + 1)
        for chosen in product(others, repeat=count)
        if (sum(chosen) - sum(lines)) % PERIOD == 0
    ]
    return set(reached) == {tuple(sorted(lines))}


def probed(model, lines, operating_input):
    """H_n from simulations of the periodic steady state."""
    order = len(lines)
    phases = np.random.default_rng(order).uniform(0, 2 * np.pi, order)
    k = np.arange(5 * PERIOD)  # the first four periods forget the start
    tones = sum(np.cos(2 * np.pi * line * k / PERIOD + phase) for line, phase in zip(lines, phases, strict=True))
    start = np.full(k.size, equilibrium(model, operating_input).output)
    last, found = slice(-PERIOD, None), []
    for level in LEVELS:
        run = model.simulate(Recording.from_arrays(operating_input + level * tones, start, SAMPLE_TIME))
        assert run.status.ok
        turned = np.exp(-2j * np.pi * sum(lines) * k[last] / PERIOD)
        found.append(np.mean((run.outputs[0, last] - start[0]) * turned))
    fit = np.linalg.lstsq(LEVELS[:, None] ** np.arange(order, order + POWERS), np.array(found), rcond=None)[0]
    # A tone at half the sampling rate is its own mirror image: both its halves are at the one line.
    halves = np.prod(
        [
            0.5 * np.exp(1j * p) + (0.5 * np.exp(-1j * p) if 2 * abs(line) == PERIOD else 0.0)
            for line, p in zip(lines, phases, strict=True)
        ]
    )
    return fit[0] / (factorial(order) * halves)


@pytest.mark.parametrize("order", LINES)
@pytest.mark.parametrize("name", MODELS)
def test_simulated_tones_are_answered_with_the_frequency_response(name, order):
    terms, operating_input = MODELS[name]
    model = NarxModel.from_terms(terms, sample_time=SAMPLE_TIME)
    for lines in LINES[order]:
        assert is_alone(lines) or 2 * abs(lines[0]) == PERIOD
        omega = 2 * np.pi * np.array(lines) / (PERIOD * SAMPLE_TIME)
        expected = gfrf(model, order, omega, operating_input=operating_input).values[0]
        assert abs(probed(model, lines, operating_input) - expected) < 1e-6 * abs(expected)
