"""A motor as a rig of deatwin and as a callable written elsewhere: the exact solution under held voltages."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import sleep
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.plant import Builder, Effect, Experiment, Parameter, Place, Plant, Recording, Rig, Scale, Sizes
from deatwin.plant.foreign import ForeignRig

SAMPLE = 0.01
PARAMETERS = (
    Parameter(name="resistance", value=2.0, unit="V/A", lower=0.1, upper=10.0, known=True),
    Parameter(name="constant", value=0.048, unit="V s", lower=0.005, upper=0.5, known=True),
    Parameter(name="inertia", value=1e-4, unit="kg m2", lower=1e-6, upper=1e-2, scale=Scale.LOGARITHMIC),
    Parameter(name="drag", value=1e-5, unit="N m s", lower=1e-7, upper=1e-2, scale=Scale.LOGARITHMIC),
)
SIZES = Sizes(
    motion=5.0,
    force=0.02,
    period=0.1,
    command=3.0,
    reading=50.0,
    body="rotor",
    motion_unit="rad",
    force_unit="N m",
    reading_unit="rad/s",
)


@dataclass(frozen=True, kw_only=True)
class Motor(Rig):
    sample_time: float = SAMPLE
    noise: float = 0.05

    kind: ClassVar[str] = "motor"
    input_name: ClassVar[str] = "voltage"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "speed"
    output_unit: ClassVar[str] = "rad/s"
    sizes: ClassVar[Sizes] = SIZES

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return PARAMETERS

    def write(self, build: Builder) -> Any:
        speed, constant = build.state("speed", scale=50.0), build.parameter("constant")
        command = build.place(Place.DRIVE, "command", build.command)
        voltage = build.place(Place.DRIVE, "amplifier_voltage", command)
        torque = constant * (voltage - constant * speed) / build.parameter("resistance")
        build.rate(speed, torque - build.parameter("drag") * speed, mass=build.parameter("inertia"))
        return build.place(Place.SENSOR, "reading", speed)


def motor(
    parameters: Mapping[str, Any], inputs: Mapping[str, NDArray[np.float64]], time: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Speed at the end of each sample; parameters are numbers, or one for each sample."""
    ohms, constant, inertia, drag = (
        np.broadcast_to(parameters[n], time.shape) for n in ("resistance", "constant", "inertia", "drag")
    )
    rate = -(constant**2 / ohms + drag) / inertia
    kept = np.exp(rate * SAMPLE)
    gained = (kept - 1) / rate * constant / ohms / inertia * inputs["voltage"]
    speed, found = 0.0, np.empty(time.size)
    for k in range(time.size):
        speed = kept[k] * speed + gained[k]
        found[k] = speed
    return found


def heavy_motor_raises(parameters: Mapping[str, Any], inputs: Any, time: Any) -> Any:
    if parameters["inertia"] > 1.3e-4:
        raise FloatingPointError("the rotor\nleft its range")
    return {"speed": motor(parameters, inputs, time), "current": 0.0 * time}


def heavy_motor_crashes(parameters: Mapping[str, Any], inputs: Any, time: Any) -> Any:
    if parameters["inertia"] > 1.3e-4:
        os._exit(11)
    return motor(parameters, inputs, time)


def heavy_motor_hangs(parameters: Mapping[str, Any], inputs: Any, time: Any) -> Any:
    if parameters["inertia"] > 1.3e-4:
        sleep(600.0)
    return motor(parameters, inputs, time)


FOREIGN = ForeignRig(
    model=motor,
    parameters=PARAMETERS,
    sizes=SIZES,
    sample_time=SAMPLE,
    noise=0.05,
    input_name="voltage",
    input_unit="V",
    output_name="speed",
    output_unit="rad/s",
)


def plants(*effects: Effect, **fields: Any) -> tuple[Plant, Plant]:
    """The native plant and the foreign one."""
    return Plant(rig=Motor(), effects=effects), Plant(rig=replace(FOREIGN, **fields), effects=effects)


def commands(count: int = 400, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-3.0, 3.0, count // 20), 20) + np.repeat(rng.uniform(-0.5, 0.5, count // 4), 4)


def experiment(held: NDArray[np.float64], readings: NDArray[np.float64] | None = None) -> Experiment:
    read = np.zeros(held.size) if readings is None else readings
    return Experiment(recordings=(Recording.from_arrays(held, read, SAMPLE),))
