"""Rig files: every key checked, one clear error for each fault."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from rig_files import RIG

from deatwin.plant import Disc, load_plant
from deatwin.plant.errors import RigError
from deatwin.plant.rigs.rigfile import RigFile, read_rig

OPTIONAL = (
    RIG.replace("prestretch = 3.5", 'prestretch = 3.5\nball = "sliding"')
    .replace("gain = 800.0", "gain = 800.0\ncommand_min_V = 1.1\ncommand_max_V = 3.75")
    .replace("noise_um = 2.0", "noise_um = 2.0\nresolution_um = 1.2")
)


def read(tmp_path: Path, text: str) -> RigFile:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return read_rig(path)


def test_si_inside(tmp_path: Path) -> None:
    rig = read(tmp_path, RIG)
    assert rig.material == "VHB 4905"
    assert (rig.film["thickness"], rig.film["frame_diameter"], rig.film["electrode_diameter"]) == (0.5e-3, 0.08, 0.035)
    assert (rig.load["mass"], rig.load["contact_diameter"]) == (3e-3, 6e-3)
    assert (rig.drive.gain, rig.drive.start_ramp, rig.drive.start_hold) == (800.0, 2.0, 3.0)
    assert (rig.sensor.sample_rate, rig.sensor.noise) == (50.0, 2e-6)
    assert rig.source.endswith("rig.toml")


@pytest.mark.parametrize(
    ("text", "expected"), [(RIG, (None, None, None, 0.0)), (OPTIONAL, ("sliding", 1.1, 3.75, pytest.approx(1.2e-6)))]
)
def test_some_keys_may_be_left_out(tmp_path: Path, text: str, expected: tuple[object, ...]) -> None:
    rig = read(tmp_path, text)
    found = (rig.film.get("ball"), rig.drive.command_min, rig.drive.command_max, rig.sensor.resolution)
    assert found == expected


STRIP = """kind = "coupon"
[film]
material = "Elastosil 2030"
thickness_mm = 0.2
width_mm = 10.0
length_mm = 60.0
[drive]
[sensor]
sample_rate_Hz = 20.0
noise_mN = 2.0
"""


@pytest.mark.parametrize(
    ("text", "noise", "stated", "expected"),
    [(RIG, "noise_um = 2.0", "model_error_um = 7.0", 7e-6), (STRIP, "noise_mN = 2.0", "model_error_mN = 7.0", 7e-3)],
    ids=["displacement", "force"],
)
def test_the_model_error_of_a_rig_may_be_stated(
    tmp_path: Path, text: str, noise: str, stated: str, expected: float
) -> None:
    for said in (text, text.replace(noise, f"{noise}\n{stated}")):
        (tmp_path / "rig.toml").write_text(said, encoding="utf-8")
        error = load_plant(tmp_path / "rig.toml").plant.rig.model_error
        assert (error == pytest.approx(expected)) is (said is not text)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("prestretch = 3.5", "prestretch = true", r"prestretch: true is a truth value; it must be a number"),
        ("prestretch = 3.5", "prestretch = [3.5]", r"is a list; it must be a number"),
        ("gain = 800.0", "gain = nan", r"gain: nan is out of range; it must be from 1 to 100000"),
        ("noise_um = 2.0", "noise_um = -2.0", r"noise_um: -2.0 is out of range; it must be from 0 to 10000"),
        ("prestretch = 3.5", 'prestretch = 3.5\nball = "glued"', r'ball: "glued" is not known; it must be "bonded" or'),
        ("gain = 800.0", "gain 800.0", r"not valid TOML: line 11: write gain = 800.0"),
        ("gain = 800.0", "gain = 800,5  # V/V", r"line 11, gain: .* decimal point, not a comma: 800.5"),
        (
            "gain = 800.0",
            "gain = 800 V",
            r"line 11, gain: leave the unit out, because the name of the key contains it: write 800$",
        ),
        ("gain = 800.0", "gain = .8", r"line 11, gain: a number must begin with a digit: write 0.8"),
        ("gain = 800.0", "gain = 800.", r"line 11, gain: a number must end with a digit: write 800.0"),
        ("gain = 800.0", "gain =", r"line 11, gain: there is no value"),
        ("gain = 800.0", "gain = 800.0\ngain = 900.0", r"line 12, gain: the key is already in line 11"),
        ("[drive]", "[drive", r"line 10: a section must be in brackets: write \[drive\]"),
        ("[drive]", "[drive" + "9" * 4000, r"a section must be in brackets: write \[drive9{0,75}…\]$"),
        ("gain = 800.0", f"gain = {'8' * 4000},5", r"line 11, gain: .* not a comma: 8{0,80}….5$"),
        ("gain = 800.0", "gain = high", r'line 11, gain: a text must be in quotes: write "high"'),
        ("gain = 800.0", "gain = [800.0", r"not valid TOML: .*line 1"),
        (
            '"VHB 4905"',
            r'"C:\data\vhb.toml"',
            r"material: a backslash .*write 'C:\\data\\vhb.toml', or C:/data/vhb.toml",
        ),
        ('"VHB 4905"', r'"C:\Uni\lab\vhb.toml"', r"line 2, material: a backslash .*, or C:/Uni/lab/vhb.toml"),
        ('"VHB 4905"', r'"C:\new\tab.toml"', r"line 2, material: a backslash .*write 'C:\\new\\tab.toml'"),
        ('"VHB 4905"', '"VHB 4905  # tape', r'line 2, material: the closing quote is missing: write "VHB 4905"'),
        ("gain = 800.0", "gain: 800.0", r"line 11: write gain = 800.0"),
        ("gain = 800.0", "gain (V/V) = 800.0", r"line 11: write gain_V_V = 800.0"),
        ("noise_um", "noise_µm", r"line \d+: write noise_um = 2.0"),
        ("gain = 800.0", "gain = 800.0;", r"line 11, gain: leave the semicolon out: write 800.0"),
        ("gain = 800.0", "gain = 800.0 // V/V", r"line 11, gain: a comment begins with #, not with //: write 800.0"),
        ("gain = 800.0", "gain = 800.0 % V/V", r"line 11, gain: a comment begins with #, not with %: write 800.0"),
        ("gain = 800.0", "gain = 800.0 ± 5", r"line 11, gain: write one number, without its tolerance: 800.0"),
        ("gain = 800.0", "gain = \u2212800.0", r"line 11, gain: a minus sign is a hyphen: write -800.0"),
        ("gain = 800.0", "g\u0430in = 800.0", r"line 11: write gain = 800.0"),
        ("gain = 800.0", "gain\u00a0= 800.0", r"line 11: the character U\+00A0 must not stand outside quotes"),
        ("[load]", "(load)", r"line \d+: a section must be in brackets: write \[load\]"),
        ("gain = 800.0", "gain = 1.800,5", r"line 11, gain: write a number .* and no other mark: 1800.5"),
        ("gain = 800.0", "gain = 8 x 10^2", r"line 11, gain: write a power of ten as 8e2"),
        ("gain = 800.0", "gain = 0800.0", r"line 11, gain: a number must not begin with 0: write 800.0"),
        ("gain = 800.0", "gain = 1600/2", r"line 11, gain: write a number, not a formula"),
        ("[sensor]", "[drive]", r"line 14: the section \[drive\] is already in line 10: keep one of the two"),
        ("[film]", "film:", r"line 1: a section must be in brackets: write \[film\]"),
        ("[film]", '{"film": 1}', r"it is JSON; write sections in brackets"),
        (
            "[load]",
            "[film.load]",
            r'toml, line 7: "load" is a section of its own, not a part of \[film\]: write \[load\]$',
        ),
        ("[load]\n", "load.", r'2 mistakes: .*"load" is a section of its own, not a part of \[film\]: write \[load\]'),
        ("[load]", "[rig.load]", r"rig.toml, line 7: write \[load\], not \[rig.load\]$"),
        ("gain = 800.0", 'gain = 800.0\nkind = "disc"', r'\[drive\]: the key "kind" belongs above the first section'),
    ],
)
def test_faults(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert RIG.count(old) == 1
    with pytest.raises(RigError, match=message) as caught:
        read(tmp_path, RIG.replace(old, new))
    assert "rig.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_line_ends_of_any_system(tmp_path: Path) -> None:
    for end in ("\r\n", "\r"):
        (tmp_path / "rig.toml").write_bytes(RIG.replace("\n", end).encode())
        assert read_rig(tmp_path / "rig.toml").to_dict() == tomllib.loads(RIG)


SILICONE = """\
kind = "disc"
[film]
material = "Elastosil 2030"
thickness_mm = 0.1
prestretch = 1.2
frame_diameter_mm = 50
electrode_diameter_mm = 20
[drive]
input = "film voltage"
start = "unknown"
[sensor]
sample_rate_Hz = 50
noise_um = 1.2
resolution_um = 0.5
zero = "arbitrary"
"""


def test_a_silicone_disc_is_described_without_a_line_of_python(tmp_path: Path) -> None:
    described = read(tmp_path, SILICONE)
    rig = load_plant(described).plant.rig
    assert isinstance(rig, Disc)
    assert (rig.material, rig.thickness, rig.prestretch, rig.gain) == ("Elastosil 2030", 1e-4, 1.2, 1.0)
    assert (rig.frame_radius, rig.electrode_radius, rig.mass) == (25e-3, 10e-3, 0.0)
    assert not (rig.start_is_known or rig.zero_is_known)
    assert rig.noise == pytest.approx(np.hypot(1.2e-6, 0.5e-6 / np.sqrt(12)))
    assert RigFile.from_dict(json.loads(json.dumps(described.to_dict())), described.source) == described


def test_a_material_of_ones_own_with_ranges(tmp_path: Path) -> None:
    own = """
