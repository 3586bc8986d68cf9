"""Two cascaded tanks that overflow, taken as tanks without a brim (public: Schoukens, Mattsson, Wigren & Noël 2016).

The estimation record is diagnosed, the validation record judges. Both begin at the same unknown levels: the plant has
no start procedure, and its initial states are parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant import Builder, Effect, Experiment, Family, Parameter, Place, Plant, ReadingTime, Rig, Scale, Sizes
from deatwin.plant.effects.smooth import soft_excess
from deatwin.studies.missing_physics import Case, HeldOut, Law, experiment_of, tell
from deatwin.studies.public.records import cascaded_tanks as black_box_data
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

WORDS = Words(__package__)


class TankPlace(Enum):
    """Places that only tanks have."""

    BRIM = "brim"


@dataclass(frozen=True, kw_only=True)
class Tanks(Rig):
    """A pump fills the upper of two tanks, which empties into the lower one; levels in volts of the sensor."""

    sample_time: float = 4.0
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD

    kind: ClassVar[str] = "cascaded-tanks"
    input_name: ClassVar[str] = "pump"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "level"
    output_unit: ClassVar[str] = "V"
    model_share: ClassVar[float] = 0.1  # Outlets after Torricelli, a straight pump
    sizes: ClassVar[Sizes] = Sizes(
        motion=5.0, force=0.1, period=100.0, command=3.0, motion_unit="V", force_unit="V/s", body="level"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="pump", value=0.04, unit="1/s", lower=1e-4, upper=1.0, scale=log),
            Parameter(name="threshold", value=0.5, unit="V", lower=0.0, upper=2.0),
            Parameter(name="upper_outlet", value=0.05, unit="V0.5/s", lower=1e-4, upper=1.0, scale=log),
            Parameter(name="lower_outlet", value=0.05, unit="V0.5/s", lower=1e-4, upper=1.0, scale=log),
            Parameter(name="area_ratio", value=1.0, unit="1", lower=0.1, upper=10.0, scale=log),
            Parameter(name="upper_start", value=5.0, unit="V", lower=0.0, upper=15.0),
            Parameter(name="lower_start", value=5.0, unit="V", lower=0.0, upper=15.0),
        )

    def write(self, build: Builder) -> Any:
        upper = build.watch("upper_level", build.state("upper", scale=5.0, start=build.parameter("upper_start")))
        lower = build.watch("displacement", build.state("lower", scale=5.0, start=build.parameter("lower_start")))
        above = build.place(Place.DRIVE, "command", build.command) - build.parameter("threshold")
        between = build.parameter("upper_outlet") * _root(upper)
        spilt = build.place(TankPlace.BRIM, "spill", ca.SX.zeros(3))
        build.rate(upper, build.parameter("pump") * above - between - spilt[0])
        caught = build.parameter("area_ratio") * (between + spilt[1])
        build.watch("missing", build.parameter("area_ratio") * spilt[1] - spilt[2])
        build.rate(lower, caught - build.parameter("lower_outlet") * _root(lower) - spilt[2])
        return build.place(Place.SENSOR, "reading", lower)

    def effects(self) -> tuple[Effect, ...]:
        return (*super().effects(), Overflow())


def _root(level: Any) -> Any:
    """Square root, straight where the tank is nearly empty."""
    return level / (level**2 + 0.01**2) ** 0.25


@dataclass(frozen=True, kw_only=True)
class Overflow(Effect):
    """Water over the brims, q = r p(h - h_b), p(x) = w ln(1 + e^(x/w)), part of which the lower tank catches."""

    rate: float = 0.2  # r in 1/s
    brim: float = 9.5  # h_b in V of the level's sensor
    caught: float = 0.5  # Share of the upper tank's overflow that the lower one catches

    name: ClassVar[str] = "overflow"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[TankPlace] = TankPlace.BRIM
    signal: ClassVar[str] = "spill"
    strength: ClassVar[str] = "rate"
    wording: ClassVar[str] = (
        "The tanks overflow beyond {brim}, at {rate} times the excess, and a share of {caught} of what the upper "
        "one loses falls into the lower one"
    )
    width: ClassVar[float] = 0.05  # w in V

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="rate", value=self.rate, unit="1/s", lower=0.0, upper=2.0),
            Parameter(name="brim", value=self.brim, unit="V", lower=1.0, upper=20.0),
            Parameter(name="caught", value=self.caught, unit="1", lower=0.0, upper=1.0),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        rate, brim, caught = (self.own(name, build) for name in ("rate", "brim", "caught"))
        upper, lower = (
            rate * soft_excess(build.signal(name) - brim, self.width) for name in ("upper_level", "displacement")
        )
        return signal + ca.vertcat(upper, caught * upper, lower)


def run(setting: Setting) -> Mapping[str, Any]:
    """Diagnose the estimation record, and run free over the validation record."""
    return tell(setting, "cascaded_tanks", case)


def case(folder: Path) -> Case:
    """The recordings and the plant."""
    data = black_box_data(folder)
    fitted, judged = (
        experiment_of(Tanks(), record.inputs[0], record.outputs[0], provenance=record.provenance)
        for record in (data.train, data.test)
    )
    return Case(
        name="cascaded-tanks",
        title="Cascaded tanks",
        documented=("overflow", "sensor_saturation"),
        plant=Plant(rig=Tanks()),
        fitted=(fitted,),
        held_out=(HeldOut(name="The validation record", experiment=judged, black_box=data),),
        unit="V",
        scale=1.0,
        files=data.files,
        law=lambda amended: _law(amended, judged),
        notes=WORDS.texts("cascaded_tanks.notes"),
    )


def _law(amended: Plant, judged: Experiment) -> Law:
    """Inflow of the lower tank that the flow from tank to tank in the amended plant does not explain."""
    p = {name: q.value for name, q in amended.parameters.items()}
    run = amended.simulate(judged).require()
    signals, level = run.watched[0], judged.recordings[0].outputs[0]
    flow = p["area_ratio"] * p["upper_outlet"] * np.sqrt(signals["upper_level"]) - p["lower_outlet"] * np.sqrt(level)
    return Law(
        state="level of the upper tank (V)",
        force="missing inflow of the lower tank (V/s)",
        measured=(signals["upper_level"], np.gradient(level, amended.rig.sample_time) - flow),
        modelled=(signals["upper_level"], signals["missing"]),
        caption=WORDS.text("cascaded_tanks.law"),
    )
