"""Model descriptions of FMUs: CasADi's, with additions, and those of sampled systems."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import version

from deatwin.plant.export.sampled import SampledSource, Signal, number

_BASE_UNITS = {
    "m": {"m": 1},
    "s": {"s": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "A": {"A": 1},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "K": {"K": 1},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "1": {},
}
"""Exponents of the SI base units; other units are written by name only."""
_TOLERANCE = 1e-8  # Relative tolerance suggested to importing tools


@dataclass(frozen=True, kw_only=True)
class Description:
    """The model description that CasADi writes, completed by what it lacks."""

    name: str  # Model identifier
    plain: bytes
    inputs: tuple[Signal, ...]  # Inputs with their units
    outputs: tuple[Signal, ...]
    start: Mapping[str, float]  # Initial values of the states, by variable name
    sample_time: float  # Suggested step, s
    text: str  # One-line description of the model

    def tidied(self) -> bytes:
        """Add units, default experiment and texts; remove CasADi's own variables, which are never computed."""
        root = ET.fromstring(self.plain)
        variables = root.find("ModelVariables")
        units = {s.name: s.unit for s in (*self.inputs, *self.outputs) if s.unit}
        start = {**self.start, **{s.name: s.start for s in self.inputs}}
        for variable in [] if variables is None else list(variables):
            label = variable.get("name", "")
            if variables is not None and label.startswith("__"):
                variables.remove(variable)
            if label in units:
                variable.set("unit", units[label])
            if label in start:
                variable.attrib.update({"initial": "exact", "start": number(start[label])})
            if variable.get("causality") == "input":
                variable.attrib.pop("initial", None)  # inputs have none
        root.set("description", self.text)
        root.set("variableNamingConvention", "flat")  # a rig may choose any names for its signals
        root.set("generationTool", f"deatwin {version('deatwin')} ({root.get('generationTool', '')})")
        _insert_second(root, _units(units.values()), _experiment(self.sample_time))
        return _written(root)


def sampled_description(source: SampledSource) -> bytes:
    """Write the model description of a sampled system for co-simulation."""
    step = number(source.sample_time)
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "3.0",
            "modelName": source.name,
            "description": source.description,
            "instantiationToken": sha256(source.text.encode()).hexdigest()[:32],
            "variableNamingConvention": "flat",
            "generationTool": f"deatwin {version('deatwin')}",
            "generationDateAndTime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        },
    )
    ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": source.name,
            "canHandleVariableCommunicationStepSize": "true",
            "fixedInternalStepSize": step,
        },
    )
    units = [s.unit for s in (*source.inputs, *source.outputs) if s.unit]
    _insert_second(root, _units(units), _experiment(source.sample_time))
    variables, structure = ET.SubElement(root, "ModelVariables"), ET.SubElement(root, "ModelStructure")
    ET.SubElement(variables, "Float64", {"name": "time", "valueReference": "0", "causality": "independent"})
    for reference, signal in enumerate((*source.inputs, *source.outputs), start=1):
        given = reference <= len(source.inputs)
        kind = {"causality": "input", "start": number(signal.start)} if given else {"causality": "output"}
        unit = {"unit": signal.unit} if signal.unit else {}
        ET.SubElement(
            variables,
            "Float64",
            {"name": signal.name, "valueReference": str(reference), "variability": "discrete", **kind, **unit},
        )
        if not given:
            ET.SubElement(structure, "Output", {"valueReference": str(reference), "dependencies": ""})
    for output in list(structure):
        ET.SubElement(structure, "InitialUnknown", output.attrib)
    return _written(root)


def _units(names: Iterable[str]) -> ET.Element | None:
    found = ET.Element("UnitDefinitions")
    for name in dict.fromkeys(names):
        unit = ET.SubElement(found, "Unit", {"name": name})
        if name in _BASE_UNITS:
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in _BASE_UNITS[name].items()})
    return found if len(found) else None


def _experiment(sample_time: float) -> ET.Element:
    return ET.Element(
        "DefaultExperiment", {"startTime": "0.0", "tolerance": number(_TOLERANCE), "stepSize": number(sample_time)}
    )


def _insert_second(root: ET.Element, *elements: ET.Element | None) -> None:
    """Insert elements after the first child, in the given order."""
    for element in reversed([e for e in elements if e is not None]):
        root.insert(1, element)


def _written(root: ET.Element) -> bytes:
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
