"""A file that lists tests of a material: TOML, with the columns of each test's own file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from deatwin.ident.materials.section import stated_energy
from deatwin.ident.materials.tests import KINDS, MaterialTest
from deatwin.plant.arguments import file_name, taking
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError, RigError, nearest
from deatwin.plant.files.formats.table import Table
from deatwin.plant.files.recordings import table_of_file
from deatwin.plant.files.units import UNITS as KNOWN_UNITS
from deatwin.plant.files.units import find_unit, same_kind
from deatwin.plant.files.wanted import in_units, split_stated
from deatwin.plant.rigs.rigkeys import Keys, NumberKey, TextKey, kind_of
from deatwin.plant.rigs.tomlfile import TomlFile
from deatwin.plant.safe_read import clipped
from deatwin.plant.words import first_of

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "time": "s",
        "stretch": "1",
        "strain": "1",
        "true_strain": "1",
        "displacement": "m",
        "stress": "Pa",
        "true_stress": "Pa",
        "force": "N",
        "frequency": "Hz",
        "storage": "Pa",
        "loss": "Pa",
    }
)
"""Columns of a test and their SI units."""
STRETCHES, STRESSES = ("stretch", "strain", "true_strain", "displacement"), ("stress", "true_stress", "force")
_PLAIN = ("1", "-", "–", "mm/mm", "m/m")
LARGEST = 20.0  # Largest stretch of a test, far beyond the break of elastomers: a strain in per cent lies above
_DYNAMIC = ("frequency", "storage", "loss")


def _dimension(name: str, about: str) -> NumberKey:
    return NumberKey(field=name, lower=1e-3, upper=1e4, per_si=1e3, required=False, about=about)


SPECIMEN: Keys = {
    "length_mm": _dimension("length", "between the clamps, before stretching"),
    "width_mm": _dimension("width", "before stretching"),
    "thickness_mm": _dimension("thickness", "before stretching"),
}
TEST: Keys = {
    "kind": TextKey(field="kind", choices=KINDS),
    "file": TextKey(field="file"),
    "specimen": TextKey(field="specimen", required=False),
    **{name: TextKey(field=name, required=False) for name in UNITS},
    **SPECIMEN,
    "rate_1_s": NumberKey(field="rate", lower=1e-9, upper=1e6, required=False, about="of the strain, without times"),
    "held_stretch": NumberKey(field="held", lower=0.01, upper=LARGEST, required=False),
    "modulus": TextKey(field="modulus", choices=("tension", "shear"), required=False),
}
"""Keys of a test."""
_SECTIONS = ("material", "specimen", "tests")


@dataclass(frozen=True, kw_only=True)
class MaterialTests:
    """Contents of a file that lists tests of a material, as `read_material_tests` returns them.

    Parameters
    ----------
    tests : tuple of MaterialTest
        The tests, in the order of the file.
    about : mapping
        The section ``[material]`` of the file: name, permittivity and other properties that tests cannot determine.
    files : tuple of Path
        Paths of the files that contain the data of the tests.
    """

    tests: tuple[MaterialTest, ...]
    about: Mapping[str, Any]
    files: tuple[Path, ...]


@taking(path=file_name)
def read_material_tests(path: str | Path) -> MaterialTests:
    """Read a file that lists tests of a material, and the data files of these tests.

    Parameters
    ----------
    path : str or Path
        TOML file with sections ``[material]``, ``[specimen]`` and ``[[tests]]``; the page "A material from tests"
        explains its keys. Paths of data files are relative to the folder of this file.

    Returns
    -------
    MaterialTests
        The tests in SI units, and the properties of the material that the TOML file states.

    Raises
    ------
    DataError
        If a file is missing or cannot be read, or a key, column or value is wrong.
    """
    try:
        data = TomlFile.read(path, "list of tests").data
    except RigError as error:
        raise DataError(str(error)) from None
    if mistakes := list(_mistakes(data)):
        raise DataError(f"{path}: {first_of(mistakes, 10, '; ')}")
    try:
        stated_energy(data.get("material", {}))
    except RigError as error:
        raise DataError(f"{path}: {error}") from None
    shared = data.get("specimen", {})
    folder = Path(path).parent
    tests = [_test({**shared, **one}, folder, number) for number, one in enumerate(data["tests"], start=1)]
    names = [test.name for test in tests]
    tests = [
        replace(test, name=f"{test.name} ({k})", specimen=test.specimen) if names.count(test.name) > 1 else test
        for k, test in enumerate(tests, start=1)
    ]
    files = dict.fromkeys(folder / one["file"] for one in data["tests"])
    return MaterialTests(tests=tuple(tests), about=data.get("material", {}), files=tuple(files))


def _mistakes(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield all mistakes of the file, except those of its section [material]."""
    for name in data:
        if name not in _SECTIONS:
            hint = nearest(name[:100], _SECTIONS) or f"; known are {', '.join(_SECTIONS)}"
            yield f"unknown section [{clipped(name)}]{hint}"
    if not isinstance(data.get("material", {}), Mapping):
        yield f"material is {kind_of(data['material'])}; it must be a section [material]"
    yield from _inside("[specimen]", data.get("specimen", {}), SPECIMEN)
    tests = data.get("tests")
    if isinstance(tests, Mapping):
        yield "a list may have several tests: write [[tests]] with double brackets instead of [tests]"
        return
    if not isinstance(tests, list) or not tests:
        yield 'there is no test; write a section [[tests]] with kind = "tension" and file = "pull.csv"'
        return
    for number, one in enumerate(tests, start=1):
        place = f"[[tests]] {number}"
        wrong = list(_inside(place, one, TEST))
        yield from wrong
        if not wrong:
            yield from (f"{place}: {text}" for text in _incomplete({**data.get("specimen", {}), **one}))


