"""The JSON Schema of rig files, "deatwin/rig/1", made of the table that reads them."""

from typing import Any

from deatwin.plant.rigs.rigkeys import RIG_KEYS, NumberKey, TextKey

SCHEMA = "deatwin/rig/1"


def rig_schema() -> dict[str, Any]:
    """Return the schema that ships as ``schemas/rig.schema.json``."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA,
        "title": "A rig file",
        "description": "What the experimenter knows of a diaphragm rig, as TOML. The electrode is smaller than the "
        "frame, the contact than the electrode, command_min_V than command_max_V.",
        "type": "object",
        "additionalProperties": False,
        "required": list(RIG_KEYS),
        "properties": {
            section: {
                "type": "object",
                "additionalProperties": False,
                "required": [name for name, key in keys.items() if key.required],
                "properties": {name: _key(key) for name, key in keys.items()},
            }
            for section, keys in RIG_KEYS.items()
        },
    }


def _key(key: NumberKey | TextKey) -> dict[str, Any]:
    about = {"description": key.about} if key.about else {}
    if isinstance(key, NumberKey):
        return {"type": "number", "minimum": key.lower, "maximum": key.upper, **about}
    return {"type": "string", **({"enum": list(key.choices)} if key.choices else {"pattern": r"\S"}), **about}
