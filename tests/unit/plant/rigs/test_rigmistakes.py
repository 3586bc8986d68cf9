"""A rig file with several mistakes: all of them in one error, each with its key, its line and what is allowed."""

import re
import tomllib
from pathlib import Path

import pytest
from rig_files import RIG, SOUND

from deatwin.plant import load_plant
from deatwin.plant.errors import RigError
from deatwin.plant.rigs.rigfile import RigFile, read_rig
from deatwin.plant.rigs.rigkinds import KINDS
from deatwin.plant.rigs.rigmistakes import MOST, mistakes_of, remarks_of
from deatwin.plant.rigs.rigtemplate import rig_template

WRONG = """\
# of the second visit
[film]
material = "VHB 4905"
thickness_mm = 0.0005
prestrech = 3.5
frame_diameter_mm = 80.0
electrode_diameter_mm = 90.0

[load]
mass_g = "3"
contact_diameter_mm = 6.0

[drive]
start_ramp_s = 2.0
start_hold_s = 3.0

[senser]
sample_rate_Hz = 50.0
noise_um = -2.0
zero = "displacement at rest"
"""
ALL = (
    (
        "thickness_mm = 0.0005",
        "[film] thickness_mm: 0.0005 is out of range; it must be from 0.001 to 10; if that is in m, write 0.5",
    ),
    ("prestrech = 3.5", '[film]: unknown key "prestrech"; did you mean "prestretch"?'),
    (
        "electrode_diameter_mm = 90.0",
        "[film] electrode_diameter_mm: 90 is out of range; it must be below frame_diameter_mm, 80",
    ),
    ('mass_g = "3"', '[load] mass_g: "3" is text; it must be a number from 0.001 to 1000'),
    (
        "[drive]",
        '[drive]: the key "gain" is missing; it must be a number from 1 to 100000; or give input = "film voltage" instead',
    ),
    ("[senser]", 'unknown section [senser]; did you mean "sensor"?'),
    ("noise_um = -2.0", "[senser] noise_um: -2.0 is out of range; it must be from 0 to 10000"),
    (
        'zero = "displacement at rest"',
        '[senser] zero: "displacement at rest" is not known; it must be "displacement at zero volts" or "arbitrary"',
    ),
)
"""The line at which each is told, and what is said, in the order of the file."""


def said_of(tmp_path: Path, text: str) -> str:
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8", newline="")
    with pytest.raises(RigError) as caught:
        read_rig(tmp_path / "rig.toml")
    return str(caught.value).removeprefix(f"{tmp_path}/")


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_all_are_told_in_the_order_of_the_file(tmp_path: Path, ends: str) -> None:
    lines = WRONG.splitlines()
    expected = [
        f"({number}) line {lines.index(line) + 1}, {text}"
        if text.startswith("[")
        else f"({number}) line {lines.index(line) + 1}: {text}"
        for number, (line, text) in enumerate(ALL, start=1)
    ]
    assert said_of(tmp_path, WRONG.replace("\n", ends)) == f"rig.toml: {len(ALL)} mistakes: {' '.join(expected)}"


def test_what_is_missing_has_the_line_of_its_section_or_none() -> None:
    data = {"film": SOUND["film"], "load": {}, "drive": SOUND["drive"]}
    with pytest.raises(RigError) as caught:
        RigFile.from_dict(data, "a rig")
    assert str(caught.value) == (
        'a rig: 3 mistakes: (1) [load]: the key "mass_g" is missing; it must be a number from 0.001 to 1000 '
        '(2) [load]: the key "contact_diameter_mm" is missing; it must be a number from 0.01 to 1000 '
        "(3) the section [sensor] is missing; it must hold sample_rate_Hz, noise_um, zero"
    )


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("film = {prestretch = 0.5, lid = 3}\nload = 3\n", [1, 1, 1, 1, 1, 1, 2]),  # an inline table is in one line
        ("film.prestretch = 0.5\nload.lid = 3\n", [1, 2]),
        ('[ "film" ] # so\n"prestretch" = 0.5\n[load]\nlid = 3\n', [1, 1, 1, 1, 2, 3, 3, 4]),
        ('zero = """\n[load]\nlid = 2"""\n[load]\nlid = 3\n', []),  # what looks like a key may be text
    ],
)
def test_lines_are_told_where_they_are_known(tmp_path: Path, text: str, lines: list[int]) -> None:
    said = said_of(tmp_path, text)
    assert [int(found) for found in re.findall(r"\(\d+\) line (\d+)", said)] == lines
    assert said.index("the section [sensor] is missing") > said.rfind("line ")


