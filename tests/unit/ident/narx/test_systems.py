"""Benchmark systems: their equations hold sample by sample, and what is known of E1 is found."""

import math

import numpy as np
import pytest

from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem
from deatwin.plant.errors import ModelError


def written(y: np.ndarray, u: np.ndarray, name: str) -> np.ndarray:
    """The right-hand side without noise, written once more with slices; shape (n - 2,)."""
    y1, y2, u1, u2 = y[1:-1], y[:-2], u[1:-1], u[:-2]
    mao_billings = -0.5 * y2 + 0.7 * y1 * u1 + 0.6 * u2**2 + 0.2 * y1**3 - 0.7 * y2 * u2**2
    baldacchino = 0.7 * y1 * u1 - 0.5 * y2 + 0.6 * u2**2 - 0.7 * y2 * u2**2
    return {
        "S1": -1.7 * y1 - 0.8 * y2 + u1 + 0.81 * u2,
        "S2": 0.8 * y1 + 0.4 * (u1 + u1**2 + u1**3),
        "S3": mao_billings,
        "S4": baldacchino,
        "S5": baldacchino,
        "S6": 0.75 * y2 + 0.25 * u1 - 0.2 * y2 * u1,
        "E0": 0.3 * y1 + 0.1 * u1 + 0.4 * y1 * y2,
        "E1": mao_billings,
        "WK": 0.5 * y1 - 0.3 * y2 + 0.1 * u2 + 0.4 * u1 * u2,
    }[name]


STD = {"S1": 0.01, "S2": 0.01, "S3": 0.01, "S4": 0.04, "S5": 0.02, "S6": 0.02, "E0": 0.1, "E1": 0.004**0.5, "WK": 0.2}


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_the_equation_leaves_is_its_noise(name: str) -> None:
    draw = SYSTEMS[name].draw(np.random.default_rng(3), 20_000 if name != "E1" else None)
    u, y = draw.recording.inputs[0], draw.recording.outputs[0]
    noise = y[2:] - written(y, u, name)
    if name == "S5":  # take the colour off: e(k) = v(k) - 0.2 e(k-1) + 0.3 u(k-1) e(k-2)
        e = [0.0, 0.0]
        for v, before in zip(noise, u[1:], strict=False):
            e.append(v - 0.2 * e[-1] + 0.3 * before * e[-2])
        noise = np.array(e[2:])
    n = noise.size
    # The variance of a normal sample is known to sqrt(2/n), its autocorrelation at lag 1 to 1/sqrt(n); four of each.
    assert noise.var() == pytest.approx(STD[name] ** 2, rel=4 * math.sqrt(2 / n))
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4 / math.sqrt(n)


def test_e1_diverges_in_about_a_sixth_of_the_draws() -> None:
    # Known: 16 of 100 runs of 1000 samples. Of 400 runs here 0.16 would give 64 with a standard deviation of 7.3, and
    # the known rate has one of 0.037 itself; so 0.16 ± 3 sqrt(0.037² + 0.018²) holds in 997 of 1000 cases.
    draws = [SYSTEMS["E1"].draw(np.random.default_rng([7, i])) for i in range(340)]
    thrown = sum(draw.redraws for draw in draws)
    assert thrown / (thrown + len(draws)) == pytest.approx(0.16, abs=0.125)
    ratio = np.median([draw.recording.outputs.var() for draw in draws]) / 0.004
    assert 10 * math.log10(ratio) == pytest.approx(14.4, abs=0.2)


def test_a_system_without_stable_runs_is_refused() -> None:
    bad = BenchmarkSystem(
        name="bad", equation={"y(k-1)": 2.0}, draw_input=lambda rng, n: np.zeros(n), noise_std=1.0, n_samples=200
    )
    with pytest.raises(ModelError, match="100 runs of bad diverged"):
        bad.draw(np.random.default_rng(0))
