"""Every reader, given spoilt files: a sound object or one clear error that names the file, and nothing else.

Some examples of each kind; .ci/run gives the same readers a thousand files of each group, by tests/fuzz/fuzz.py.
"""

import ast
import importlib
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deatwin.plant.documents import shape_fault, shipped_schema
from deatwin.plant.errors import DeatwinError, RigError
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.rigs.rigkinds import rig_schema

FUZZ = Path(__file__).parents[1] / "fuzz"
MODULES = ("readers", "mutations")
RECORDINGS = ("csv", "lvm", "xlsx", "mat", "mat73", "tdms", "netcdf", "netcdf4")
MODELS = ("plant", "narx", "linear", "states", "diagnosis", "check", "theta", "validation", "controller")
KINDS = (*RECORDINGS, "rig", *MODELS)
DOCUMENTS = ("plant", "narx", "linear", "diagnosis", "check", "theta", "validation")
BINARY = ("xlsx", "mat", "mat73", "tdms", "netcdf", "netcdf4")
"""No text."""
NEEDS = {
    "xlsx": ["openpyxl"],
    "mat73": ["h5py"],
    "tdms": ["nptdms"],
    "netcdf": ["xarray"],
    "netcdf4": ["xarray", "h5netcdf", "h5py"],
}
bounded = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**400), 10**400)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@pytest.fixture(scope="module")
def fuzz() -> Iterator[dict[str, ModuleType]]:
    """The modules that tests/fuzz/fuzz.py uses too; scripts, not a package."""
    sys.path.insert(0, str(FUZZ))
    try:
        yield {name: importlib.import_module(name) for name in MODULES}
    finally:
        sys.path.remove(str(FUZZ))
        for name in MODULES:
            sys.modules.pop(name, None)


def require_packages(kind: str) -> None:
    for package in NEEDS.get(kind, ()):
        pytest.importorskip(package)


def test_every_kind_of_file_is_spoilt_here(fuzz: dict[str, ModuleType]) -> None:
    assert tuple(fuzz["readers"].KINDS) == KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_files_that_are_sound_are_read(kind: str, fuzz: dict[str, ModuleType]) -> None:
    require_packages(kind)
    chosen = fuzz["readers"].KINDS[kind]
    for seed in chosen.seeds():
        assert fuzz["readers"].probe(chosen, seed) is not None


@pytest.mark.parametrize("kind", KINDS)
@settings(bounded, max_examples=20)
@given(data=st.data())
def test_spoilt_files_give_a_sound_object_or_one_clear_error(
    kind: str, fuzz: dict[str, ModuleType], data: st.DataObject
) -> None:
    require_packages(kind)
    chosen = fuzz["readers"].KINDS[kind]
    seed = data.draw(st.sampled_from(chosen.seeds()))
    content = fuzz["mutations"].mutated(seed, lambda low, high: data.draw(st.integers(low, high)))
    fuzz["readers"].probe(chosen, content)


@pytest.mark.parametrize("kind", KINDS)
@settings(bounded, max_examples=10)
@given(content=st.binary(max_size=300) | st.text(max_size=100).map(lambda text: text.encode("utf-8", "replace")))
def test_any_bytes_give_one_clear_error(kind: str, fuzz: dict[str, ModuleType], content: bytes) -> None:
    require_packages(kind)
    fuzz["readers"].probe(fuzz["readers"].KINDS[kind], content)


