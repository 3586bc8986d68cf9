"""A rig that moves faster than its samples, against its own equations."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.app.cli import main

MODULUS, PERMITTIVITY, THICKNESS, LAYERS, AREA, MASS, GAIN = 250e3, 2.8 * 8.8541878128e-12, 5e-5, 100, 4e-4, 0.2, 800.0
DAMPING = 40.0  # of the rig, where the rig file says nothing else
RIG = """kind = "stack"
[film]
thickness_mm = 0.05
layers = 100
area_mm2 = 400
[material]
name = "own"
energy = "neo_hookean"
permittivity = 2.8
[material.parameters]
shear_modulus = 250e3
[load]
mass_g = 200
[drive]
gain = 800
start_ramp_s = 1
start_hold_s = 10
[sensor]
sample_rate_Hz = 100
noise_um = 1
zero = "displacement at zero volts"
"""


def acceleration(height: float, speed: float, volts: float) -> float:
    """Of the mass on a stack of neo-Hookean films without load, whose height falls under voltage, m/s²."""
    square = LAYERS * THICKNESS / height  # of the stretch in the plane
    elastic = MODULUS * (1 - square**-3) * square / height * LAYERS * AREA * THICKNESS
    maxwell = volts**2 * LAYERS * PERMITTIVITY * AREA / THICKNESS * square**2 / height
    return (elastic - maxwell - DAMPING * speed) / MASS


@pytest.mark.usefixtures("uncompiled")
def test_a_stack_of_87_hertz_at_100_samples_a_second(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(RIG, encoding="utf-8")
    commands = np.repeat([0.0, 3.0, 1.0, 2.5], 12)
    rows = [f"{0.01 * k:.2f},{u}" for k, u in enumerate(commands)]
    Path("steps.csv").write_text("\n".join(["time_s,command_V", *rows]), encoding="utf-8")
    assert main(["simulate", "rig.toml", "steps.csv", "--out", "predicted.csv", "--quiet"]) == 0
    state, truth = np.array([LAYERS * THICKNESS, 0.0]), []
    for volts in GAIN * commands:
        moved = solve_ivp(
            lambda _, w, volts=volts: [w[1], acceleration(w[0], w[1], volts)],
            (0.0, 0.01),
            state,
            method="DOP853",
            rtol=1e-10,
            atol=1e-13,
        )
        state = moved.y[:, -1]
        truth.append(1e3 * (LAYERS * THICKNESS - state[0]))
    found = np.genfromtxt("predicted.csv", delimiter=",", names=True)["displacement_mm"]
    assert np.ptp(truth) > 0.5
    np.testing.assert_allclose(found, truth, atol=2e-4)  # a fifth of the noise
