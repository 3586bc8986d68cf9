"""The records of a diagnosis are those of its schema: the same keys, and what the schema demands has no default."""

import json
from dataclasses import MISSING, fields, is_dataclass
from importlib.resources import files
from types import NoneType
from typing import Any, get_args, get_type_hints

from deatwin.ident.mismatch import Diagnosis
from deatwin.plant.records import INTERNAL

SCHEMA = json.loads((files("deatwin.ident") / "schemas" / "diagnosis.schema.json").read_text(encoding="utf-8"))
DERIVED = {"schema", "shown"}
"""Keys that `Diagnosis.to_dict` adds."""


def records(hint: Any) -> list[type]:
    """The records in a type, however deep."""
    if is_dataclass(hint):
        return [hint]
    return [record for inner in get_args(hint) if inner is not NoneType for record in records(inner)]


def objects(node: Any) -> list[dict[str, Any]]:
    """The nearest objects with properties in a part of a schema."""
    if isinstance(node, dict) and "properties" in node:
        return [node]
    inner = [node[name] for name in ("items", "additionalProperties") if isinstance(node, dict) and name in node]
    return [found for each in inner for found in objects(each)]


def faults(record: type, node: dict[str, Any], where: str) -> list[str]:
    hints, told = get_type_hints(record), node["properties"]
    held = {
        each.metadata.get("key", each.name): each
        for each in fields(record)
        if not INTERNAL.items() <= each.metadata.items()
    }
    found = [f"{where}: {name}" for name in set(told) - set(held) - DERIVED]
    for name, each in held.items():
        if node.get("additionalProperties") is False and name not in told:
            found.append(f"{where}.{name}: not in the schema")
        if each.default is MISSING and each.default_factory is MISSING and name not in node.get("required", ()):
            found.append(f"{where}.{name}: the schema does not demand it")
        for inner, part in zip(records(hints[each.name]), objects(told.get(name, {})), strict=False):
            found += faults(inner, part, f"{where}.{name}")
    return found


def test_records_and_schema_have_the_same_keys():
    assert faults(Diagnosis, SCHEMA, "diagnosis") == []