def lengthened(content: bytes, spoilt: int) -> Iterator[bytes]:
    """A text file with one of its words of thousands of characters, alone and with what ends the word lost.

    So long that Python makes no number of it, and shorter; of as many words as asked for, spread over the text.
    """
    words = [match.span() for match in re.finditer(rb"[-+.\w]+", content)]
    for first, last in words[:: max(1, -(-len(words) // spoilt))]:
        for word in (content[first:last] + b"9" * 4000, b"9" * 4000, b"9" * 5000, content[first:last] + b"x" * 4000):
            yield content[:first] + word + content[last:]
            yield content[:first] + word + content[last + 1 :]


@pytest.mark.parametrize("kind", [name for name in KINDS if name not in BINARY])
def test_files_with_a_word_of_thousands_of_characters_give_a_short_error(
    kind: str, fuzz: dict[str, ModuleType]
) -> None:
    chosen = fuzz["readers"].KINDS[kind]
    spoilt = 6 if kind == "csv" else 20  # the rows of a table are alike, the words of a document are not
    for seed in chosen.seeds():
        for content in lengthened(seed, spoilt):
            fuzz["readers"].probe(chosen, content)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where the values of a document stand."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


def changed(document: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A copy of a document with another value."""
    copied = json.loads(json.dumps(document))
    inner = copied
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return copied


@pytest.mark.parametrize("kind", [*DOCUMENTS, "controller"])
@settings(bounded, max_examples=60)
@given(data=st.data())
def test_documents_with_another_value_give_a_sound_object_or_one_clear_error(
    kind: str, fuzz: dict[str, ModuleType], data: st.DataObject
) -> None:
    chosen = fuzz["readers"].KINDS[kind]
    document = json.loads(chosen.seeds()[0])
    path = data.draw(st.sampled_from(list(places(document))))
    spoilt = changed(document, path, data.draw(json_values))
    fuzz["readers"].probe(chosen, json.dumps(spoilt).encode())


@pytest.mark.parametrize("kind", DOCUMENTS)
@settings(bounded, max_examples=60)
@given(data=st.data())
def test_values_are_refused_where_the_schema_refuses_them(
    kind: str, fuzz: dict[str, ModuleType], data: st.DataObject
) -> None:
    """The small checker in the package against the library jsonschema, which only the tests need."""
    document = json.loads(fuzz["readers"].KINDS[kind].seeds()[0])
    path = data.draw(st.sampled_from(list(places(document))))
    spoilt = changed(document, path, data.draw(json_values))
    schema = shipped_schema(document["schema"])
    allowed = not [
        fault for fault in jsonschema.Draft202012Validator(schema).iter_errors(spoilt) if not is_lenient(fault)
    ]
    assert (shape_fault(spoilt, document["schema"]) == "") == allowed


def is_lenient(fault: jsonschema.ValidationError) -> bool:
    """Whether the checker leaves such a fault alone: further keys, keys of the document itself, equal entries."""
    if fault.validator in ("oneOf", "anyOf"):  # one branch with only such faults is enough
        branches: dict[Any, list[bool]] = {}
        for inner in fault.context:
            branches.setdefault(inner.schema_path[0], []).append(is_lenient(inner))
        return any(all(faults) for faults in branches.values())
    if fault.validator == "required":
        return not fault.absolute_path
    return fault.validator in ("additionalProperties", "uniqueItems", "if", "format")


numbers = st.one_of(
    st.sampled_from([0, 1, -1, 0.001, 10.0, 1000, 86400, 1e6, 0.0009, 10.01, 1e5, True, False]),
    st.floats(-1e7, 1e7),
    st.integers(-(10**6), 10**6),
)
rig_values = st.one_of(
    numbers,
    numbers,
    st.sampled_from(
        ["bonded", "sliding", "displacement at zero volts", "arbitrary", "unknown", "film voltage", "", " "]
    ),
    st.text(max_size=5),
    st.none(),
    st.lists(numbers, max_size=2),
)


def in_order(rig: dict[str, Any]) -> bool:
    """What a schema cannot say: the electrode inside the frame, the contact inside it, commands in order and on a film."""
    film, drive = rig["film"], rig["drive"]
    commands = drive.get("command_min_V", -1e9) < drive.get("command_max_V", 1e9)
    gain = 1.0 if "input" in drive else drive["gain"]
    commands &= all(abs(gain * drive.get(f"command_{end}_V", 0.0)) <= 30e3 for end in ("min", "max"))
    return commands and film["frame_diameter_mm"] > film["electrode_diameter_mm"] > rig["load"]["contact_diameter_mm"]


RIG_FILES = jsonschema.Draft202012Validator(rig_schema())


@settings(bounded, max_examples=400)
@given(data=st.data())
def test_reader_and_schema_of_rig_files_allow_the_same(fuzz: dict[str, ModuleType], data: st.DataObject) -> None:
    rig = tomllib.loads(fuzz["readers"].RIG)
    for _ in range(data.draw(st.integers(0, 2))):
        section = data.draw(st.sampled_from([*rig, "lode"]))
        keys = sorted(rig.get(section, {})) if isinstance(rig.get(section), dict) else []
        key = data.draw(st.sampled_from([*keys, "lid", "input", "start", None]))
        if key is None:
            rig[section] = data.draw(rig_values)
        elif not isinstance(rig.get(section), dict):
            continue
        elif data.draw(st.integers(0, 4)):
            rig[section][key] = data.draw(rig_values)
        else:
            rig[section].pop(key, None)
    valid = RIG_FILES.is_valid(rig)
    try:
        RigFile.from_dict(rig, "rig.toml")
    except RigError as error:
        assert not (valid and in_order(rig)), error
        assert str(error).startswith("rig.toml")
    else:
        assert valid and in_order(rig)


def test_the_shipped_schema_of_rig_files_is_the_readers_own_table() -> None:
    assert shipped_schema("deatwin/rig/1") == rig_schema()
    jsonschema.Draft202012Validator.check_schema(rig_schema())


def written_rigs() -> Iterator[tuple[Path, str]]:
    """The rig files of the repository, and those that stand in documents and in tests."""
    root = FUZZ.parents[1]
    for file in sorted(root.glob("tests/recordings/*/rig.toml")):
        yield file, file.read_text(encoding="utf-8")
    for file in (root / "README.md", *sorted(root.glob("docs/**/*.md"))):
        for text in re.findall(r"```toml\n(.*?)```", file.read_text(encoding="utf-8"), re.DOTALL):
            if "[film]" in text:
                yield file, text
    for file in sorted(root.glob("tests/**/*.py")):
        text = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "[film]" in text else ():
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                if all(f"\n[{section}]\n" in f"\n{node.value}" for section in ("film", "load", "drive", "sensor")):
                    yield file, node.value


def test_every_written_rig_file_is_as_reader_and_schema_have_it() -> None:
    found = list(written_rigs())
    assert {file.suffix for file, _ in found} == {".toml", ".md", ".py"}
    for file, text in found:
        rig = tomllib.loads(text)
        RigFile.from_dict(rig, str(file))
        jsonschema.validate(rig, shipped_schema("deatwin/rig/1"))


def test_elements_of_types_that_there_are_not_are_refused_before_scipy_crashes_on_them(
    fuzz: dict[str, ModuleType],
) -> None:
    chosen = fuzz["readers"].KINDS["mat"]
    plain = next(seed for seed in chosen.seeds() if seed[128:132] == b"\x0e\0\0\0")  # of version 5, not packed
    spoilt = plain.replace(b"\x09\0\0\0", b"\x09\x08\0\0")  # the type of doubles
    assert spoilt != plain
    assert fuzz["readers"].probe(chosen, spoilt) is None


def test_the_property_itself_can_fail(fuzz: dict[str, ModuleType]) -> None:
    readers = fuzz["readers"]

    def nameless(path: Path) -> None:
        raise DeatwinError("something is wrong")

    def surprised(path: Path) -> None:
        raise KeyError("x")

    def writes(path: Path) -> int:
        return path.with_name("left").write_text("x")

    for read, found in ((nameless, AssertionError), (surprised, KeyError), (writes, AssertionError)):
        kind = readers.Kind(ending=".csv", read=read, require_sound=lambda found: None, seeds=tuple)
        with pytest.raises(found):
            readers.probe(kind, b"")
