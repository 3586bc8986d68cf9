"""``deatwin export``."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deatwin.app.options import Json, Quiet
from deatwin.studies.voice import Voice

if TYPE_CHECKING:
    from deatwin.plant.export.sampled import SampledSource
    from deatwin.plant.model import Plant


PLANT, NARX, CHECK = "deatwin/plant/1", "deatwin/narx/1", "deatwin/check/1"
STATES = "deatwin/nonlinear-states/1"


class Form(StrEnum):
    """Form of the export."""

    FMU = "fmu"
    FMU_CS = "fmu-cs"
    C = "c"


Source = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="A plant (model.json, rig file or module:function), a NARX model (narx.json), or a check (check.json), whose "
        "controller is exported.",
    ),
]
To = Annotated[
    Form,
    typer.Option(
        help="fmu: FMI 3.0, plants for model exchange, NARX models for co-simulation; fmu-cs: co-simulation, one sample "
        "per step; c: one file of C99."
    ),
]
OutFile = Annotated[Path, typer.Option("--out", metavar="FILE", help="File to write: .c for --to c, else .fmu.")]
Name = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Prefix of all names in the C code; by default taken from the file name."),
]


def export(model: Source, to: To, out: OutFile, name: Name = None, as_json: Json = False, quiet: Quiet = False) -> None:
    """Write a simulation model, a NARX model or a controller for other programs: as FMU 3.0, or as C source.

    FMUs need a C compiler and fmpy.

    Example: deatwin export result/model.json --to fmu --out actuator.fmu

    For the micro-controller: deatwin export control/check.json --to c --out controller.c
    """
    from deatwin.studies.folder import require_place

    voice = Voice(as_json=as_json, quiet=quiet)
    _require_ending(out, to)
    require_place(out, [model])
    given = _Given.load(model)
    said = _written(given, to, out, name or _identifier(out.stem))
    voice.say(f"{out}: {said['description']}")
    start = None if given.plant is None else given.plant.rig.start
    if start is not None and start.ramp + start.hold > 0.0:
        voice.say(
            f"the exported model starts at rest, but deatwin simulate first ramps to the first command in {start.ramp:g} s "
            f"and holds this command for {start.hold:g} s; to obtain the same readings, start the exported model at "
            f"{-(start.ramp + start.hold):g} s with the same ramp and hold"
        )
    voice.result({"out": str(out), "form": to.value, **said})


def _require_ending(out: Path, to: Form) -> None:
    from deatwin.plant.errors import DataError

    if to is Form.C and out.suffix != ".c":  # compilers take .C for C++
        raise DataError(f"{out}: the name of a C source ends in .c; compilers require it")
    if to is not Form.C and out.suffix.lower() != ".fmu":
        raise DataError(f"{out}: the name of an FMU ends in .fmu; programs that read FMUs require it")


def _identifier(stem: str) -> str:
    """Return the file's name as a C identifier."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", stem)[:40]
    return found if re.match(r"[A-Za-z]", found) else f"model_{found}"[:40]


@dataclass(frozen=True, kw_only=True)
class _Given:
    """The model to export: a function that makes its C source, and the plant if it is one."""

    source: Callable[..., SampledSource]
    plant: Plant | None = None
    is_controller: bool = False

    @classmethod
    def load(cls, source: str) -> _Given:
        from deatwin.plant.export.plant_step import plant_source
        from deatwin.plant.sources import load_plant

        schema = _schema(source) if source.endswith(".json") else None
        if schema in (NARX, STATES):
            return _narx(source)
        if schema == CHECK:
            return _controller(source)
        plant = load_plant(source).plant
        return cls(source=partial(plant_source, plant), plant=plant)


def _schema(source: str) -> str | None:
    """Return the schema of a JSON file; None if the file cannot be read, which loading it will report."""
    from deatwin.plant.documents import read_json
    from deatwin.plant.errors import ModelError
    from deatwin.plant.safe_read import clipped

    try:
        document = read_json(source)
    except ModelError:
        return None
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema not in (PLANT, NARX, CHECK, STATES):
        raise ModelError(
            f"{source}: its schema is {clipped(repr(schema))}, but only {PLANT}, {NARX} and {CHECK} can be exported"
        )
    return str(schema)


def _narx(source: str) -> _Given:
    """Return a model that starts at rest at the centre of its training inputs, or at zero if it has no such rest."""
    from deatwin.app.given import narx_model
    from deatwin.ident.frequency import equilibrium
    from deatwin.ident.narx.export import narx_source
    from deatwin.plant.errors import ModelError

    model = narx_model(source)
    try:
        found = equilibrium(model.deterministic)
    except ModelError:
        return _Given(source=partial(narx_source, model))
    return _Given(source=partial(narx_source, model, rest_input=found.operating_input, rest_output=[found.output]))


def _controller(source: str) -> _Given:
    """Return the controller of a check."""
    from deatwin.control.controllers.document import controller_from_dict
    from deatwin.control.errors import ControlError
    from deatwin.control.export.controller import controller_source
    from deatwin.plant.documents import read_document

    def build(document: Mapping[str, Any]) -> Callable[..., SampledSource]:
        if document["controller"] is None:
            raise ControlError("the check contains no controller, because none could be designed")
        units = {key: str(document["operating"][key]) for key in ("input_unit", "output_unit")}
        return partial(controller_source, controller_from_dict(document["controller"]), **units)

    return _Given(source=read_document(source, CHECK, build), is_controller=True)


def _written(given: _Given, to: Form, out: Path, name: str) -> dict[str, Any]:
    """Write the file, and describe it."""
    from deatwin.plant.errors import ModelError
    from deatwin.plant.export.cosimulation import export_cosimulation
    from deatwin.plant.export.model_exchange import described, export_model_exchange
    from deatwin.plant.files import write_text_atomic

    if given.is_controller and to is not Form.C:
        raise ModelError("a controller can be exported only as C source: give --to c")
    if given.plant is not None and to is Form.FMU:
        export_model_exchange(given.plant, out, name=name)
        return {"name": name, "description": f"FMU 3.0 for model exchange, {described(given.plant)}"}
    source = given.source(name=name)
    if to is Form.C:
        write_text_atomic(out, source.text)
    else:
        export_cosimulation(source, out)
    form = "C99" if to is Form.C else "FMU 3.0 for co-simulation"
    return {
        "name": name,
        "description": f"{form}, {source.description}, {source.sample_time:g} s per sample",
        "sample_time_s": source.sample_time,
        "inputs": [s.name for s in source.inputs],
        "outputs": [s.name for s in source.outputs],
    }