@pytest.mark.parametrize("name", ["Kind", "kin", "type"])
def test_a_kind_under_another_name_is_the_kind(name: str) -> None:
    stack = {"film": {"material": "Elastosil 2030", "thickness_mm": 0.1, "layers": 100, "area_mm2": 400.0}}
    with pytest.raises(RigError) as caught:
        RigFile.from_dict({name: "stack", **stack, "drive": SOUND["drive"], "sensor": SOUND["sensor"]}, "a rig")
    assert str(caught.value) == f'a rig: unknown key "{name}"; did you mean "kind"?'


@pytest.mark.parametrize("kind", ["stack", "roll", "bow_tie", "cone", "coupon", "pressure"])
def test_a_missing_or_misplaced_kind_is_one_mistake(tmp_path: Path, kind: str) -> None:
    """Without the key, the file would be checked as that of a diaphragm, with a mistake for each key."""
    text = re.sub(r"^#(?=\w+ =)", "", rig_template({}, kind=kind), flags=re.MULTILINE)
    (tmp_path / "rig.toml").write_text(text.replace(f'kind = "{kind}"\n', ""), encoding="utf-8")
    with pytest.raises(
        RigError, match=rf'rig\.toml: the key "kind" is missing, .*kind = "{kind}".* above all sections$'
    ):
        read_rig(tmp_path / "rig.toml")
    moved = text.replace(f'kind = "{kind}"\n', "").replace("[sensor]", f'[sensor]\nkind = "{kind}"')
    (tmp_path / "rig.toml").write_text(moved, encoding="utf-8")
    with pytest.raises(RigError, match=r'line \d+, \[sensor\]: the key "kind" belongs above the first section$'):
        read_rig(tmp_path / "rig.toml")


def test_an_unknown_material_is_listed_with_the_other_mistakes(tmp_path: Path) -> None:
    lines = RIG.split("\n")
    place = next(k for k, line in enumerate(lines) if line.startswith("material ="))
    lines[place] = 'material = "VHB 4906"'
    other = next(k for k, line in enumerate(lines) if line.startswith("thickness_mm"))
    lines[other] = "thickness_mm = 5e-4"
    (tmp_path / "rig.toml").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(RigError, match="2 mistakes: ") as caught:
        read_rig(tmp_path / "rig.toml")
    assert f"line {place + 1}, [film] material: unknown material 'VHB 4906'" in str(caught.value)
    assert f"line {other + 1}, [film] thickness_mm: 0.0005 is out of range" in str(caught.value)


def test_all_entries_of_an_unknown_material_are_checked() -> None:
    film = {key: value for key, value in SOUND["film"].items() if key != "material"}
    own = {"name": "mine", "permittivity": 0.5, "branches": [{"modulus_Pa": 1e4}]}
    with pytest.raises(RigError, match="3 mistakes: ") as caught:
        RigFile.from_dict({**SOUND, "film": film, "material": own}, "a rig")
    for said in ("is not a published material", "0.5 is below 1", 'branch 1 lacks "time_s"'):
        assert said in str(caught.value)


def test_a_single_mistake_has_its_line(tmp_path: Path) -> None:
    for old, new, told in (
        ('"VHB 4905"', '"VHB 4906"', r"line \d+, \[film\] material: unknown material 'VHB 4906'; did you mean"),
        ("thickness_mm = 0.5", "thickness_mm = 5e-4", r"line 3, \[film\] thickness_mm: 0\.0005 is out of range"),
    ):
        (tmp_path / "rig.toml").write_text(RIG.replace(old, new), encoding="utf-8")
        with pytest.raises(RigError, match=told):
            load_plant(tmp_path / "rig.toml")


@pytest.mark.parametrize("name", ["reading", "readngs"])
def test_a_misspelt_section_of_readings_is_told(name: str) -> None:
    with pytest.raises(RigError) as caught:
        RigFile.from_dict({**SOUND, name: {"current": {"unit": "nA", "noise": 5.0}}}, "a rig")
    assert str(caught.value) == f'a rig: unknown section [{name}]; did you mean "readings"?'


