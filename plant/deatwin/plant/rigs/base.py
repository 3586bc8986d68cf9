"""Base class of rigs: kinematics, loads and a reading, written as equations."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from enum import Enum
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

from deatwin.plant.arguments import of_plain_data
from deatwin.plant.builder import Builder
from deatwin.plant.chain import MeasuringChain
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import catalogue, machine_catalogue
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.errors import DeatwinError, RigError
from deatwin.plant.parameters import Parameter, ParameterSet
from deatwin.plant.readings import ROOM_TEMPERATURE, Reading, readings_from
from deatwin.plant.rigfaults import users_code
from deatwin.plant.rigs.stated import require_number, require_sizes, require_stated
from deatwin.plant.substance import Material
from deatwin.plant.supply import Supply, supply_from

if TYPE_CHECKING:
    from deatwin.plant.model import Plant
    from deatwin.plant.simulate import Runner, Simulator


SOLVED = 1e-6  # Accuracy of a simulation as a share of the motion; recordings without noise agree no better


class ReadingTime(Enum):
    """Time at which the reading of a sample is taken, relative to the command of the same sample.

    - ``START_OF_HOLD``: the reading is taken when the command is applied;
    - ``END_OF_HOLD``: the reading is taken after the command was held for one sample time;
    - ``MEAN_OVER_HOLD``: the reading is the mean over the time for which the command is held.
    """

    END_OF_HOLD = "end of hold"
    START_OF_HOLD = "start of hold"
    MEAN_OVER_HOLD = "mean over the hold"

    @property
    def other_end(self) -> ReadingTime:
        """Other end of the hold: ``START_OF_HOLD`` for ``END_OF_HOLD``, and otherwise ``END_OF_HOLD``."""
        return ReadingTime.START_OF_HOLD if self is ReadingTime.END_OF_HOLD else ReadingTime.END_OF_HOLD


@dataclass(frozen=True, kw_only=True)
class StartProcedure:
    """Commands before the first sample of an experiment: from rest to the first command.

    Parameters
    ----------
    rest_command : float
        Command at which the plant rests before the experiment, in the command's unit.
    ramp : float
        Duration of the linear change from the rest command to the first command, s.
    hold : float
        Time between the end of the ramp and the first sample, s; the first command is held during this time.
    uncounted : float
        Duration after the first sample in which a fit ignores the readings, s, because they depend on an unknown motion
        before the first sample. A fit ignores at most a tenth of the experiment.
    """

    rest_command: float = 0.0
    ramp: float = 0.0
    hold: float = 0.0
    uncounted: float = 0.0

    def __post_init__(self) -> None:
        require_number("rest_command of the start", self.rest_command, least=-math.inf)
        for name in ("ramp", "hold", "uncounted"):
            require_number(f"{name} of the start", getattr(self, name), least=0.0)


@dataclass(frozen=True, kw_only=True)
class Rig(ABC):
    """Base class of rigs: experimental set-ups with kinematics, loads, drive and sensor.

    Parameters
    ----------
    sample_time : float
        Sample time, s.
    noise : float
        Standard deviation of the sensor noise, in the reading's SI unit.
    reading : ReadingTime
        Time within a sample at which the reading is taken.
    model_error : float
        Rms error of the reading that remains after a calibration because the rig's equations are simplified, in the
        reading's SI unit.
    command_range : tuple of float, or None
        Lowest and highest command of the drive, in the command's unit; None if unknown.
    chain : MeasuringChain, or None
        Properties of drive and sensor; if None, readings have only white noise with the standard deviation `noise`.
    further : tuple of Reading
        Readings of further sensors, taken at the same times as the first reading, which every rig has.
    supply : Supply, optional
        Known limits of the voltage source, for rigs with electrodes; None for an ideal voltage source.
    """

    sample_time: float
    noise: float
    reading: ReadingTime = ReadingTime.END_OF_HOLD
    model_error: float = 0.0
    command_range: tuple[float, float] | None = None
    chain: MeasuringChain | None = None
    further: tuple[Reading, ...] = ()
    supply: Supply | None = None

    kind: ClassVar[str]
    input_name: ClassVar[str]
    input_unit: ClassVar[str]
    output_name: ClassVar[str]
    output_unit: ClassVar[str]
    model_share: ClassVar[float] = 0.0
    """Rms error of the rig's equations, divided by the standard deviation of the reading. The larger of this error and
    `model_error` counts."""
    follows_at_once: ClassVar[bool] = False
    """True if the reading follows the command without any dynamics."""
    equations_known: ClassVar[bool] = True
    """False for a `ForeignRig`, whose model was written elsewhere; `write` then states only its drive and sensor."""
    has_film: ClassVar[bool] = False
    """True if the rig contains an elastomer film."""
    offers: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """SI units of the signals that a further sensor can measure, by name; without a film's electrical signals."""
    sizes: ClassVar[Sizes | None] = None
    """Sizes to which the catalogue's effects are scaled; None for those of the diaphragm."""

    def __post_init__(self) -> None:
        if self.has_film:  # other rigs may use the same names for other quantities
            require_sizes(self)

    @property
    def body(self) -> str:
        """Return the name of the moving part for sentences, from `sizes`; ``moving part`` by default."""
        named = (self.sizes or Sizes()).body
        return "moving part" if named == Sizes().body else named

    @property
    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, the first one first."""
        noise = 1e-300 if self.noise == 0.0 else self.noise  # a simulated sensor may have no noise
        first = Reading(name=self.output_name, unit=self.output_unit, noise=noise, model_error=self.model_error)
        return (first, *self.further)

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of the base plant."""

    @property
    def start(self) -> StartProcedure:
        """Return how an experiment starts: by default at rest under a command of 0, without a ramp.

        If recordings begin in an unknown state, `write` may make the initial value of each state a parameter,
        ``build.state(..., start=build.parameter("level_at_start"))``, which a calibration then estimates.
        """
        return StartProcedure()

    def starts_of(self, effects: tuple[Effect, ...]) -> tuple[Parameter, ...]:
        """Return the parameters that describe an unknown initial state.

        Parameters
        ----------
        effects : tuple of Effect
            Effects of the plant.

        Returns
        -------
        tuple of Parameter
            Initial deviations from rest of the slow states, which are those of the film's Maxwell branches and of some
            effects. Empty if the start is known, as it is by default.
        """
        return ()

    @abstractmethod
    def write(self, build: Builder) -> Any:
        """Write the rig's equations.

        Parameters
        ----------
        build : Builder
            Builder to which the states and the equations are added.

        Returns
        -------
        casadi.SX
            Reading, SI.
        """

    def runner(self, simulator: Simulator, parameters: ParameterSet) -> Runner:
        """Return the object that simulates a plant of this rig.

        Parameters
        ----------
        simulator : Simulator
            Compiled equations of the rig and the effects.
        parameters : ParameterSet
            Parameters of the plant.
        """
        return simulator

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `from_dict` makes the same rig."""
        film = getattr(self, "material", None)
        written = {"material": film.to_dict()} if isinstance(film, Material) else {}
        described = {**asdict(self), "reading": self.reading.value, **written}
        if not self.further:
            del described["further"]
        if self.supply is None:
            del described["supply"]
        return described

    @classmethod
    @of_plain_data(RigError)
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make the rig from the `data` of `to_dict`; RigError if a field has a wrong type or is out of range."""
        limits, chain = data["command_range"], data.get("chain")
        read: dict[str, Any] = {
            "reading": ReadingTime(data["reading"]),
            "command_range": tuple(limits) if limits else None,
            "chain": MeasuringChain.from_dict(chain) if chain else None,
            "further": readings_from(data.get("further", ())),
        }
        if isinstance(data.get("supply"), Mapping):
            read["supply"] = supply_from(data["supply"])
        if isinstance(data.get("material"), Mapping):
            read["material"] = Material.from_dict(data["material"])
        rig = cls(**{**data, **read})
        require_stated(rig)
        return rig

    def with_effects(self, *effects: Effect) -> Plant:
        """Return the plant of this rig with `effects`; without effects, it is the base plant."""
        from deatwin.plant.model import Plant  # a plant is made of rigs, so the module cannot be loaded first

        return Plant(rig=self, effects=effects)

    def effects(self) -> tuple[Effect, ...]:
        """Return the effects that a diagnosis tries on this rig: by default the catalogue, scaled to the rig.

        A rig without a film also has the effects of machines: relaxation, dead zone, backlash, and dry friction that
        depends on speed and direction. Override this method to add effects of your own.

        Returns
        -------
        tuple of Effect
            Effects, including those that act on a signal that this rig does not have.
        """
        return tuple(self.scaled(effect) for effect in (catalogue() if self.has_film else machine_catalogue()))

    def scaled(self, effect: Effect) -> Effect:
        """Return an effect of the catalogue with values for this rig, by default at its `sizes`."""
        return effect if self.sizes is None else self.sizes.of(effect)

    def for_motion(self, motion: float) -> Self:
        """Return the rig with the model error of a reading whose standard deviation is `motion`, SI."""
        return replace(self, model_error=max(self.model_error, self.share_of_motion * motion))

    @property
    def averages(self) -> bool:
        """True if each reading is a mean over the hold of a command."""
        return self.reading is ReadingTime.MEAN_OVER_HOLD

    @property
    def reading_size(self) -> float:
        """Typical size of the first reading, SI."""
        sizes = self.sizes or Sizes()
        return sizes.reading or sizes.motion

    @property
    def share_of_motion(self) -> float:
        """Smallest rms error of a simulated reading, divided by the standard deviation of the reading."""
        return max(self.model_share, SOLVED)

    def rivals(self) -> tuple[Self, ...]:
        """Return the other rig variants that may be meant: by default, one with the reading at the other end of the hold.

        There are none for a model that was written elsewhere, whose simulations are costly.
        """
        return (replace(self, reading=self.reading.other_end),) if self.equations_known else ()


