"""A plant as an FMU for model exchange (FMI 3.0, Modelica Association 2022), by CasADi's ``DaeBuilder.export_fmu``.

Algebraic coordinates and states without inertia are solved inside by Newton's method. Parameters are numbers in the
code, because the state of rest at the start depends on them.
"""

from __future__ import annotations

import contextlib
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.arguments import file_name, taking
from deatwin.plant.equations import SAMPLE_START
from deatwin.plant.errors import ModelError
from deatwin.plant.export.archive import compiled, write_fmu
from deatwin.plant.export.description import Description
from deatwin.plant.export.plant_step import describe, plant_signals, rest_of
from deatwin.plant.export.sampled import Signal, require_identifier
from deatwin.plant.model import Plant, require_plant
from deatwin.plant.readings import ROWS
from deatwin.plant.rest import RestState

_TOLERANCE = 1e-12  # Tolerance of the algebraic equations, in units of the unknowns' typical sizes
_UPDATES = 50
_UNITS = "states in units of their typical sizes; time is the experiment's clock"
_SETS_TIME = ("  m->t = time;\n", "  m->t = startTime;\n")
_FRESH = "  m->up_to_date = 0;\n"
"""Patch for CasADi 3.8, which does not recompute time-dependent values when time is set."""
_NO_INDICATORS = "  // No zero crossings\n  return fmi3%s;\n"
"""End of a function of CasADi 3.8 that fails if there are no event indicators, although a solver may ask for none."""


@taking(path=file_name)
def export_model_exchange(plant: Plant, path: str | Path, *, name: str = "plant") -> Path:
    """Export a plant as an FMU (functional mock-up unit, FMI 3.0) for model exchange.

    The FMU contains the C source and a binary for this computer. The command is a discrete input, which the importing
    tool holds constant between events. The outputs are the readings and other signals of the plant, such as
    ``signal.film_voltage``. A reading that is a mean over a sample, such as a current, is not among the outputs. The
    independent variable is the time on the experiment's clock.

    Parameters
    ----------
    plant : Plant
        Plant whose equations contain no earlier commands; an effect such as `Delay` adds earlier commands.
    path : path
        File to write, ``.fmu``; an existing file is replaced.
    name : str
        Model identifier; a valid C identifier.

    Returns
    -------
    Path
        Path of the written file.

    Raises
    ------
    ModelError
        If the plant has no state of rest, the equations contain earlier commands, the installed CasADi is too old, or
        the FMI headers or a C compiler is missing.
    DataError
        If the file cannot be written.
    """
    require_plant(plant, "an export")
    require_identifier(name)
    if not hasattr(ca.DaeBuilder, "export_fmu") or not hasattr(ca.DaeBuilder, "compile_fmu"):
        raise ModelError(f"CasADi {version('casadi')} does not export FMI 3.0; install casadi>=3.8")
    require_no_memory(plant)
    rest = rest_of(plant)
    inputs, outputs = plant_signals(plant, rest)
    outputs = tuple(signal for signal in outputs if signal.name not in means_over_samples(plant))
    parts = _Parts(plant, rest)
    builder = _builder(parts, name, inputs, outputs)
    with TemporaryDirectory() as folder, contextlib.chdir(folder):  # CasADi writes into the working folder
        files = builder.export_fmu({"no_warning": True, "with_serialization": False})
        contents = {target.removeprefix("./"): Path(file).read_bytes() for file, target in files.items()}
        wrapper = f"sources/{name}_wrap.c"
        contents[wrapper] = _refreshed(contents[wrapper].decode()).encode()
        description = Description(
            name=name,
            plain=contents["modelDescription.xml"],
            inputs=inputs,
            outputs=outputs,
            start=parts.start,
            sample_time=plant.rig.sample_time,
            text=f"{described(plant)}; {_UNITS}",
        )
        contents["modelDescription.xml"] = description.tidied()
    return write_fmu(path, compiled(contents, name))


def means_over_samples(plant: Plant) -> tuple[str, ...]:
    """Return the further readings that are mean rates over a sample, such as a current."""
    further = plant.equations.further
    if further is None:
        return ()
    stored = np.split(np.array(ca.vertsplit(further(*further.sx_in()))), ROWS)[1]
    return tuple(one.name for one, rate in zip(plant.rig.further, stored, strict=True) if not rate.is_zero())


def described(plant: Plant) -> str:
    """Describe the plant, as an FMU for model exchange, in a few words."""
    means = " and ".join(means_over_samples(plant))
    return describe(plant) + (
        f", without {means}: an FMU for model exchange has no samples to take a mean over" if means else ""
    )