def _inside(place: str, values: object, keys: Keys) -> Iterator[str]:
    """Yield mistakes of a section."""
    if not isinstance(values, Mapping):
        yield f"{place} is {kind_of(values)}; it must be a section"
        return
    for name, value in values.items():
        if name not in keys:
            hint = nearest(name[:100], keys) or f"; known are {', '.join(keys)}"
            yield f'{place}: unknown key "{clipped(name)}"{hint}'
        elif fault := keys[name].fault(value):
            yield f"{place} {name}: {fault}"
    for name, key in keys.items():
        if key.required and name not in values:
            yield f'{place}: the key "{name}" is missing; it must be {key.allowed}'


def _incomplete(one: Mapping[str, Any]) -> Iterator[str]:
    """Yield missing and superfluous keys of a test."""
    if one["kind"] == "dma":
        for name in _DYNAMIC:
            if name not in one:
                yield f'a dma test needs the column "{name}"'
        for name in ("time", *STRETCHES, *STRESSES, "rate_1_s"):
            if name in one:
                yield f'a dma test has no "{name}"; it has {", ".join(_DYNAMIC)}'
        return
    for name in (*_DYNAMIC, "modulus"):
        if name in one:
            yield f'"{name}" belongs to a dma test, but this test is of the kind {one["kind"]}'
    for names in ((*STRETCHES, "held_stretch"), STRESSES, ("time", "rate_1_s")):
        given = [name for name in names if name in one]
        if len(given) > 1:
            yield f"{' and '.join(given)} state the same quantity; keep one of them"
        if not given and names[0] != "time":
            yield f"one of {', '.join(names)} must be given"
    needed = {"displacement": ("length_mm",), "force": ("width_mm", "thickness_mm")}
    for name, dimensions in needed.items():
        for dimension in dimensions if name in one else ():
            if dimension not in one:
                yield f'"{name}" is given, so {dimension} is needed too, here or in [specimen]'
    if "held_stretch" in one and "time" not in one:
        yield '"held_stretch" is given, so the column "time" is needed too'


def _test(one: Mapping[str, Any], folder: Path, number: int) -> MaterialTest:
    """Make a test from an entry without mistakes."""
    table = table_of_file(folder / one["file"])
    place = f"[[tests]] {number}"
    columns = _columns(table, {name: one[name] for name in UNITS if name in one}, place)
    known: dict[str, Any] = {"name": Path(one["file"]).name, "kind": one["kind"], "specimen": one.get("specimen", "")}
    sizes = {name.removesuffix("_mm"): one[name] / 1e3 for name in SPECIMEN if name in one}
    try:
        if one["kind"] == "dma":
            moduli: dict[str, Any] = {
                "frequencies": columns["frequency"],
                "storage": columns["storage"],
                "loss": columns["loss"],
            }
            held = one.get("held_stretch", 1.0)
            return MaterialTest(**known, **moduli, stretch=held, shear=one.get("modulus") == "shear")
        stretch, stress = _pull(columns, one, sizes)
        times = columns.get("time")
        if np.any(large := stretch > LARGEST):
            row = int(np.argmax(large))
            raise DataError(
                f"{table.where(row)}: {place} has a stretch of {stretch[row]:.4g} there; it must be at most {LARGEST:g}: "
                "is the unit right, or the length of the specimen?"
            )
        if "rate_1_s" in one:
            moved = np.abs(np.diff(stretch, prepend=1.0))
            times = np.cumsum(moved) / one["rate_1_s"]
        return MaterialTest(**known, times=times, stretch=stretch, stress=stress)
    except DataError as error:
        raise DataError(f"{table.path}{str(error).removeprefix(str(table.path)).removeprefix(known['name'])}") from None