@pytest.mark.parametrize(
    ("key", "value", "hint"),
    [
        ("bleed_resistance_Mohm", 5e8, "if that is in ohm, write 500"),
        ("series_resistance_Mohm", 1e6, "if that is in ohm, write 1"),
        ("current_limit_uA", 2e-4, "if that is in A, write 200"),
    ],
)
def test_a_part_of_the_drive_in_another_unit_is_told(key: str, value: float, hint: str) -> None:
    with pytest.raises(RigError) as caught:
        RigFile.from_dict({**SOUND, "drive": {**SOUND["drive"], key: value}}, "a rig")
    assert str(caught.value).endswith(hint)


def test_a_name_in_the_wrong_place_is_not_missing_as_well() -> None:
    drive = {key: value for key, value in SOUND["drive"].items() if key != "gain"}
    above, moved = {"gain": 800.0}, {"load": {**SOUND["load"], "gain": 1}}
    for data in ({**SOUND, "drive": drive, **above}, {**SOUND, "drive": drive, **moved}):
        with pytest.raises(RigError, match=r"a rig.*belongs in \[drive\]$") as caught:
            RigFile.from_dict(data, "a rig")
        assert "mistakes" not in str(caught.value)


def test_many_are_counted_and_not_told_one_by_one() -> None:
    data = {**SOUND, "load": {**SOUND["load"], **{f"colour_{k}": k for k in range(1000)}}}
    with pytest.raises(RigError, match=r"a rig: 1000 mistakes: .* and 980 more$") as caught:
        RigFile.from_dict(data, "a rig")
    assert str(caught.value).count("unknown key") == MOST and len(str(caught.value)) < 3000


DISC = """\
kind = "disc"
[film]
material = "Elastosil 2030"
thickness_mm = 0.1
prestretch = 1.2
frame_diameter_mm = 50.0
electrode_diameter_mm = 20.0
[drive]
input = "film voltage"
start = "unknown"
[sensor]
sample_rate_Hz = 50.0
noise_um = 1.2
zero = "arbitrary"
"""
OWN = """\
[material]
name = "mine"
energy = "gent"
permittivity = { value = 2.9, low = 2.5, high = 3.1 }
density_kg_m3 = 1100
[material.parameters]
shear_modulus = { value = 300e3, low = 200e3, high = 500e3 }
stretch_limit = 40
[[material.branches]]
modulus_Pa = 20e3
time_s = 5
[[material.branches]]
modulus_Pa = { value = 10e3, low = 0.1, high = 50e3 }
time_s = { value = 50, low = 20, high = 100 }
[material.breakdown]
field_MV_m = 90
"""
WITH_OWN = DISC.replace('material = "Elastosil 2030"\n', "") + OWN