def require_no_memory(plant: Plant) -> None:
    """Raise an error if a plant needs earlier commands, or the time at which a sample begins."""
    if not _has_memory(plant):
        return
    at_fault = [e.name for e in plant.effects if _has_memory(plant.without_effects().with_effects(e))] or ["the rig"]
    raise ModelError(
        f"{', '.join(at_fault)}: needs the commands of earlier samples, which an FMU for model exchange does not have; "
        "export for co-simulation (fmu-cs) or as C, which go sample by sample"
    )


def _has_memory(plant: Plant) -> bool:
    return bool(plant.equations.history) or SAMPLE_START in plant.equations.channels


def _refreshed(wrapper: str) -> str:
    """Return a wrapper that recomputes time-dependent values whenever time is set, and has no event indicators."""
    patches = {line: line + _FRESH for line in _SETS_TIME} | {_NO_INDICATORS % "Fatal": _NO_INDICATORS % "OK"}
    for line, patched in patches.items():
        if wrapper.count(line) != 1:
            raise ModelError(f"the FMU that CasADi {version('casadi')} writes is not of the form known here (3.8)")
        wrapper = wrapper.replace(line, patched)
    return wrapper


def _builder(parts: _Parts, name: str, inputs: tuple[Signal, ...], outputs: tuple[Signal, ...]) -> ca.DaeBuilder:
    builder = ca.DaeBuilder(name)
    time = builder.add("time", "independent")
    states: list[Any] = [
        builder.add(state, "local", "continuous", {"start": value}) for state, value in parts.start.items()
    ]
    given = [builder.add(s.name, "input", "discrete", {"start": s.start}) for s in inputs]
    rates, readings = parts.evaluated(ca.vertcat(*states) if states else ca.MX(0, 1), ca.vertcat(*given), time)
    for state, rate in zip(states, ca.vertsplit(rates) if states else [], strict=True):
        builder.eq(builder.der(state), rate)
    for signal, value in zip(outputs, ca.vertsplit(readings), strict=True):
        builder.eq(builder.add(signal.name, "output", "continuous", {}), value)
    return builder


class _Parts:
    """Equations with states scaled to order one, and with the algebraic part eliminated."""

    def __init__(self, plant: Plant, rest: RestState) -> None:
        equations, values = plant.equations, plant.free_values
        n_x, scale = len(equations.states), equations.scale
        mass = np.asarray(equations.mass(values, equations.constants)).ravel()
        moving = np.flatnonzero(mass)
        algebraic = np.setdiff1d(np.arange(scale.size), moving)
        at_rest = np.concatenate([rest.x, rest.z]) / scale
        self.start = {f"state.{equations.states[k]}": float(at_rest[k]) for k in moving}
        self._guess = at_rest[algebraic]
        known = ca.SX.sym("x", moving.size), ca.SX.sym("u", equations.held_inputs(0.0).size), ca.SX.sym("t")
        unknown = ca.SX.sym("z", algebraic.size)
        w = ca.SX(scale.size, 1)
        w[moving.tolist()], w[algebraic.tolist()] = known[0], unknown
        w *= scale
        point = (w[:n_x, :], w[n_x:, :], rest.d, *known[1:], values, equations.constants)
        residual = equations.dynamics(*point)
        rates = residual[moving.tolist()] / (mass * scale[:n_x])[moving]
        levels = [
            level
            for level, one in zip(ca.vertsplit(equations.outputs(*point))[1:], plant.rig.further, strict=False)
            if one.name not in means_over_samples(plant)
        ]
        readings = ca.vertcat(equations.output(*point), *levels, ca.densify(equations.watched(*point)))
        self._values = ca.Function("values", [unknown, *known], [ca.densify(rates), readings])
        problem = {"x": unknown, "p": ca.vertcat(*known), "g": ca.densify(residual[algebraic.tolist()])}
        options = {"abstol": _TOLERANCE, "max_iter": _UPDATES}
        self._solve = ca.rootfinder("algebraic", "fast_newton", problem, options) if algebraic.size else None

    def evaluated(self, states: ca.MX, inputs: ca.MX, time: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return rates of the states, and the reading with watched signals."""
        solved = ca.MX(0, 1) if self._solve is None else self._solve(self._guess, ca.vertcat(states, inputs, time))
        rates, readings = self._values(solved, states, inputs, time)
        return rates, readings
