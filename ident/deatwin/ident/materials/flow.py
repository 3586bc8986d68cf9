"""Stress of a material's point in a test, by the laws of all rigs, along a path of stretches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.laws.stress import nominal_stress

STRETCHES: Mapping[str, Callable[[Array], Array]] = MappingProxyType(
    {
        "uniaxial": lambda stretch: stretch**-0.5,
        "equibiaxial": lambda stretch: stretch,
        "pure shear": np.ones_like,
    }
)
"""Stretch perpendicular to the pull, by deformation; in each, the film is free in the third direction."""
_GAMMA = 0.4358665215084590  # root of x^3/6 - 3 x^2/2 + 3 x - 1, which makes Alexander's three stages stiffly accurate
_FIRST, _SECOND = -(6 * _GAMMA**2 - 16 * _GAMMA + 1) / 4, (6 * _GAMMA**2 - 20 * _GAMMA + 5) / 4
_STAGES = ((), ((1 - _GAMMA) / 2,), (_FIRST, _SECOND))
_PARTS = 4  # Parts of a step: a jump to a stretch of 4 is then followed to 2e-4 if a sample lasts 0.4 relaxation times
_NEWTON = 6  # Iterations of each stage: the flow is convex, so they converge from one side, to below 1e-9 after six


def elastic_stress(energy: Callable[..., Any], stretches: Array, values: Array) -> tuple[Array, Array]:
    """Nominal stress along the pull, Pa, and its derivatives, (n,), (n, k). Shapes: `stretches` (2, n)."""
    stress, slopes = _elastic(energy, values.size)(*stretches[:, None, :], values[:, None])
    return np.asarray(stress).ravel(), np.asarray(slopes).reshape(values.size, -1, order="F").T


@lru_cache(maxsize=64)
def _elastic(energy: Callable[..., Any], count: int) -> ca.Function:
    first, second, p = ca.SX.sym("first"), ca.SX.sym("second"), ca.SX.sym("p", count)
    stress, _ = nominal_stress(energy, first, second, *ca.vertsplit(p))
    return ca.Function("elastic", [first, second, p], [stress, ca.densify(ca.jacobian(stress, p)).T])


def branch_stress(times: Array, stretches: Array, relaxation: Array) -> Array:
    """Nominal stress (n, m) of Maxwell branches for a shear modulus of 1, from rest at stretch 1, by `PointwiseFilm`'s
    flow, da_i/dt = d(ln lambda_i)/dt - (sigma_i - sigma_j/2) / (3 mu tau) for a_i = ln(lambda_i/xi_i). Shapes: `times`
    (n,), s, from 0 on; `stretches` (2, n); `relaxation` (m,), s."""
    paths = np.log(stretches)
    steps = np.diff(times, prepend=0.0)
    # The path from time 0 to the first sample is even; a first sample at time 0 was reached at once.
    start = paths[:, 0] if times[0] == 0.0 else np.zeros(2)
    moves = np.diff(paths, axis=1, prepend=start[:, None])
    march = _march(times.size)
    found = np.empty((times.size, relaxation.size))
    for k, time in enumerate(relaxation):
        elastic = np.exp(2.0 * np.asarray(march(start, moves, steps[None, :] / time)))
        found[:, k] = (elastic[0] - 1.0 / (elastic[0] * elastic[1])) / stretches[0]
    return found


@lru_cache(maxsize=64)
def _march(count: int) -> ca.Function:
    return _step().mapaccum("march", count)


@lru_cache(maxsize=1)
def _step() -> ca.Function:
    """Advance by one step of given strain and given share of the relaxation time, divided into `_PARTS`."""
    strain, move, share = ca.SX.sym("strain", 2), ca.SX.sym("move", 2), ca.SX.sym("share")
    end = strain
    for _ in range(_PARTS):
        end = _part(end, move / _PARTS, share / _PARTS)
    return ca.Function("step", [strain, move, share], [end])


def _part(strain: Any, move: Any, share: Any) -> Any:
    """Advance by an L-stable method of third order."""
    rates: list[Any] = []
    stage = strain
    for weights in _STAGES:
        known = strain + sum((weight * rate for weight, rate in zip(weights, rates, strict=True)), ca.SX(2, 1))
        for _ in range(_NEWTON):
            flow, slope = _flow(stage)
            residual = stage - known - _GAMMA * (move - share * flow)
            stage = stage - ca.solve(ca.SX.eye(2) + _GAMMA * share * slope, residual)
        rates.append(move - share * _flow(stage)[0])
    return stage


def _flow(strain: Any) -> tuple[Any, Any]:
    """Return the flow rate of a branch for a unit relaxation time, and its derivative."""
    squares = ca.exp(2 * strain)
    across = 1 / (squares[0] * squares[1])
    stresses = squares - across
    flow = ca.vertcat(stresses[0] - stresses[1] / 2, stresses[1] - stresses[0] / 2) / 3
    first, second, third = 2 * squares[0], 2 * squares[1], across  # derivatives; half of it for the third
    rows = ca.horzcat(first + third, third - second / 2), ca.horzcat(third - first / 2, second + third)
    return flow, ca.vertcat(*rows) / 3


def dynamic_shares(frequencies: Array, relaxation: Array) -> tuple[Array, Array]:
    """Return storage and loss of branches with a modulus of 1. Shapes: (n,) in Hz, (m,) in s; returns (n, m) each."""
    turned = 2.0 * np.pi * frequencies[:, None] * relaxation
    return turned**2 / (1.0 + turned**2), turned / (1.0 + turned**2)