def _pull(columns: Mapping[str, Array], one: Mapping[str, Any], sizes: Mapping[str, float]) -> tuple[Array, Array]:
    """Read stretch and nominal stress."""
    count = next(iter(columns.values())).size
    if "held_stretch" in one:
        stretch = np.full(count, float(one["held_stretch"]))
    elif "displacement" in columns:
        stretch = 1.0 + columns["displacement"] / sizes["length"]
    elif "true_strain" in columns:
        stretch = np.exp(columns["true_strain"])
    else:
        stretch = columns["stretch"] if "stretch" in columns else 1.0 + columns["strain"]
    if "force" in columns:
        return stretch, columns["force"] / (sizes["width"] * sizes["thickness"])
    # A film keeps its volume: in each of the deformations, the area across the force shrinks with the stretch.
    return stretch, columns["stress"] if "stress" in columns else columns["true_stress"] / stretch


def _columns(table: Table, wanted: Mapping[str, str], place: str) -> dict[str, Array]:
    """Read columns in SI units."""
    units, said = list(table.units), list(table.said or [""] * len(table.units))
    found: dict[str, int] = {}
    for name, header in wanted.items():
        bare, unit = split_stated(table, header)
        column = table.column(bare)
        if column in found.values():
            other = next(key for key, one in found.items() if one == column)
            raise DataError(f'{table.path}: {place} takes the column "{table.shown(column)}" as {other} and as {name}')
        if unit:
            _require_agreement(table, column, unit, place)
            units[column], said[column] = find_unit(unit), unit
        found[name] = column
    table = replace(table, units=tuple(units), said=tuple(said))
    for name, column in found.items():
        _require_unit(table, column, name, place)
    table = in_units(table, {column: UNITS[name] for name, column in found.items()})
    order: Sequence[int] = list(found.values())
    return dict(zip(found, table.si(order), strict=True))


def _require_agreement(table: Table, column: int, unit: str, place: str) -> None:
    """Raise an error if the stated unit contradicts that of the file."""
    own = "1" if _is_plain(table, column) else table.units[column]
    if own not in ("", "C", find_unit(unit) or unit):  # C may be degrees or coulombs
        raise DataError(
            f'{table.path}: the column "{table.shown(column)}" is in {own}, but {place} gives it the unit '
            f'{clipped(unit)}; remove "={clipped(unit)}"'
        )


def _is_plain(table: Table, column: int) -> bool:
    """Return whether "=1", a line of units, or a header such as "strain [-]" declares a plain number."""
    said = table.said[column].strip("()[] ") if table.said else ""
    header = table.headers[column].strip()
    return said in _PLAIN or any(header.endswith((f"[{sign}]", f"({sign})")) for sign in _PLAIN)


def _require_unit(table: Table, column: int, name: str, place: str) -> None:
    """Raise an error for a column without a unit, or with a unit of another quantity."""
    known, wanted = table.units[column], UNITS[name]
    said = "" if _is_plain(table, column) else table.own_unit(column)
    usual = {"m": "mm", "Pa": "MPa", "1": "%"}.get(wanted, wanted)
    # A strain of 50 may be in per cent; a stretch is hardly ever given that way.
    if not said and (wanted != "1" or (name in ("strain", "true_strain") and not _is_plain(table, column))):
        plain = ', or "=1" for fractions' if wanted == "1" else ""
        raise DataError(
            f'{table.path}: the column "{table.shown(column)}" gives no unit; state it in {place}: '
            f'{name} = "{table.unmistakable(column)}={usual}"{plain}'
        )
    if said and not (known and same_kind(KNOWN_UNITS[known].si, wanted)):
        plain = "a plain number, or in %" if wanted == "1" else f"in a unit like {usual}"
        raise DataError(
            f'{table.path}: the column "{table.shown(column)}" is in {clipped(said)}; as the {name} of {place} it must be {plain}'
        )