@pytest.mark.parametrize(
    ("text", "old", "new", "told"),
    [
        (DISC, "[drive]", "[load]\nball = 2\n[drive]", 'unknown key "ball"'),
        (
            DISC,
            'start = "unknown"',
            "start_ramp_s = 1.0",
            '"start_hold_s" is missing; it must be a number from 0 to 86400; or',
        ),
        (WITH_OWN, '"gent"', '"mu/2*(I1 - 3"', r"\[material\] energy: .* not a formula"),
        (WITH_OWN, "stretch_limit = 40", "", r'\[material\] parameters: the parameter "stretch_limit" is missing'),
        (WITH_OWN, "stretch_limit = 40", "stretch_limit = true", "true|True is a truth value; it must be a number, or"),
        (WITH_OWN, "low = 200e3", "low = 400e3", "300000 does not lie in its range from 400000 to 500000"),
        (WITH_OWN, "low = 200e3", "low = 600e3", "low = 600000 exceeds high = 500000"),
        (WITH_OWN, "time_s = 5", "times = 5", 'branch 1 lacks "time_s"'),
        (WITH_OWN, "field_MV_m", "field", 'unknown key "field"'),
        (WITH_OWN, "density_kg_m3 = 1100", "density_kg_m3 = 0", "a density"),
        (WITH_OWN, 'energy = "gent"\n', "", '"mine" is not a published material'),
    ],
)
def test_each_kind_of_mistake(tmp_path: Path, text: str, old: str, new: str, told: str) -> None:
    right = text.replace("low = 0.1,", "low = 2000,")
    assert right.count(old) == 1 or old == "[film]"
    (tmp_path / "rig.toml").write_text(right.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(RigError, match=told) as caught:
        load_plant(tmp_path / "rig.toml")
    assert "\n" not in str(caught.value)


def test_mistakes_in_material_and_film_are_told_together_with_their_lines(tmp_path: Path) -> None:
    wrong = WITH_OWN.replace("prestretch = 1.2", "prestretch = 0.2").replace("shear_modulus =", "shear_moduli =")
    said = said_of(tmp_path, wrong)
    lines = wrong.splitlines()
    for start, what in (("prestretch = 0.2", "prestretch: 0.2"), ("shear_moduli", "parameters shear_moduli: unknown")):
        number = 1 + next(k for k, line in enumerate(lines) if line.startswith(start))
        assert re.search(rf"line {number}, \[\w+\] {what}", said)
    assert "modulus_Pa of branch 2 is out of range" in said and "4 mistakes" in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("noise_mm = 0.002", '"noise_um"? Its value is in um, not in mm: 2'),
        ("thickness_in = 0.02", '"thickness_mm"? Its value is in mm, not in inch: 0.508'),
        ("frame_radius_mm = 40.0", '"frame_diameter_mm"? It is another quantity, in mm'),
        ("sample_time_s = 0.02", '"sample_rate_Hz"? It is another quantity, in Hz'),
        ("spring_rate_N_mm = 0.25", '"spring_rate_N_m"? Its value is in N/m, not in N/mm: 250'),
        ("start_ramp_ms = 2000", '"start_ramp_s"? Its value is in s, not in ms: 2'),
    ],
)
def test_a_key_in_another_unit_is_offered_with_its_value_there(given, said):
    name = given.partition(" ")[0]
    kind, section = next(
        (k, s) for k, one in KINDS.items() for s, keys in one.sections.items() if said.split('"')[1] in keys
    )
    value = tomllib.loads(given)[name]
    (found,) = (m for m in mistakes_of({"kind": kind, section: {name: value}}) if m.line_of == (section, name))
    assert found.text == f'unknown key "{name}"; did you mean {said}'


@pytest.mark.parametrize(
    ("drive", "fault"),
    [
        ("gain = 800.0\ncommand_max_V = 12000", r"12000 times the gain of 800 is 9.6e\+06 V on the film, .*, write 15"),
        ("gain = 800.0\ncommand_min_V = -40", "-40 times the gain of 800 is -32000 V on the film, .*, write -0.05"),
        ("gain = 1.0\ncommand_max_V = 60000", "60000 times the gain of 1 is 60000 V on the film, but .* than 30000 V"),
        ('input = "film voltage"\ncommand_max_V = 60000', "60000 times the gain of 1 is 60000 V on the film"),
        ("gain = 800.0\ncommand_max_V = 15", ""),
        ('input = "film voltage"\ncommand_max_V = 12000', ""),
    ],
)
def test_commands_that_no_film_takes(drive: str, fault: str) -> None:
    rig = tomllib.loads(RIG.replace("gain = 800.0", drive))
    found = [mistake.text for mistake in mistakes_of(rig)]
    assert len(found) == bool(fault) and all(re.fullmatch(f"{fault}.*", text) for text in found), found


