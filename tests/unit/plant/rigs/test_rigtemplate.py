"""The rig file to be filled in: what it lacks is told, and filled in it is read."""

import re
from pathlib import Path

import pytest

from deatwin.plant import BowTie, RigError, load_plant, read_rig
from deatwin.plant.rigs.rigkinds import KINDS
from deatwin.plant.rigs.rigtemplate import rig_template

KNOWN = {"sample_rate_Hz": (100.0, "as recorded"), "noise_um": (1.25, "at most"), "noise_mN": (2.0, "at most")}
every = pytest.mark.parametrize("kind", KINDS)


@every
def test_every_key_that_is_missing_is_named(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_template(KNOWN, kind), encoding="utf-8")
    with pytest.raises(RigError) as told:
        read_rig(path)
    needed = {name for keys in KINDS[kind].sections.values() for name, key in keys.items() if key.required}
    assert set(re.findall(r'the key "(\w+)" is missing', str(told.value))) == needed - set(KNOWN)


@every
def test_filled_in_it_is_a_plant(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(re.sub(r"^#(?=\w)", "", rig_template(KNOWN, kind), flags=re.MULTILINE), encoding="utf-8")
    described = read_rig(path)
    assert (described.sensor.sample_rate, described.sensor.noise) == (100.0, 2e-3 if kind == "coupon" else 1.25e-6)
    plant = load_plant(described).plant
    assert (plant.rig.kind, plant.rig.sample_time) == (kind, 0.01)
    moving = (("position", "velocity"), ("deflection", "velocity"))
    assert plant.equations.states[:2] in ((("branch_stretch",),) if kind == "coupon" else moving)


def test_further_readings_that_were_recorded_have_their_sections(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    text = rig_template(KNOWN, "planar", {"current": 5e-9, "capacitance": 1.5e-12})
    path.write_text(re.sub(r"^#(?=\w)", "", text, flags=re.MULTILINE), encoding="utf-8")
    further = load_plant(read_rig(path)).plant.rig.further
    assert {one.name: one.noise for one in further} == pytest.approx({"current": 5e-9, "capacitance": 1.5e-12})


@every
def test_each_key_has_its_meaning_above_it(kind: str) -> None:
    lines = rig_template({}, kind).splitlines()
    for keys in KINDS[kind].sections.values():
        for name, key in keys.items():
            at = next(k for k, line in enumerate(lines) if re.match(rf"#*{name} = ", line))
            assert lines[at - 1].startswith(f"# {name}: {key.about}")
            assert ("may be left out" in lines[at - 1]) == (not key.required)


@every
def test_its_own_material_is_read_in_place_of_the_key(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "rig.toml"
    text = re.sub(r"^#material = .*\n", "", rig_template(KNOWN, kind), flags=re.MULTILINE)
    own = re.sub(r"^##(?=\[|energy|permittivity|shear|modulus_Pa|time_s)", "#", text, flags=re.MULTILINE)
    path.write_text(re.sub(r"^#(?=[\w[])", "", own, flags=re.MULTILINE), encoding="utf-8")
    parameters = load_plant(read_rig(path)).plant.parameters
    values = [parameters[name].value for name in ("shear_modulus", "branch_modulus", "branch_time")]
    assert values == [300e3, 40e3, 8.0]


@pytest.mark.parametrize(
    ("kind", "line", "other", "told"),
    [
        ("stack", "layers = 100.0", "layers = 100.5", "100.5 is not whole; it must be a whole number from 1 to 1e+06"),
        ("bow_tie", 'sides = "clamped"', 'sides = "free"', "free sides contract by themselves"),
        ("bow_tie", "waist_width_mm = 20.0", "waist_width_mm = 80.0", "must be below bar_width_mm, 60"),
        ("roll", "spring_rate_N_m = 250.0", "spring_rate_N_m = 0", "it must be from 0.001 to 1e+06"),
        ("diaphragm", "prestretch = 3.5", "prestretch = 8.0", "below its limit, here 7.4"),
        ("disc", "prestretch = 1.2", "prestretch = 8.0", "below its limit, here 7.4"),
    ],
)
def test_values_that_no_film_can_have_are_refused(tmp_path: Path, kind: str, line: str, other: str, told: str) -> None:
    path = tmp_path / "rig.toml"
    text = re.sub(r"^#(?=\w)", "", rig_template(KNOWN, kind), flags=re.MULTILINE).replace("Elastosil 2030", "VHB 4905")
    assert text.count(f"\n{line}\n") == 1
    path.write_text(text.replace(f"\n{line}\n", f"\n{other}\n"), encoding="utf-8")
    with pytest.raises(RigError, match=re.escape(told)) as caught:
        load_plant(path)
    assert "rig.toml" in str(caught.value)


@pytest.mark.parametrize(("sides", "across"), [("clamped", 1.5), ("free", 1.5**-0.5)])
def test_a_bow_tie_has_no_side_prestretch_that_nobody_stated(tmp_path: Path, sides: str, across: float) -> None:
    path = tmp_path / "rig.toml"
    text = re.sub(r"^#(?=\w)", "", rig_template(KNOWN, "bow_tie"), flags=re.MULTILINE)
    text = text.replace("side_prestretch = 1.2\n", "").replace('sides = "clamped"', f'sides = "{sides}"')
    path.write_text(text, encoding="utf-8")
    rig = load_plant(path).plant.rig
    assert isinstance(rig, BowTie)
    assert rig.across == pytest.approx(across)
