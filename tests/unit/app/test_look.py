"""``deatwin look``: what is in files, what reads them, and a next command that works."""

import json
import re
import shlex
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.app.cli import main
from deatwin.app.commands.look import RigKind
from deatwin.app.given import GivenPlant, direction_notes

RNG = np.random.default_rng(0)


def table(path: str, header: str, columns: list[np.ndarray], between: str = ",") -> None:
    rows = "\n".join(between.join(f"{value:.5f}" for value in row) for row in zip(*columns, strict=True))
    Path(path).write_text(f"{header}\n{rows}\n" if header else f"{rows}\n", encoding="utf-8")


def motion(n: int = 400) -> list[np.ndarray]:
    """Times, white input, output of first order behind it."""
    u = RNG.normal(size=n)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.7 * y[k - 1] + 0.5 * u[k - 1]
    return [0.1 * np.arange(n), u, y + 0.01 * RNG.normal(size=n)]


def told(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    main(["look", *words, "--json"])
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


FILES = {
    "as deatwin writes it": ("a.csv", "time_s,command_V,displacement_mm", ",", []),
    "a stranger's": ("b.csv", "Time (s);U_set (V);Laser (um)", ";", []),
    "no header": ("c.dat", "", " ", []),
    "no times": ("d.csv", "k,u,y", ",", ["--dt", "0.1", "--input-column", "u", "--output-column", "y"]),
}


@pytest.mark.parametrize("kind", FILES)
def test_the_next_command_works(kind, at_desk, capsys):
    name, header, between, options = FILES[kind]
    columns = motion()
    table(name, header, [RNG.permutation(400), *columns[1:]] if kind == "no times" else columns, between)
    command = shlex.split(told(capsys, name, *options)["next"]["command"])
    assert command[:2] == ["deatwin", "identify"]
    assert main([*command[1:], "--method", "frols"]) == 0
    assert Path("narx.json").is_file()


def test_what_is_said_and_written(at_desk, capsys):
    table("a.csv", "time_s,u,y", motion())
    assert main(["look", "a.csv", "--out", "looked"]) == 0
    said = capsys.readouterr().out
    assert 'column 2 "u": input, unit not given (guessed)' in said
    assert 'other commands cannot read this file as it is: a.csv: no column "command_V"' in said
    assert "deatwin look read this file with the options --input-column u --output-column y" in said
    assert "the output follows the input" in said
    assert "deatwin identify a.csv --input-column u --output-column y --out narx.json" in said
    picture = Path("looked/look.svg").read_text(encoding="utf-8")
    assert ElementTree.fromstring(picture).tag.endswith("svg") and "prefers-color-scheme:dark" in picture
    held = json.loads(Path("looked/look.json").read_text(encoding="utf-8"))
    assert held["files"][0]["look"]["links"][0]["dead_time_samples"] == 1
    assert held["files"][0]["look"]["inputs"][0]["shape"] == "noise"
    assert Path("looked/run.json").is_file()


def test_several_files_of_one_kind_are_given_to_one_model(at_desk, capsys):
    for name in ("a.csv", "b.csv"):
        table(name, "time_s,command_V,displacement_mm", motion())
    times, u, y = motion()
    table("slower.csv", "time_s,command_V,displacement_mm", [10.0 * times, u, y])
    found = told(capsys, "a.csv", "b.csv", "slower.csv", "--out", "looked")
    assert found["next"]["command"] == "deatwin identify a.csv b.csv --out narx.json"
    assert "(this leaves out 1 file with different columns, units or sample times" in found["next"]["sentence"]
    assert sorted(path.name for path in Path("looked").glob("*.svg")) == ["look_1.svg", "look_2.svg", "look_3.svg"]


def test_only_recordings_with_many_frequencies_are_advised_for_a_model(at_desk, capsys):
    times, u, _ = motion()
    for name, command in (("steps.csv", np.repeat(u[::20], 20)), ("noise.csv", u)):
        table(
            name, "time_s,command_V,displacement_mm", [times, command, np.convolve(command, 0.5 ** np.arange(9))[:400]]
        )
    found = told(capsys, "steps.csv", "noise.csv")["next"]
    assert found["command"] == "deatwin identify noise.csv --out narx.json"
    assert "; use steps.csv only to test the model, because a model fitted to steps" in found["sentence"]
    command = told(capsys, "steps.csv")["next"]["command"]
    assert command == "deatwin identify steps.csv --method semp --out narx.json"
    assert main(shlex.split(command)[1:]) == 0


@pytest.mark.parametrize(("start", "given"), [(40.0, "a.csv b.csv"), (0.0, "--experiment a.csv --experiment b.csv")])
def test_recordings_on_one_clock_are_one_experiment(at_desk, capsys, start, given):
    for name, begins in (("a.csv", 0.0), ("b.csv", start)):
        times, u, y = motion()
        table(name, "time_s,command_V,displacement_mm", [times + begins, u, y])
    found = told(capsys, "a.csv", "b.csv", "--rig", "diaphragm", "--out", "looked")
    assert found["next"]["command"] == f"deatwin diagnose looked/rig.toml {given} --out found"


def test_a_rig_needs_the_units_of_its_columns(at_desk, capsys):
    table("a.csv", "time_s,command_V,x", motion())
    found = told(capsys, "a.csv", "--rig", "diaphragm", "--out", "looked")
    assert "x gives no unit" in found["next"]["sentence"] and found["next"]["command"] == ""
    assert (
        "diagnose"
        in told(capsys, "a.csv", "--output-column", "x=mm", "--rig", "diaphragm", "--out", "b")["next"]["command"]
    )


def test_columns_that_are_not_linked_lead_to_others(at_desk, capsys):
    times, u, y = motion()
    table("a.csv", "time_s,u,y,z", [times, u, RNG.normal(size=400), y])
    following = told(capsys, "a.csv")["next"]
    assert following["command"] == "deatwin look a.csv --input-column u --output-column '#4'"
    assert main(shlex.split(following["command"])[1:]) == 0


def test_an_input_that_never_moves_leads_to_no_model(at_desk, capsys):
    times, _, y = motion()
    table("a.csv", "time_s,command_V,displacement_mm", [times, np.ones(400), y])
    assert told(capsys, "a.csv")["next"] == {
        "sentence": "the input is constant; name another column, or record again with a varying input",
        "command": "",
    }


def test_a_rig_file_to_fill_in(at_desk, capsys):
    times, u, y = motion()
    table("a.csv", "time_s,command_V,displacement_mm", [times, 2.0 + 0.3 * u, 0.05 * y])
    assert main(["look", "a.csv", "--rig", "diaphragm", "--out", "looked"]) == 0
    assert "deatwin diagnose looked/rig.toml a.csv --out found" in capsys.readouterr().out
    path = Path("looked/rig.toml")
    text = path.read_text(encoding="utf-8")
    assert "\nsample_rate_Hz = 10.0\n" in text and re.search(r"^noise_um = \d", text, re.MULTILINE)
    path.write_text(re.sub(r"^#(?=\w)", "", text, flags=re.MULTILINE), encoding="utf-8")
    assert main(["simulate", str(path), "a.csv", "--out", "predicted.csv"]) == 0
    assert main(["look", "a.csv", "--rig", "diaphragm", "--out", "looked"]) == 2  # what was filled in stays
    assert main(["look", "a.csv", "--rig", "diaphragm"]) == 2


@pytest.mark.parametrize("kind", RigKind)
def test_a_rig_file_before_anything_is_recorded(at_desk, kind, capsys):
    assert main(["look", "--rig", kind, "--out", "looked"]) == 0
    said = capsys.readouterr().out
    assert "deatwin plan looked/rig.toml --out planned" in said
    named = re.search(r"fill in looked/rig\.toml, (\w+) and (\w+) too", said)
    assert named is not None
    path = Path("looked/rig.toml")
    text = path.read_text(encoding="utf-8")
    wanted = rf"(?<!may be left out\n)^#(?=\w+ =)|^#(?=(?:{named[1]}|{named[2]}) =)"
    path.write_text(re.sub(wanted, "", text, flags=re.MULTILINE), encoding="utf-8")
    assert GivenPlant.load(str(path)).model.plant.rig.command_range is not None  # plan needs it to suggest an input
    path.write_text(re.sub(r"^#(?=\w)", "", text, flags=re.MULTILINE), encoding="utf-8")
    assert GivenPlant.load(str(path)).model.plant.rig.sample_time > 0.0
    assert Path("looked/rig.svg").read_text(encoding="utf-8").lstrip().startswith("<")


@pytest.mark.parametrize(("sign", "direction"), [(1.0, "along the motion"), (-1.0, "against the motion")])
def test_a_sensor_on_the_other_side(at_desk, sign, direction):
    times = 0.1 * np.arange(400)
    u = 2.0 + np.sin(times)
    y = 5.0 + sign * 0.01 * u**2 + 1e-3 * np.random.default_rng(1).normal(size=400)
    table("a.csv", "time_s,command_V,displacement_mm", [times, u, y])
    assert main(["look", "a.csv", "--rig", "cone", "--out", "looked"]) == 0
    text = Path("looked/rig.toml").read_text(encoding="utf-8")
    assert f'{"" if sign < 0 else "#"}direction = "{direction}"' in text.splitlines()
    filled = re.sub(r"^#(?=\w)", "", text, flags=re.MULTILINE).replace(direction, "along the motion")
    Path("rig.toml").write_text(filled, encoding="utf-8")
    given = GivenPlant.load("rig.toml")
    notes = direction_notes(given, given.experiment(["a.csv"]).recordings)
    assert len(notes) == (sign < 0) and all("against the motion" in note for note in notes)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a letter\n",
        "time_s,command_V,displacement_mm\n",
        "time_s,command_V,displacement_mm\n0,1,2\n",
        "time_s,command_V,displacement_mm\n0,1,2\n0.1,nan,3\n0.2,1,2\n",
        "time_s,command_V,displacement_mm\n0,1,2\n0.1,2,3\n",
        "u,y\n" + "1,2\n" * 50,
        "\x00\x01\x02",
    ],
)
def test_an_odd_file_is_no_traceback(at_desk, capsys, text):
    Path("odd.csv").write_text(text, encoding="utf-8")
    status = main(["look", "odd.csv", "--out", "looked"])
    out, error = capsys.readouterr()
    assert status in (0, 1) and "Traceback" not in error
    assert (status == 1) == error.startswith("error: odd.csv")
    assert "next: " in out
    if status == 1:
        main(["identify", "odd.csv", "--out", "narx.json"])
        assert capsys.readouterr().err.splitlines()[-1] in error.splitlines()


