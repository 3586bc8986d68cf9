"""A sampled system as an FMU for co-simulation (FMI 3.0, Modelica Association 2022), from its C source."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

from deatwin.plant.arguments import file_name, instance, taking
from deatwin.plant.export.archive import compiled, write_fmu
from deatwin.plant.export.description import sampled_description
from deatwin.plant.export.sampled import SampledSource, table

_NAMES = """
#define MODEL_TOKEN "{token}"
#define MODEL_INPUTS {upper}_INPUTS
#define MODEL_OUTPUTS {upper}_OUTPUTS
#define MODEL_SAMPLE_TIME ((double){upper}_SAMPLE_TIME)
{clock}
typedef {name}_real model_real;
typedef {name}_state model_state;
#define model_init {name}_init
#define model_step {name}_step
{start}
"""
_BUILD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
    <BuildConfiguration modelIdentifier="{name}">
        <SourceFileSet language="C99">
            <SourceFile name="{name}.c"/>
        </SourceFileSet>
    </BuildConfiguration>
</fmiBuildDescription>
"""


@taking(source=instance(SampledSource, hint=", as plant_source(plant) returns it"), path=file_name)
def export_cosimulation(source: SampledSource, path: str | Path) -> Path:
    """Export a sampled system as an FMU (functional mock-up unit, FMI 3.0) for co-simulation.

    The FMU contains the C source and a binary for this computer. A communication step covers one or more whole samples,
    during which the inputs are held constant. After the step, the outputs have their values at the end of the last
    sample. If a communication step ends between two samples, the FMU returns ``fmi3Error``.

    Parameters
    ----------
    source : SampledSource
        Sampled system; `SampledSource.name` becomes the model identifier.
    path : path
        File to write, ``.fmu``; an existing file is replaced.

    Returns
    -------
    Path
        Path of the written file.

    Raises
    ------
    ModelError
        If the FMI headers or a C compiler is missing.
    DataError
        If the file cannot be written.
    """
    description = sampled_description(source)
    token = ElementTree.fromstring(description).get("instantiationToken", "")
    start = [0.0, *(signal.start for signal in (*source.inputs, *source.outputs))]
    names = _NAMES.format(
        token=token,
        name=source.name,
        upper=source.name.upper(),
        start=table("double model_start", start),
        clock="#define MODEL_CLOCK" if source.has_clock else "",
    )
    interface = files(__package__).joinpath("cosimulation.c").read_text(encoding="utf-8")
    contents = {
        "modelDescription.xml": description,
        "sources/buildDescription.xml": _BUILD.format(name=source.name).encode(),
        f"sources/{source.name}.c": (source.text + names + interface).encode(),
    }
    return write_fmu(path, compiled(contents, source.name))