@contextmanager
def written(rig: Rig, build: Builder) -> Iterator[Any]:
    """Let a rig write its equations, and return its reading; exceptions from its code become one line."""
    build.share("sample_time", rig.sample_time)
    build.share("follows_at_once", rig.follows_at_once)
    build.share("reading_size", rig.reading_size)
    build.share("averages", rig.averages)
    build.measure("room_temperature", ROOM_TEMPERATURE)  # an effect may replace it
    for reading in rig.further:
        if reading.name == "current":
            build.share("series_resistance", reading.series_resistance)
    with users_code(f"the rig {rig.kind}"):
        yield rig.write(build)


def require_reading_time(value: object, error: type[DeatwinError]) -> None:
    """Raise the error for anything but a `ReadingTime`, such as its text, which no comparison would recognise."""
    if not isinstance(value, ReadingTime):
        raise error(f"reading is {value!r}; it must be one of {', '.join(map(str, ReadingTime))}")


def require_usable(rig: object) -> None:
    """Raise RigError for anything but a rig whose drive and sensor make sense."""
    if not isinstance(rig, Rig):
        given = rig.__name__ if isinstance(rig, type) else repr(rig)
        raise RigError(f"{given} is not a rig: give an object such as Diaphragm()")
    require_number("sample_time", rig.sample_time)
    require_reading_time(rig.reading, RigError)
    if rig.command_range is not None:
        ends = tuple(rig.command_range) if isinstance(rig.command_range, Iterable) else ()
        if len(ends) != 2 or not all(isinstance(end, Real) for end in ends) or not ends[0] <= ends[1]:
            raise RigError(f"command_range is {rig.command_range!r}; it must be the lower end and then the upper one")
    for name, kind in (("chain", MeasuringChain), ("supply", Supply)):
        if not isinstance(value := getattr(rig, name), kind | None):
            raise RigError(f"{name} is {value!r}; it must be a {kind.__name__}, or None")
    if not isinstance(rig.further, tuple) or not all(isinstance(one, Reading) for one in rig.further):
        raise RigError(f"further is {rig.further!r}; it must be a tuple of Reading")
    rig.readings, rig.start  # noqa: B018  (check noise, model error and times)
