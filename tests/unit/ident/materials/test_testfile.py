"""Lists of tests: all mistakes at once, columns by name, place and unit."""

import json
from pathlib import Path

import numpy as np
import pytest

from deatwin.ident.materials import read_material_tests
from deatwin.plant import DataError
from deatwin.plant.files import write_csv, write_text_atomic

SIZES = "[specimen]\nlength_mm = 50\nwidth_mm = 5\nthickness_mm = 2\n"


def pulled(file: str, **keys: object) -> str:
    """An entry of a pull in a list of tests."""
    lines = ["[[tests]]", 'kind = "tension"', f'file = "{file}"', *(f"{k} = {json.dumps(v)}" for k, v in keys.items())]
    return "\n".join(lines) + "\n"


def listed(folder: Path, text: str) -> Path:
    write_csv(folder / "a.csv", {"time_s": np.arange(5.0), "x_mm": 5.0 * np.arange(1, 6), "F_N": np.arange(1.0, 6.0)})
    write_csv(folder / "b.csv", {"e_%": 10.0 * np.arange(1, 6), "s": np.arange(1.0, 6.0)})
    write_csv(folder / "c2.csv", {"e": 10.0 * np.arange(1, 6), "s": np.arange(1.0, 6.0)})
    write_csv(folder / "d.csv", {"e [-]": 0.1 * np.arange(1, 6), "f": 0.1 * np.arange(1, 6), "s": np.arange(1.0, 6.0)})
    write_text_atomic(folder / "tests.toml", text)
    return folder / "tests.toml"


def test_displacement_and_force_become_stretch_and_stress(tmp_path: Path) -> None:
    text = '[[tests]]\nkind = "cycles"\nfile = "a.csv"\ntime = "time_s"\ndisplacement = "#2"\nforce = "F_N"\nwidth_mm = 10\n'
    (test,) = read_material_tests(listed(tmp_path, SIZES + text)).tests
    np.testing.assert_allclose(test.stretch, 1 + 0.1 * np.arange(1, 6))
    np.testing.assert_allclose(test.stress, np.arange(1, 6) / 20e-6)  # its own width
    np.testing.assert_array_equal(test.times, np.arange(5.0))


def test_true_stress_strain_in_per_cent_and_a_rate(tmp_path: Path) -> None:
    text = '[[tests]]\nkind = "tension"\nfile = "b.csv"\nstrain = "#1"\ntrue_stress = "s=kPa"\nrate_1_s = 0.05\nspecimen = "A"\n'
    (test,) = read_material_tests(listed(tmp_path, text)).tests
    np.testing.assert_allclose(test.stretch, 1 + 0.1 * np.arange(1, 6))
    np.testing.assert_allclose(test.stress, 1e3 * np.arange(1, 6) / test.stretch)
    np.testing.assert_allclose(test.times, 2.0 * np.arange(1, 6))
    assert test.specimen == "A"


@pytest.mark.parametrize("strain", ["e [-]", "f=1", "f=mm/mm"])
def test_a_strain_is_said_to_be_a_fraction(tmp_path: Path, strain: str) -> None:
    (test,) = read_material_tests(listed(tmp_path, pulled("d.csv", strain=strain, stress="s=kPa"))).tests
    np.testing.assert_allclose(test.stretch, 1 + 0.1 * np.arange(1, 6))


def test_two_tests_of_one_file_have_names_of_their_own(tmp_path: Path) -> None:
    one = pulled("b.csv", strain="#1", stress="s=kPa")
    names = [test.name for test in read_material_tests(listed(tmp_path, one + one)).tests]
    assert names == ["b.csv (1)", "b.csv (2)"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[specimen]\nwdth_mm = 3\n[[tests]]\nkind = 3\n",
            r"did you mean .width_mm.*kind: 3 is a number.*.file. is missing",
        ),
        ("tests = 3\n", "there is no test"),
        (
            '[material]\nenergy = "ogdn"\n' + pulled("b.csv", strain="#1", stress="s=kPa"),
            r"tests.toml: \[material\] energy: unknown energy .ogdn.",
        ),
        (
            "[material]\npermittivity = -2.8\n" + pulled("b.csv", strain="#1", stress="s=kPa"),
            r"tests.toml: \[material\] permittivity: -2.8 is below 1",
        ),
        ('[tests]\nkind = "tension"\n', r"write \[\[tests\]\] with double brackets"),
        (
            pulled("b.csv", strain="#1=1", stress="s=kPa"),
            r'b.csv: the column "e_%" is in %, but \[\[tests\]\] 1 gives it the unit 1; remove "=1"',
        ),
        (pulled("b.csv", strain="s", stress="#1=kPa"), r'"e_%" is in %, but \[\[tests\]\] 1 gives it the unit kPa'),
        (
            pulled("a.csv", strain="time_s", stress="F_N=mN"),
            r'"F_N" is in N, but \[\[tests\]\] 1 gives it the unit mN; remove "=mN"',
        ),
        (pulled("c2.csv", strain="e", stress="s=kPa"), '"e" gives no unit.*strain = "e=%", or "=1" for fractions'),
        (
            pulled("c2.csv", stretch="e", stress="s=kPa"),
            "c2.csv, row 4: .*a stretch of 30 there; it must be at most 20",
        ),
        ('[[tests]]\nkind = "dma"\nfile = "b.csv"\nstress = "s"\n', 'needs the column "frequency".*has no "stress"'),
        (pulled("b.csv", strain="#1"), "one of stress, true_stress, force must be given"),
        (pulled("b.csv", strain="#1", stretch="#1", stress="s"), "stretch and strain state the same quantity"),
        (pulled("b.csv", held_stretch=2, stress="s"), 'the column "time" is needed too'),
        (pulled("b.csv", strain="#1", stress="s"), 'gives no unit.*stress = "s=MPa"'),
        (pulled("b.csv", strain="#1", stress="#1"), "as strain and as stress"),
        (pulled("c.csv", strain="#1", stress="s"), "c.csv: no such file"),
        (pulled("a.csv", strain="x_mm", stress="F_N=Pa"), "is in N, but .* gives it|is in mm"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(DataError, match=said):
        read_material_tests(listed(tmp_path, text))
