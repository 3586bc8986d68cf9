"""A rig whose model was written elsewhere, between a drive and a sensor to which effects can be added."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite
from numbers import Real
from typing import Any, ClassVar, Self

from deatwin.plant.arguments import of_plain_data
from deatwin.plant.arrays import texts
from deatwin.plant.chain import MeasuringChain
from deatwin.plant.effects.base import Builder, Effect, Family, Place
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.foreign.calls import Model
from deatwin.plant.foreign.fmu import FmuModel
from deatwin.plant.foreign.runner import AFTER, APPLIED, BEFORE, VARYING, ForeignRunner
from deatwin.plant.laws.permittivity import relaxing
from deatwin.plant.parameters import Parameter, ParameterSet, Scale
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure
from deatwin.plant.simulate import Runner, Simulator
from deatwin.plant.words import spaced


@dataclass(frozen=True, kw_only=True)
class ForeignRig(Rig):
    """Rig whose readings are computed by a Python callable, the model.

    The call is ``model(parameters, inputs, time)``. `parameters` is a mapping of names to values. `inputs` is a mapping
    of the names of the command and of the channels to arrays of shape (n,). `time` (s) is an array of shape (n,) with
    uniform times from the first to the last sample of an experiment. The model returns the reading at these times, as
    an array of shape (n,) or as a mapping of names to such arrays, of which only the one called `output_name` is used.
    The model sets its own initial state, and it must be deterministic: the same arguments give the same reading.

    Effects can change the command, the readings, and the parameters in `varying`. If an effect changes the command
    within a sample, the model gets the mean of the changed command over the sample. Derivatives of the readings with
    respect to parameters are central differences. Worker processes compute them in parallel if the model can be
    pickled. An error or a crash of the model ends only the simulation in which it occurs.

    Parameters
    ----------
    model : callable
        The model: a function, or a hashable object that can be called.
    parameters : tuple of Parameter
        Parameters of the model, with values, units and ranges.
    sizes : Sizes
        Typical command, motion and time constant, to which the effects of the catalogue are scaled.
    input_name, input_unit : str
        Name and unit of the command.
    output_name, output_unit : str
        Name and unit of the reading.
    channels : tuple of tuple of str and float
        Further measured inputs of the model: pairs of a name and a value. The value is used if a recording lacks the
        channel.
    rest_command : float
        Command before the first sample, in `input_unit`.
    varying : tuple of str
        Names of the parameters that may drift. If a `ParameterDrift` acts on a parameter, the model gets an array of
        shape (n,) as the value of that parameter.
    step : float
        Relative step of the central differences. It is relative to the parameter's value, or to a tenth of the
        parameter's range if the scale of the parameter is linear and a tenth of the range is larger. The step should be
        at least the cube root of the relative numerical error of the readings; for an adaptive solver, this error is
        its tolerance.
    longest : float
        Longest time that a run of the model in a worker process may take, s; a longer run counts as crashed. Infinite
        by default.
    sample_time, noise, reading, model_error, command_range, chain, supply
        Same as in `Rig`.
    further : tuple of Reading
        Must be empty, because a foreign model gives one reading.

    Raises
    ------
    RigError
        If the model is not callable or not hashable, `sizes` is not a `Sizes`, `step` or `longest` is not above 0, a
        name or a unit is not text, a channel is not a pair of a name and a finite number, a name in `varying` is not that of a parameter, or `further` is not empty.
    """

    model: Model
    parameters: tuple[Parameter, ...] = ()
    sizes: Sizes  # type: ignore[misc]
    input_name: str  # type: ignore[misc]
    input_unit: str  # type: ignore[misc]
    output_name: str  # type: ignore[misc]
    output_unit: str  # type: ignore[misc]
    channels: tuple[tuple[str, float], ...] = ()
    rest_command: float = 0.0
    varying: tuple[str, ...] = ()
    step: float = 1e-3
    longest: float = float("inf")

    kind: ClassVar[str] = "foreign"
    equations_known: ClassVar[bool] = False
    follows_at_once: ClassVar[bool] = True
    """True, because the model gets one command for each sample, the mean over the sample."""

    def __post_init__(self) -> None:
        if not callable(self.model):
            raise RigError(f"a foreign model must be callable; a {type(self.model).__name__} is not")
        try:
            hash(self.model)
        except TypeError:
            raise RigError(
                f"a {type(self.model).__name__} has no hash: make it a function or a frozen dataclass"
            ) from None
        if not isinstance(self.sizes, Sizes):
            raise RigError(
                f"sizes is {self.sizes!r}; give the typical sizes, as Sizes(command=200.0, motion=60.0, period=300.0)"
            )
        for name in ("step", "longest"):
            if not (isinstance(value := getattr(self, name), Real) and float(value) > 0.0):
                raise RigError(f"{name} is {value!r}; it must be a number above 0")
        for name in ("input_name", "input_unit", "output_name", "output_unit"):
            if not isinstance(value := getattr(self, name), str):
                raise RigError(f"{name} is {value!r}; it must be text")
        pairs = self.channels.items() if isinstance(self.channels, Mapping) else self.channels
        for pair in pairs if isinstance(pairs, Iterable) else [pairs]:
            name, value = pair if isinstance(pair, tuple | list) and len(pair) == 2 else (None, None)
            if not (isinstance(name, str) and isinstance(value, Real) and isfinite(value)):
                raise RigError(f'{pair!r} is not a channel; give a name and a number, as ("temperature", 20.0)')
        object.__setattr__(self, "channels", tuple((str(name), float(value)) for name, value in pairs))
        if self.further:
            raise RigError("a foreign model gives one reading; leave `further` empty")
        known = ParameterSet(self.parameters)
        object.__setattr__(self, "varying", texts(self.varying))
        for name in self.varying:
            if name not in known:
                raise RigError(f"{name} varies, but is not a parameter{nearest(name, known)}")

    @property
    def start(self) -> StartProcedure:
        """Start of an experiment: at `rest_command`. The model sets its own initial state."""
        return StartProcedure(rest_command=self.rest_command)

    def effects(self) -> tuple[Effect, ...]:
        return (*super().effects(), *(ParameterDrift(parameter=name) for name in self.varying))

    def write(self, build: Builder) -> Any:
        applied = build.place(Place.DRIVE, "amplifier_voltage", build.place(Place.DRIVE, "command", build.command))
        if applied is not build.command:
            # The foreign model takes one command per sample, the mean over it: so the applied command is integrated.
            integral = build.state(APPLIED, scale=self.sizes.command * self.sample_time, start=0.0)
            build.rate(integral, applied)
            build.watch(APPLIED, integral)
        for name in self.varying:
            if (value := build.parameter(name)) is not build.own(name):
                build.watch(VARYING + name, value)
        before, after = build.channel(BEFORE, 0.0), build.channel(AFTER, 0.0)
        share = (build.time - build.sample_start) / build.sample_time
        return build.place(Place.SENSOR, "reading", before + share * (after - before))

    def runner(self, simulator: Simulator, parameters: ParameterSet) -> Runner:
        return ForeignRunner(
            model=self.model,
            own=self.parameters,
            channels=self.channels,
            input_name=self.input_name,
            output_name=self.output_name,
            reading=self.reading,
            step=self.step,
            longest=self.longest,
            simulator=simulator,
            parameters=parameters,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data. A function is stored by its name: import its module before you call `from_dict`."""
        plain = {
            f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("model", "parameters", "further")
        }
        return {
            **plain,
            "longest": self.longest if isfinite(self.longest) else None,  # JSON has no infinity
            "reading": self.reading.value,
            "chain": None if self.chain is None else asdict(self.chain),
            "sizes": asdict(self.sizes),
            "own": [{**asdict(p), "scale": p.scale.value} for p in self.parameters],
            "model": self.model_to_dict(),
        }

    def model_to_dict(self) -> Any:
        """Return plain data from which `model_from_dict` restores the model."""
        if isinstance(self.model, FmuModel):
            return {**asdict(self.model), "reading": self.model.reading.value}
        named = getattr(self.model, "__qualname__", type(self.model).__qualname__)
        return f"{getattr(self.model, '__module__', '')}:{named}"

    @classmethod
    def model_from_dict(cls, data: Any) -> Model:
        """Return the model that `model_to_dict` described.

        Parameters
        ----------
        data : str or mapping
            Name of a function, ``module:name``, or the fields of an `FmuModel`.

        Raises
        ------
        RigError
            If the module that defines the model has not been imported.
        """
        if isinstance(data, Mapping):
            tuples = {"inputs": tuple(data["inputs"]), "units": tuple((str(n), str(u)) for n, u in data["units"])}
            return FmuModel(**{**data, **tuples, "reading": ReadingTime(data["reading"])})
        module, _, name = str(data).partition(":")
        found: Any = sys.modules.get(module)
        for part in name.split("."):
            found = getattr(found, part, None)
        if not callable(found):
            raise RigError(
                f"the file names the model {data}, which this program has not imported: import {module} first, in a "
                "program of yours or in the module:function of the command line"
            )
        return found

    @classmethod
    @of_plain_data(RigError)
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the rig that `to_dict` described.

        Parameters
        ----------
        data : mapping
            Plain data that `to_dict` returned.

        Raises
        ------
        RigError
            If the module that defines the model has not been imported.
        """
        own = {**data}
        limits, chain = own.pop("command_range"), own.pop("chain", None)
        parameters = tuple(Parameter(**{**p, "scale": Scale(p["scale"])}) for p in own.pop("own"))
        return cls(
            **{
                **own,
                "model": cls.model_from_dict(own["model"]),
                "parameters": parameters,
                "longest": float("inf") if own["longest"] is None else float(own["longest"]),
                "sizes": Sizes(**own["sizes"]),
                "channels": tuple((str(name), float(value)) for name, value in own["channels"]),
                "varying": tuple(own["varying"]),
                "reading": ReadingTime(own["reading"]),
                "command_range": tuple(limits) if limits else None,
                "chain": MeasuringChain.from_dict(chain) if chain else None,
            }
        )


@dataclass(frozen=True, kw_only=True)
class ParameterDrift(Effect):
    r"""A parameter of the plant relaxes from one value to another during the experiment.

    .. math:: p(t) = p\,\bigl[1 + a(1 - e^{-t/\tau})\bigr]

    p is the value of the plant's parameter at time 0. The effect has no state: the drift depends only on the time, and
    begins at time 0. Signature: a slow change of the reading, of the kind that a change of this parameter causes.
    The effect is off at a = 0.

    Parameters
    ----------
    relative_change : float
        a, the final change divided by the initial value.
    time : float
        :math:`\tau`, the time constant of the drift, s.
    parameter : str
        Name of the plant's parameter that drifts.

    References
    ----------
    Relaxation as one Debye process.
    """

    relative_change: float = -0.1
    time: float = 300.0
    parameter: str

    family: ClassVar[Family] = Family.ENVIRONMENT
    place: ClassVar[Place] = Place.PARAMETER
    strength: ClassVar[str] = "relative_change"

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the effect, which contains the name of the parameter: ``drift_of_stiffness``."""
        return f"drift_of_{self.parameter}"

    @property
    def signal(self) -> str:  # type: ignore[override]
        """Name of the parameter that drifts."""
        return self.parameter

    @property
    def wording(self) -> str:  # type: ignore[override]
        """Sentence about the effect, with the names of its parameters in braces."""
        words = spaced(self.parameter).replace("{", "{{").replace("}", "}}")
        return f"The parameter {words} drifts towards a final change of {{relative_change}} with a time constant of {{time}}"

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the parameters other than the strength."""
        return ("time",)

    def describe(self) -> tuple[Parameter, ...]:
        return (
            # A parameter that changed sign would no longer mean the same.
            Parameter(name="relative_change", value=self.relative_change, unit="1", lower=-0.9, upper=4.0),
            Parameter(name="time", value=self.time, unit="s", lower=20.0, upper=20e3, scale=Scale.LOGARITHMIC),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return relaxing(build.time, signal, self.own("relative_change", build), self.own("time", build))
