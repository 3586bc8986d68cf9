"""`Plant`: a rig and the effects in it, as immutable data that can be simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from deatwin.plant.arguments import instance, of_plain_data, taking
from deatwin.plant.arrays import require_generator
from deatwin.plant.checks import experiment_for
from deatwin.plant.effects.base import Effect, require_effects
from deatwin.plant.effects.catalogue import effect_from
from deatwin.plant.effects.places import everywhere
from deatwin.plant.effects.sizes import sizes_of, with_sizes
from deatwin.plant.equations import STAGES, Equations
from deatwin.plant.errors import ModelError, RigError
from deatwin.plant.parameters import ParameterSet
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig, require_usable
from deatwin.plant.rigs.catalogue import rig_kind
from deatwin.plant.simulate import Progress, Runner, Simulator
from deatwin.plant.simulation import Simulation
from deatwin.plant.structure import Structure
from deatwin.plant.timeline import Timeline

if TYPE_CHECKING:
    from deatwin.plant.model_error import Discrepancy


@dataclass(frozen=True, kw_only=True, eq=False)
class Plant:
    """Simulation model of an experiment, from the command to the reading: a rig with effects.

    A plant is immutable. Its equations are compiled when they are first needed.

    Parameters
    ----------
    rig : Rig
        Rig, which defines the kinematics, the loads and the reading.
    effects : tuple of Effect
        Effects in any order; an effect may occur only once.
    values : mapping of str to float
        Values of parameters by name, SI. They replace the values in the rig and the effects, for example after a
        calibration.
    stages : int
        Number s of stages of the Radau IIA method, at least 1; the order of the method is 2 s - 1. With five stages
        and one step per sample, the free oscillation of a mode at a third of the sampling rate has an error of 0.001 %
        of its amplitude. Files do not store this number.
    steps : int
        Number of steps per sample, at least 1. A mode that is faster than the samples needs more than one step, and so
        does a friction force that changes abruptly within a sample. Files do not store this number.

    Raises
    ------
    RigError
        If the rig is not a `Rig` or has an invalid property; if an effect is not an `Effect` or occurs twice; if a
        value has an unknown name or is out of range; or if `stages` or `steps` is not an integer of at least 1.

    Examples
    --------
    >>> from deatwin.plant import Creep, Diaphragm, Plant
    >>> Plant(rig=Diaphragm()).with_effects(Creep()).effect_names
    ('creep',)
    """

    rig: Rig
    effects: tuple[Effect, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    stages: int = STAGES
    steps: int = 1

    def __post_init__(self) -> None:
        require_usable(self.rig)
        effects = require_effects(self.effects)
        for name in ("stages", "steps"):
            count = getattr(self, name)
            if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
                raise RigError(f"{name} is {count!r}: it must be a whole number, at least 1")
            object.__setattr__(self, name, int(count))
        # Sorted, so that effects given in any order make the same plant.
        object.__setattr__(self, "effects", tuple(sorted(effects, key=lambda e: e.name)))
        for one, other in pairwise(self.effects):
            if one.name == other.name:
                raise RigError(f"the plant has the effect {one.name} twice; an effect can be in a plant only once")
        instance(Mapping, hint=" from names to numbers", error=RigError)(self.values, "values")
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))
        try:
            self.parameters  # noqa: B018  (checks names and ranges)
        except RigError:
            for effect in self.effects:
                self._require_in_range(effect)
            raise

    def _require_in_range(self, effect: Effect) -> None:
        """Raise RigError if an effect is out of range; say if the range is that of another rig."""
        try:
            effect.describe()
        except RigError as error:
            usual = {one.name: type(one) for one in self.rig.effects()}
            if usual.get(effect.name, type(effect)) is type(effect):
                raise
            raise RigError(
                f"{effect.name}: {error}, as on a diaphragm; take rig.scaled({type(effect).__name__}()), which has the "
                "units and ranges of this rig, and set its values with dataclasses.replace"
            ) from None

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("rig", "effects", "stages", "steps")} | {
            "values": dict(self.values)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)

    @cached_property
    def parameters(self) -> ParameterSet:
        """All parameters of the rig and the effects, with their present values."""
        own = [*self.rig.parameters, *(p for e in self.effects for p in e.parameters)]
        return ParameterSet([*own, *self.rig.starts_of(self.effects)]).with_values(self.values)

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects, in alphabetical order."""
        return tuple(e.name for e in self.effects)

    def lacks(self, effect: Effect) -> bool:
        """Return True if the plant does not contain `effect` at any place."""
        return all(own.cause != effect.cause for own in self.effects)

    @property
    def event_times(self) -> tuple[str, ...]:
        """Names of the parameters that are times of events, such as ``sensor_jump.at``."""
        return tuple(f"{e.name}.{e.event}" for e in self.effects if e.event)

    def with_effects(self, *effects: Effect) -> Plant:
        """Return the plant with additional `effects`; RigError if one is not an `Effect` or is already in the plant."""
        return replace(self, effects=(*self.effects, *effects))

    def without_effects(self, *names: str) -> Plant:
        """Return the plant without the effects with these `names`; if no name is given, without all effects."""
        kept = tuple(effect for effect in self.effects if names and effect.name not in names)
        effects = (p for effect in kept for p in effect.parameters)
        own = {p.name for p in (*self.rig.parameters, *effects, *self.rig.starts_of(kept))}
        return replace(self, effects=kept, values={n: v for n, v in self.values.items() if n in own})

    @taking(values=instance(Mapping, hint=" from names to numbers", error=RigError))
    def with_values(self, values: Mapping[str, float]) -> Plant:
        """Return the plant with new `values` of some parameters, by name, SI; all others keep their values."""
        return replace(self, values={**self.values, **values})

    def with_rig(self, rig: Rig) -> Plant:
        """Return the plant on another `rig` with parameters of the same names."""
        return replace(self, rig=rig)

    @property
    def equations(self) -> Equations:
        """Return the plant's differential-algebraic equations; RigError if its model was written elsewhere."""
        if not self.rig.equations_known:
            raise RigError(
                f"the equations of a {self.rig.kind} model are unknown: it can be simulated, fitted and diagnosed as a "
                "whole, but not linearised, exported or put into a control loop"
            )
        return self._structure.equations

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the internal signals that a simulation returns in `Simulation.watched`."""
        return self._structure.equations.signals

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured inputs on which the plant depends besides the command, such as ``temperature``."""
        return tuple(self._structure.equations.channels)

    def accepts(self, effect: Effect) -> bool:
        """Return True if `effect` can be added: it is not in the plant, and the rig has the signal that it changes."""
        if effect.name in self.effect_names:
            return False
        try:
            self.with_effects(effect).signals  # noqa: B018  (writes the equations)
        except RigError as error:
            if error.__cause__ is not None:  # an error in the effect's own code is no refusal
                raise
            return False
        return True

    @property
    def runner(self) -> Runner:
        """Return the object that simulates this plant."""
        return self.rig.runner(self._structure.simulator.in_steps(self.steps), self.parameters)

    @property
    def simulator(self) -> Simulator:
        """Return the compiled equations, which all plants of the same structure in this process share."""
        self.equations  # noqa: B018  (which must be known)
        return self._structure.simulator.in_steps(self.steps)

    @property
    def _structure(self) -> Structure:
        return Structure.of(self.rig, self.effects, self.parameters, self.stages)

    @property
    def free_values(self) -> np.ndarray:
        """Return the values of the free parameters, shape (n_p,), SI."""
        return self.parameters.array(self.parameters.free)

    def timeline(self, experiment: Experiment) -> Timeline:
        """Return the commands of the start procedure and of an `experiment`, one for each sample."""
        return Timeline.of(experiment, self.rig.start, self.rig.sample_time, self.rig.reading)

    def given(self, timeline: Timeline, count: int | None = None) -> dict[str, Any]:
        """Return the arguments of `Runner.run` for the first `count` samples of a `timeline`; all by default."""
        return {
            "commands": timeline.commands[:count],
            "start": timeline.start,
            "sample_time": timeline.sample_time,
            "rest_command": self.rig.start.rest_command,
            "values": self.free_values,
            "channels": timeline.channels,
        }

    def simulate(self, experiment: Experiment | Recording, *, progress: Progress | None = None) -> Simulation:
        """Simulate an experiment as a free run that starts at rest and includes the start procedure.

        Parameters
        ----------
        experiment : Experiment or Recording
            Experiment to simulate; its readings are not used. A single recording is an experiment of its own.
        progress : callable, optional
            Function that is called with the completed fraction of the simulation, 0 to 1.

        Raises
        ------
        DataError
            If `experiment` is neither an experiment nor a recording, has a sample time other than the plant's, has
            several inputs, or has a command in another unit.
        """
        timeline = self.timeline(experiment_for(self.rig, experiment))
        run = self.runner.run(**self.given(timeline), progress=progress)
        return Simulation.of(run, timeline, self.signals, self.rig)

    def model_error(self, recording: Recording | Experiment) -> Discrepancy:
        """Return the error that remains after this plant is calibrated to a plant with finer equations of its rig.

        The plant with finer equations is simulated with the commands of a recording. The result is cached on disk.

        Parameters
        ----------
        recording : Recording or Experiment
            Recording whose commands are used. A single recording is an experiment of its own, which starts at rest.

        Returns
        -------
        Discrepancy
            Error of the calibrated plant. If the rig has no finer equations, the error is `Rig.model_error` at all
            commands.

        Raises
        ------
        SimulationError
            If one of the two simulations stops early, for example because of pull-in, or if the film with finer
            equations loses tension.
        """
        from deatwin.plant.model_error import discrepancy  # loaded only when needed

        return discrepancy(self.with_rig(replace(self.rig, further=())), experiment_for(self.rig, recording))

    def record(self, experiment: Experiment | Recording, rng: np.random.Generator) -> Experiment:
        """Simulate an experiment and add the noise of the sensors.

        If the rig has a `Rig.chain`, the commands and the first reading pass through this chain, which adds the noise.

        Parameters
        ----------
        experiment : Experiment or Recording
            Experiment whose commands and clock are used. A single recording is an experiment of its own.
        rng : numpy.random.Generator
            Random generator for the noise.

        Returns
        -------
        Experiment
            Experiment with the same commands and with simulated readings, SI.

        Raises
        ------
        DataError
            Same as for `simulate`.
        SimulationError
            If the simulation fails, for example because the film pulls in.
        """
        require_generator(rng)
        rig, given = self.rig, (experiment := experiment_for(self.rig, experiment))
        if rig.chain is not None:
            applied = (replace(r, inputs=rig.chain.applied(r.inputs)) for r in experiment.recordings)
            given = replace(experiment, recordings=tuple(applied))
        outputs = self.simulate(given).require().outputs
        if rig.chain is None:
            noisy = [y[:1] + rig.noise * rng.standard_normal((1, y.shape[1])) for y in outputs]
        else:
            noisy = [rig.chain.record(y[:1], rng, sample_time=rig.sample_time) for y in outputs]
        if rig.further:
            noises = np.array([[reading.noise] for reading in rig.further])
            rest = [y[1:] + noises * rng.standard_normal(y[1:].shape) for y in outputs]
            noisy = [np.vstack(pair) for pair in zip(noisy, rest, strict=True)]
        names, units = (tuple(getattr(reading, part) for reading in rig.readings) for part in ("name", "unit"))
        return Experiment(
            recordings=tuple(
                replace(r, outputs=y, output_names=names, output_units=units)
                for r, y in zip(experiment.recordings, noisy, strict=True)
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data: rig, effects and all parameters with unit, bounds and source."""
        own = _own_effects(self.rig, self.effects)
        sizes = {e.name: sizes_of(e) for e in self.effects if type(e) is not type(own.get(e.name, e))}
        return {
            "rig": {"kind": self.rig.kind, **self.rig.to_dict()},
            "effects": [effect.entry for effect in self.effects],
            **({"sizes": sizes} if sizes else {}),
            "parameters": {p.name: {"value": p.value, "unit": p.unit} for p in self.parameters.values()},
        }

    @classmethod
    @of_plain_data(RigError)
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make the plant from the `data` of `to_dict`; RigError if the rig, an effect or a parameter is unknown."""
        described = dict(data["rig"])
        rig = rig_kind(described.pop("kind")).from_dict(described)
        own, sizes = _own_effects(rig, data["effects"]), data.get("sizes", {})
        effects = [own[e] if isinstance(e, str) and e in own else effect_from(e) for e in data["effects"]]
        effects = [with_sizes(e, sizes[e.name]) if e.name in sizes else e for e in effects]
        try:
            values = {name: float(p["value"]) for name, p in data["parameters"].items()}
        except (TypeError, KeyError, ValueError) as error:
            raise RigError(f"malformed parameters: {error!r}; each needs a number under 'value'") from None
        return cls(rig=rig, effects=tuple(effects), values=values)


def _own_effects(rig: Rig, asked: Sequence[object]) -> dict[str, Effect]:
    """Return a rig's effects at all places, by name; nothing if no effect is `asked` for, because it takes a while."""
    return {effect.name: effect for effect in everywhere(rig.effects())} if asked else {}


def require_plant(plant: object, user: str) -> None:
    """Raise ModelError for anything but a plant, such as a rig; `user` is what needs a plant."""
    if not isinstance(plant, Plant):
        way = "make one of a rig with Plant(rig=...)"
        if isinstance(getattr(plant, "plant", None), Plant):
            way = "give its attribute plant"
        elif isinstance(plant, str | PathLike):
            way = "load_plant(path).plant is the one of a file"
        raise ModelError(f"{user} needs a Plant, not a {type(plant).__name__}: {way}")