[material]
name = "filled silicone"
energy = "a*(I1 - 3) + b*(I1 - 3)^2"
permittivity = 5.5
[material.parameters]
a = { value = 90e3, low = 50e3, high = 200e3 }
b = { value = 0, low = -5e3, high = 5e3 }
[[material.branches]]
modulus_Pa = 40e3
time_s = { value = 3, low = 0.5, high = 20 }
[material.breakdown]
field_MV_m = 40
thickness_um = 50
thickness_power = -0.2
"""
    plant = load_plant(read(tmp_path, SILICONE.replace('material = "Elastosil 2030"\n', "") + own)).plant
    film = plant.rig.substance
    assert (film.name, film.breakdown.field, film.breakdown.thickness) == ("filled silicone", 40e6, 50e-6)
    assert film.shear_modulus == pytest.approx(2 * 90e3)
    a, b, modulus, time, permittivity = film.parameters
    assert (a.lower, a.upper, b.lower, b.value) == (50e3, 200e3, -5e3, 0.0)
    assert (modulus.name, modulus.lower, modulus.upper) == ("branch_modulus", 8e3, 200e3)
    assert (time.name, time.lower, time.upper) == ("branch_time", 0.5, 20.0)
    assert (permittivity.value, permittivity.lower) == (5.5, 2.75)
    assert "branch_at_start" in plant.parameters.free


def test_a_published_material_may_be_changed_in_part(tmp_path: Path) -> None:
    text = SILICONE.replace('material = "Elastosil 2030"\n', "")
    changed = load_plant(read(tmp_path, text + '[material]\nname = "RTV 615"\npermittivity = 3.0\n')).plant
    assert changed.parameters["permittivity"].value == 3.0
    assert changed.parameters["stretch_limit"].value == 7.46
