"""The car that the plant is held against: equations and integrator of its own, nothing of deatwin.

Momenta instead of velocities, travel instead of the body's height, scipy's Runge-Kutta with step control instead of
fixed implicit steps. Only the road's held samples are the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.plant.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Car:
    """Constants of the car, SI."""

    body: float = 300.0  # Masses, kg
    wheel: float = 38.0
    spring: float = 17.5e3  # N/m
    tyre: float = 180e3
    damper: float = 700.0  # Oil that seeps through the valve, N s/m
    orifice: float = 2000.0  # Oil pressed through a hole, N s²/m²


CAR = Car()


def drive(car: Car, road: Array, step: float) -> tuple[Array, Array, Array]:
    """Drive over a road from rest. Shapes: `road` (n,); returns (n,)."""
    from scipy.integrate import solve_ivp

    def rates(_: float, state: Array, height: float) -> list[float]:
        travel, wheel, up, hop = state
        speed = up / car.body - hop / car.wheel
        strut = car.spring * travel + car.damper * speed + car.orifice * speed * abs(speed)
        return [speed, hop / car.wheel, -strut, strut + car.tyre * (height - wheel)]

    state, travel, speed = np.zeros(4), np.empty(road.size), np.empty(road.size)
    for k, height in enumerate(road):
        state = solve_ivp(rates, (0.0, step), state, args=(height,), rtol=1e-7, atol=1e-9).y[:, -1]
        travel[k], speed[k] = state[0], state[2] / car.body - state[3] / car.wheel
    return travel, speed, -car.orifice * speed * np.abs(speed)
