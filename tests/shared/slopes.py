"""Derivatives against differences: of any function, and of the simulations of a plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.plant import Plant


def differences(function: Callable[[NDArray[np.float64]], object], at: NDArray[np.float64], step: float) -> np.ndarray:
    """Central differences of a function by each entry of its argument, along a last axis of the result."""
    sides = [[np.asarray(function(at + shift)) for shift in (row, -row)] for row in step * np.eye(len(at))]
    return np.stack([(up - down) / (2 * step) for up, down in sides], axis=-1)


def slope_errors(
    plant: Plant, commands: NDArray[np.float64], step: float, share: float = 1e-3, names: Sequence[str] | None = None
) -> dict[str, float]:
    """Relative errors of sensitivities by parameter; of all free ones where none are named.

    The difference is of fourth order, (8 D(h) - D(2h))/(12 h) with D(h) = y(p + h) - y(p - h), in steps of a share of
    the value, or of a share of the range where the value is zero.
    """
    options = {"start": -0.4, "sample_time": 0.02, "rest_command": 0.0}
    values, free = plant.free_values, plant.parameters.free

    def run(at: NDArray[np.float64]) -> NDArray[np.float64]:
        found = plant.simulator.run(commands, values=at, **options)
        assert found.status.ok
        return found.outputs

    exact = plant.simulator.run_with_sensitivities(commands, values=values, **options)
    np.testing.assert_allclose(exact.outputs, run(values), atol=1e-12)
    errors = {}
    for name in free if names is None else names:
        parameter, number = plant.parameters[name], free.index(name)
        h = step * (abs(parameter.value) or share * (parameter.upper - parameter.lower))
        shift = h * np.eye(values.size)[number]
        once, twice = (run(values + k * shift) - run(values - k * shift) for k in (1, 2))
        slope = exact.sensitivities[:, number]
        errors[name] = float(np.linalg.norm((8 * once - twice) / (12 * h) - slope) / np.linalg.norm(slope))
    return errors
