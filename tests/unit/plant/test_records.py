"""Typed records as plain data and back: keys, optional fields, nesting, and one error for what is of another kind."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import pytest

from deatwin.plant.records import INTERNAL, OPTIONAL, Json, key, plain, read


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True, kw_only=True)
class Part:
    low: float = field(metadata=key("from"))
    colour: Colour = Colour.RED


@dataclass(frozen=True, kw_only=True)
class Whole:
    name: str
    parts: tuple[Part, ...]
    sizes: Mapping[str, float | None]
    free: Json = None
    note: str | None = field(default=None, metadata=OPTIONAL)
    drawn: object = field(default=None, metadata=INTERNAL)


WHOLE = Whole(name="a", parts=(Part(low=1.5),), sizes={"x": None, "y": 2.0}, free={"deep": [1, {"er": None}]}, drawn=3)
DATA = {
    "name": "a",
    "parts": [{"from": 1.5, "colour": "red"}],
    "sizes": {"x": None, "y": 2.0},
    "free": {"deep": [1, {"er": None}]},
}


def test_a_record_and_its_plain_data():
    assert plain(WHOLE) == DATA
    assert read(Whole, {**DATA, "drawn": 3, "unknown": 1}) == Whole(**{**vars(WHOLE), "drawn": None})
    assert read(Whole, {**DATA, "note": "b"}).note == "b"
    assert plain(read(Whole, {**DATA, "note": "b"})) == {**DATA, "note": "b"}


def test_a_whole_number_stays_one():
    assert plain(read(Whole, {**DATA, "sizes": {"y": 2}}))["sizes"] == {"y": 2}


def test_a_missing_key_is_named():
    with pytest.raises(KeyError, match="from"):
        read(Whole, {**DATA, "parts": [{"colour": "red"}]})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("name", 1),
        ("name", None),
        ("parts", "text"),
        ("parts", [1]),
        ("parts", [{"from": True}]),
        ("parts", [{"from": "1.5"}]),
        ("parts", [{"from": 1.5, "colour": "blue"}]),
        ("sizes", [1.0]),
        ("sizes", {"x": "large"}),
        ("note", 1),
    ],
)
def test_a_value_of_another_kind_is_refused(name, value):
    with pytest.raises((TypeError, ValueError)):
        read(Whole, {**DATA, name: value})
