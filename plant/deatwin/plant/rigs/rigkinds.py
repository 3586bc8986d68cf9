"""Kinds of rigs that a rig file can describe: sections and keys of each kind, and their JSON Schema."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from deatwin.plant.rigs.rigkeys import (
    DRIVE,
    LOAD_CELL,
    MATERIAL,
    PRESTRETCH,
    PULL,
    SENSOR,
    THICKNESS,
    Keys,
    NumberKey,
    TextKey,
    force,
    key_schema,
    length,
    mass,
    number,
    spring_rate,
    stretch,
)
from deatwin.plant.rigs.rigmaterial import MATERIAL_SCHEMA
from deatwin.plant.rigs.rigreadings import readings_schema

Pair = tuple[tuple[str, str], tuple[str, str]]


@dataclass(frozen=True, kw_only=True)
class RigKind:
    """Sections and keys of one kind of rig. Its keys in ``film`` and ``load`` are named after the rig's fields."""

    about: str
    film: Keys
    load: Keys = field(default_factory=dict)
    drive: Keys = field(default_factory=lambda: DRIVE)
    sensor: Keys = field(default_factory=lambda: SENSOR)
    units: tuple[str, str] = ("V", "m")  # Units of the command and of the reading
    below: tuple[Pair, ...] = ()  # Pairs of numbers; the first must be smaller, as in a part that fits into another
    absent: Mapping[str, float | None] = field(
        default_factory=dict
    )  # Values of the rig's fields whose key the file lacks
    examples: Mapping[str, float | str] = field(default_factory=dict)  # Example values for a template

    @property
    def sections(self) -> Mapping[str, Keys]:
        """Sections in the order of the file, without [material]."""
        load = {"load": self.load} if self.load else {}
        return {"film": {"material": MATERIAL, "thickness_mm": THICKNESS, **self.film}, **load} | {
            "drive": self.drive,
            "sensor": self.sensor,
        }


_ELECTRODE_IN_FRAME = (("film", "electrode_diameter_mm"), ("film", "frame_diameter_mm"))
COMMANDS = tuple(
    (("drive", low), ("drive", high))
    for low, high in (("command_min_V", "command_max_V"), ("stretch_min", "stretch_max"))
)
_SIDE = stretch("side_prestretch", "across the motion; the same as along it if left out", required=False)
_IN_A_RING: Keys = {
    "prestretch": PRESTRETCH,
    "frame_diameter_mm": length("frame_radius", "of the ring, inside", lower=1.0, per_si=2e3),
}
_FORCE = force("load", "0 if left out; it pulls the rig longer")
_SILICONE: Mapping[str, float | str] = {
    "material": "Elastosil 2030",
    "thickness_mm": 0.05,
    "prestretch": 1.2,
    "frame_diameter_mm": 40.0,
}
_MARK = (0.01, 1e3)  # g; a mark for the sensor may be all that moves with the film
_MOVED = mass("that moves; 0 if left out")