UNUSUAL = [
    ("diaphragm", "load", "mass_g", 0.003, "0.003 is unusual; most are 0.2 to 1000; if that is in kg, write 3"),
    ("diaphragm", "load", "contact_diameter_mm", 0.02, "in m, write 20"),
    ("diaphragm", "film", "thickness_mm", 0.0408, "0.5 mm thick or more; if that is after stretching, write 0.5"),
    ("diaphragm", "drive", "gain", 2.0, "in kV a volt, write 2000"),
    ("diaphragm", "drive", "current_limit_uA", 0.2, "in mA, write 200"),
    ("diaphragm", "drive", "sink_current_uA", 2e-4, "in A, write 200"),
    ("diaphragm", "drive", "bleed_resistance_Mohm", 0.5, "in Gohm, write 500"),
    ("diaphragm", "drive", "parallel_capacitance_pF", 1e-10, "in F, write 100"),
    ("diaphragm", "drive", "start_ramp_s", 2000.0, "in ms, write 2"),
    ("diaphragm", "sensor", "sample_rate_Hz", 0.02, "0.02 is unusual; most are 0.1 to 100000"),
    ("diaphragm", "sensor", "noise_um", 0.002, "in mm, write 2"),
    ("diaphragm", "sensor", "noise_um", 2e-6, "in m, write 2"),
    ("planar", "film", "length_mm", 0.05, "in m, write 50"),
    ("roll", "film", "width_mm", 0.5, "in m, write 500"),
    ("roll", "load", "spring_rate_N_m", 0.25, "in N/mm, write 250"),
    ("roll", "load", "force_N", -500.0, "in mN, write -0.5"),
    ("cone", "load", "snap_middle_mm", 0.003, "in m, write 3"),
    ("pressure", "load", "pressure_kPa", 500.0, "in Pa, write 0.5"),
    ("pressure", "load", "pressure_kPa", 0.005, "in bar, write 0.5"),
    ("coupon", "sensor", "noise_mN", 0.002, "in N, write 2"),
]
"""Values that are allowed but in another unit than the key says, and the value that was meant."""


def filled_in(kind: str) -> dict[str, dict[str, float | str]]:
    """Return the sections of a rig file of a kind, with the examples of its template."""
    text = re.sub(r"(?m)^#(?=\w)", "", rig_template({}, kind))
    return tomllib.loads(text)


@pytest.mark.parametrize(("kind", "section", "key", "value", "told"), UNUSUAL)
def test_a_value_that_such_a_rig_hardly_has_is_warned_of_with_the_unit_that_may_be_meant(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str, section: str, key: str, value: float, told: str
) -> None:
    text = re.sub(r"(?m)^#(?=\w)", "", rig_template({}, kind))
    path = tmp_path / "rig.toml"
    path.write_text(re.sub(rf"(?m)^{key} = .*$", f"{key} = {value!r}", text), encoding="utf-8")
    rig = read_rig(path)
    assert rig.stated[section][key] == value
    (said,) = caplog.messages
    assert said.startswith(f"{path}, [{section}] {key}: ") and said.endswith(told)


@pytest.mark.parametrize("kind", KINDS)
def test_the_examples_of_a_template_are_usual(kind: str) -> None:
    rig = filled_in(kind)
    assert not mistakes_of(rig) and not remarks_of(rig)


@pytest.mark.parametrize(
    ("line", "at", "told"),
    [
        ("parameters = { mu1 = 0.6, alpha1 = 1.3, mu2 = 0.001, alpha2 = 5.0 }", "parameters mu1", "MPa, write 600000"),
        ("parameters = { mu1 = 300, alpha1 = 2.0 }", "parameters mu1", "kPa, write 300000"),
        ("branches = [{ modulus_Pa = 40, time_s = 8.0 }]", "branches", "kPa, write 40000"),
        ("density_kg_m3 = 1.07", "density_kg_m3", "g/cm³, write 1070"),
        ("permittivity = 280", "permittivity", "most are 1 to 150"),
        ("parameters = { mu1 = 6e5, alpha1 = 1.3, mu2 = 1.0, alpha2 = 5.0 }", "", ""),
    ],
)
def test_an_elastomer_of_another_stiffness_or_density_is_warned_of(line: str, at: str, told: str) -> None:
    parameters = "" if line.startswith("parameters") else "\nparameters = { mu1 = 6e5, alpha1 = 1.3 }"
    material = tomllib.loads(f'energy = "ogden"{parameters}\n{line}')
    remarks = remarks_of({"material": material})
    assert [remark.where for remark in remarks] == ([f"[material] {at}"] if at else [])
    assert all(remark.text.endswith(told) for remark in remarks)


@pytest.mark.parametrize(
    ("entry", "said"), [({"name": 1}, "1 is a number; it must be text"), ({"name": ""}, "text in quotes")]
)
def test_a_name_of_a_material_that_is_no_text_is_one_mistake(entry: dict, said: str) -> None:
    film = {key: value for key, value in SOUND["film"].items() if key != "material"}
    with pytest.raises(RigError, match=said) as caught:
        RigFile.from_dict({**SOUND, "film": film, "material": entry}, "a rig")
    assert "mistakes" not in str(caught.value)
