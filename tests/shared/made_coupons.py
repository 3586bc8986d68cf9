"""Made-up tests of a material whose stresses have closed forms: no line of them is shared with the fit."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from deatwin.ident.materials import MaterialTest

MODULUS, LIMIT = 200e3, 60.0
"""Gent, Pa."""
BRANCHES = ((80e3, 2.0), (50e3, 60.0))
"""Moduli in Pa, times in s."""
TRUE = {"shear_modulus": MODULUS, "stretch_limit": LIMIT} | {
    f"{name}_{what}": value
    for name, branch in zip(("branch", "branch_2"), BRANCHES, strict=True)
    for what, value in zip(("modulus", "time"), branch, strict=True)
}


def gent_pull(stretch: np.ndarray) -> np.ndarray:
    return MODULUS * LIMIT / (LIMIT - (stretch**2 + 2 / stretch - 3)) * (stretch - stretch**-2)


def gent_equibiaxial(stretch: np.ndarray) -> np.ndarray:
    return MODULUS * LIMIT / (LIMIT - (2 * stretch**2 + stretch**-4 - 3)) * (stretch - stretch**-5)


def small_ramp(times: np.ndarray, rate: float) -> np.ndarray:
    """Linear viscoelasticity: the convolution of a ramp with exponentials."""
    branches = sum(modulus * time * -np.expm1(-times / time) for modulus, time in BRANCHES)
    return 3 * rate * (MODULUS * times + branches)


def held(times: np.ndarray, stretch: float) -> np.ndarray:
    """A stretch held from time 0 on: dx/dt = -(x^3 - 1)/(3 tau) for a branch's elastic stretch, which is integrated."""

    def integral(above: float) -> float:  # of the logarithm of x - 1, which falls without end
        x = 1 + np.exp(above)
        return above / 3 - np.log(x**2 + x + 1) / 6 - np.arctan((2 * x + 1) / np.sqrt(3)) / np.sqrt(3)

    def elastic(gone: float) -> float:
        wanted, top = integral(np.log(stretch - 1)) - gone / 3, np.log(stretch - 1)
        return 1 + np.exp(brentq(lambda above: integral(above) - wanted, top - gone - 10, top + 1, xtol=1e-13))

    total = np.full(times.size, gent_pull(np.array(stretch)))
    for modulus, time in BRANCHES:
        x = np.array([elastic(t / time) for t in times])
        total += modulus * (x**2 - 1 / x) / stretch
    return total


def dynamic(frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turned = [(3 * modulus, 2 * np.pi * frequencies * time) for modulus, time in BRANCHES]
    storage = 3 * MODULUS + sum(m * w**2 / (1 + w**2) for m, w in turned)
    return storage, sum(m * w / (1 + w**2) for m, w in turned)


def made_tests(
    rng: np.random.Generator, *, relative: float = 0.02, absolute: float = 3.0, scatter: float = 0.0, copies: int = 1
) -> list[MaterialTest]:
    """Pulls, a relaxation, dynamic moduli, an equal-biaxial pull, each of `copies` specimens with errors of given sizes."""

    def read(values: np.ndarray, factor: float) -> np.ndarray:
        return factor * values * (1 + relative * rng.normal(size=values.size)) + absolute * rng.normal(size=values.size)

    frequencies = np.geomspace(1e-3, 10.0, 25)
    ramp, long, slow, both = (
        np.linspace(0.2, 12.0, 40),
        np.r_[0.0, np.geomspace(0.05, 400.0, 49)],
        *(np.linspace(1.1, top, 30) for top in (4.0, 2.5)),
    )
    made: dict[str, Callable[[Callable[[np.ndarray], np.ndarray]], dict]] = {
        "tension": lambda say: {"times": ramp, "stretch": 1 + 1e-4 * ramp, "stress": say(small_ramp(ramp, 1e-4))},
        "relaxation": lambda say: {"times": long, "stretch": np.full(50, 2.0), "stress": say(held(long, 2.0))},
        "cycles": lambda say: {"stretch": slow, "stress": say(gent_pull(slow))},
        "equibiaxial": lambda say: {"stretch": both, "stress": say(gent_equibiaxial(both))},
        "dma": lambda say: (
            {"frequencies": frequencies} | dict(zip(("storage", "loss"), map(say, dynamic(frequencies)), strict=True))
        ),
    }
    found = []
    for kind, make in made.items():
        for copy in range(copies):
            factor = 1 + scatter * rng.normal()
            found.append(MaterialTest(name=f"{kind} {copy}", kind=kind, **make(lambda values: read(values, factor))))  # noqa: B023
    return found