KINDS: Mapping[str, RigKind] = MappingProxyType(
    {
        "diaphragm": RigKind(
            about="A diaphragm rig: a prestrained film in a ring, with a load at its centre.",
            film={
                "prestretch": PRESTRETCH,
                "frame_diameter_mm": length("frame_diameter", "of the ring, inside", lower=1.0),
                "electrode_diameter_mm": length("electrode_diameter", "on the stretched film", lower=0.1),
                "ball": TextKey(
                    field="ball",
                    choices=("bonded", "sliding"),
                    required=False,
                    about="left out where it is not known: both are fitted",
                ),
            },
            load={
                "mass_g": mass("of the ball", lower=1e-3, required=True),
                "contact_diameter_mm": length("contact_diameter", "of ball and film"),
            },
            below=(_ELECTRODE_IN_FRAME, (("load", "contact_diameter_mm"), ("film", "electrode_diameter_mm"))),
            examples={"ball": "sliding", "mass_g": 3.0, "contact_diameter_mm": 6.0},
        ),
        "disc": RigKind(
            about="A disc: a round electrode in the middle of a prestretched film in a ring; its edge is read.",
            film={
                **_IN_A_RING,
                "electrode_diameter_mm": length("electrode_radius", "on the stretched film", lower=0.1, per_si=2e3),
            },
            load={"mass_g": mass("that the electrode's edge carries; 0 if left out", usual=_MARK)},
            below=(_ELECTRODE_IN_FRAME,),
            examples={
                "material": "Elastosil 2030",
                "thickness_mm": 0.1,
                "prestretch": 1.2,
                "frame_diameter_mm": 50.0,
                "electrode_diameter_mm": 20.0,
                "mass_g": 0.0,
            },
        ),
        "planar": RigKind(
            about="A planar actuator: a film between a fixed and a moving bar, which a dead load pulls.",
            film={
                "length_mm": length("length", "along the motion, before stretching"),
                "width_mm": length("width", "across the motion, before stretching"),
                "prestretch": PRESTRETCH,
                "side_prestretch": _SIDE,
                "sides": TextKey(
                    field="sides", choices=("equal", "free", "clamped"), required=False, about="equal if left out"
                ),
            },
            load={"mass_g": _MOVED},
            absent={"mass": 0.0},
            examples={"length_mm": 50.0, "width_mm": 50.0, "side_prestretch": 3.5, "sides": "equal"},
        ),
        "stack": RigKind(
            about="A stack: films on top of each other that contract across their faces.",
            film={
                "layers": NumberKey(field="layers", lower=1.0, upper=1e6, whole=True, about="number of films"),
                "area_mm2": number("area", 0.01, 1e6, "of a film's electrode", unit="mm2", usual=(1.0, 2e5)),
            },
            load={"force_N": _FORCE, "mass_g": _MOVED},
            absent={"mass": 0.0, "load": 0.0},
            examples={"layers": 100.0, "area_mm2": 400.0, "thickness_mm": 0.1},
        ),
        "bow_tie": RigKind(
            about="A bow-tie: a film that narrows to a waist between a fixed and a moving bar.",
            film={
                "length_mm": length("length", "along the motion, before stretching"),
                "waist_width_mm": length("waist_width", "before stretching"),
                "bar_width_mm": length("bar_width", "before stretching"),
                "prestretch": PRESTRETCH,
                "side_prestretch": _SIDE,
                "sides": TextKey(
                    field="sides",
                    choices=("clamped", "free"),
                    required=False,
                    about="clamped if left out; free ones have no side_prestretch",
                ),
            },
            load={"mass_g": _MOVED},
            below=((("film", "waist_width_mm"), ("film", "bar_width_mm")),),
            absent={"mass": 0.0, "side_prestretch": None},
            examples={"length_mm": 40.0, "waist_width_mm": 20.0, "bar_width_mm": 60.0, "prestretch": 1.5}
            | {"side_prestretch": 1.2, "sides": "clamped"},
        ),
        "roll": RigKind(
            about="A spring roll: a film wound around a compressed spring, which voltage lets lengthen.",
            film={
                "length_mm": length("length", "along the axis, before stretching"),
                "width_mm": length(
                    "width",
                    "along the winding, before stretching; of two films wound together, the sum",
                    lower=0.1,
                    upper=1e5,
                    usual=(15.0, 1e5),
                ),
                "prestretch": PRESTRETCH,
                "hoop_prestretch": stretch("hoop_prestretch", "around the axis", lower=1.0),
            },
            load={
                "spring_rate_N_m": spring_rate("of the core", lower=1e-3),
                "force_N": _FORCE,
                "mass_g": _MOVED,
            },
            absent={"mass": 0.0, "load": 0.0},
            examples={"length_mm": 15.0, "width_mm": 500.0, "prestretch": 3.0, "hoop_prestretch": 4.5}
            | {"spring_rate_N_m": 250.0},
        ),
        "cone": RigKind(
            about="A cone: a film between a rigid disc and a ring, drawn out of its plane by a mass or a spring.",
            film={
                **_IN_A_RING,
                "disc_diameter_mm": length("disc_radius", "of the rigid disc in the middle", lower=0.1, per_si=2e3),
            },
            load={
                "mass_g": mass("of the disc and what hangs on it", required=True),
                "spring_rate_N_m": spring_rate("of a linear spring; 0 if left out", lower=0.0, required=False),
                "spring_preload_N": force(
                    "spring_preload", "force of the springs on the flat film, along the motion; 0 if left out"
                ),
                "snap_force_N": force(
                    "snap_force", "largest force of a bistable spring between its two places; 0 if left out", lower=0.0
                ),
                "snap_middle_mm": length(
                    "snap_middle",
                    "height of the disc in the middle between these places; 3 if left out",
                    lower=-1e3,
                    required=False,
                    usual=(0.05, 100.0),
                ),
                "snap_reach_mm": length(
                    "snap_reach", "from the middle to each place; 2 if left out", required=False, usual=(0.05, 100.0)
                ),
            },
            below=((("film", "disc_diameter_mm"), ("film", "frame_diameter_mm")),),
            examples={
                **_SILICONE,
                "disc_diameter_mm": 16.0,
                "mass_g": 20.0,
                "spring_rate_N_m": 0.0,
                "spring_preload_N": 0.0,
                "snap_force_N": 0.0,
                "snap_middle_mm": 3.0,
                "snap_reach_mm": 2.0,
            },
        ),
        "pressure": RigKind(
            about="An inflated film: a constant pressure bulges a film in a ring, with electrodes all over.",
            film=_IN_A_RING,
            load={
                "pressure_kPa": number(
                    "pressure", 1e-4, 1e3, "inside above that outside", unit="kPa", usual=(0.02, 100.0)
                ),
                "mass_g": mass("on the apex besides the film; 0 if left out", usual=_MARK),
            },
            examples={**_SILICONE, "pressure_kPa": 0.5},
        ),
        "coupon": RigKind(
            about="A coupon: a strip between the clamps of a test machine, whose stretch is given and whose force is read.",
            film={
                "width_mm": length("width", "before stretching"),
                "length_mm": length("length", "between the clamps, before stretching"),
            },
            drive=PULL,
            sensor=LOAD_CELL,
            units=("1", "N"),
            examples={"thickness_mm": 1.0, "width_mm": 10.0, "length_mm": 80.0, "stretch_min": 1.0, "stretch_max": 3.0},
        ),
    }
)
"""Kinds by the name under ``kind``; a file without it describes a diaphragm."""
SCHEMA = "deatwin/rig/1"