def test_a_file_that_lacks_its_sample_time(at_desk, capsys):
    _, u, y = motion()
    table("a.csv", "u,y", [u, y])
    assert main(["look", "a.csv"]) == 1
    said = capsys.readouterr().out
    assert "deatwin look a.csv --input-column u --output-column y --dt SECONDS" in said


def wiener(rng: np.random.Generator, n: int = 256, periods: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One random phase of a multisine of 59 lines through a lag of second order with a square and a cube, in mm: input, output, reading."""
    lines = np.zeros(n // 2 + 1, dtype=complex)
    lines[1:60] = np.exp(2j * np.pi * rng.random(59))
    u = np.fft.irfft(lines, n)
    u = np.tile(u / u.std(), periods + 3)
    v = lfilter([0.3, 0.2], [1.0, -1.2, 0.6], u)
    y = v + 0.2 * v**2 - 0.1 * v**3
    rows = slice(3 * n, None)  # settled
    return u[rows], y[rows], y[rows] + 0.02 * rng.normal(size=periods * n)


def test_realisations_in_several_files_are_approximated_together(at_desk, capsys):
    rng = np.random.default_rng(0)
    runs = [wiener(rng) for _ in range(2)]
    for name, (u, _, y) in zip("ab", runs, strict=True):
        table(f"{name}.csv", "time_s,command_V,displacement_mm", [0.01 * np.arange(u.size), u, y])
    assert main(["look", "a.csv", "b.csv", "--out", "looked"]) == 0
    said = capsys.readouterr().out.partition("all recordings together: ")[2]
    assert said.startswith("best linear approximation at 59 lines from 2 realisations")
    assert "nonlinear distortion" in said and "unknown" not in said
    assert {p.name for p in Path("looked").glob("best*")} == {f"best_linear{n}.svg" for n in ("", "_1", "_2")}
    told = json.loads(Path("looked/look.json").read_text(encoding="utf-8"))["best_linear"]
    # 2 * 3 * 128 squares tell the noise within 3 %.
    assert told["noise_rms"] == pytest.approx(0.02e-3, rel=0.1)


def test_periodic_files_that_do_not_fit_together_are_described_one_by_one(at_desk, capsys):
    rng = np.random.default_rng(0)
    for name, step in (("a", 0.01), ("b", 0.02)):
        u, _, y = wiener(rng)
        table(f"{name}.csv", "time_s,command_V,displacement_mm", [step * np.arange(u.size), u, y])
    assert main(["look", "a.csv", "b.csv"]) == 0
    said = capsys.readouterr().out
    assert said.count("best linear approximation at 59 lines") == 2 and "all recordings together" not in said


@pytest.mark.parametrize(
    ("header", "order", "roles", "said"),
    [
        ("time_s,Position (mm),Force (N),Strain (%)", (0, 1, 2, 1), ["time", "", "output", "input"], "fill in"),
        (
            "Time (Sec),Force (N),Position (mm)",
            (0, 2, 1),
            ["time", "output", "input"],
            "Position is in m; compute the ratio",
        ),
        ("time_s,stretch,load (mN)", (0, 1, 2), ["time", "input", "output"], "fill in"),
        (
            "time_s,HV (V),Force (N)",
            (0, 1, 2),
            ["time", "input", "output"],
            "ratio, such as a stretch, but the column HV is in V",
        ),
    ],
)
def test_a_test_machine_gives_a_stretch_and_reads_a_force(header, order, roles, said, at_desk, capsys):
    columns = motion()
    table("a.csv", header, [columns[k] for k in order])
    found = told(capsys, "a.csv", "--rig", "coupon", "--out", "looked")
    assert [column["role"] for column in found["files"][0]["columns"]] == roles
    assert said in found["next"]["sentence"]