def rig_schema() -> dict[str, Any]:
    """Return the schema that ships as ``schemas/rig.schema.json``."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA,
        "title": "A rig file",
        "description": "What the experimenter knows of a rig, as TOML. A part is smaller than the one that holds it, "
        "command_min_V than command_max_V, which put at most 30 kV on the film.",
        "oneOf": [_schema_of(name, kind) for name, kind in KINDS.items()],
        "$defs": {"material": MATERIAL_SCHEMA, "drive": _section(DRIVE), "sensor": _section(SENSOR)}
        | {"readings": readings_schema()},
    }


def _schema_of(name: str, kind: RigKind) -> dict[str, Any]:
    usual = {"drive": (kind.drive, DRIVE), "sensor": (kind.sensor, SENSOR)}
    same = [section for section, (own, known) in usual.items() if own is known]
    shared = {section: {"$ref": f"#/$defs/{section}"} for section in (*same, "material", "readings")}
    sections = {section: _section(keys) for section, keys in kind.sections.items() if section not in shared}
    required = [section for section, keys in kind.sections.items() if any(key.required for key in keys.values())]
    named = {"properties": {"film": {"required": ["material"]}}}
    return {
        "type": "object",
        "description": kind.about,
        "additionalProperties": False,
        "required": required if name == "diaphragm" else ["kind", *required],
        "properties": {"kind": {"const": name}, **sections, **shared},
        "oneOf": [named, {"required": ["material"]}],
    }


def _section(keys: Keys) -> dict[str, Any]:
    replaced = [
        {"oneOf": [{"required": [name]}, {"required": [key.instead]}]}
        for name, key in keys.items()
        if key.instead in keys
    ]
    return {
        "type": "object",
        "additionalProperties": False,
        "required": [name for name, key in keys.items() if key.required and not key.instead],
        "properties": {name: key_schema(key) for name, key in keys.items()},
        **({"allOf": replaced} if replaced else {}),
    }
