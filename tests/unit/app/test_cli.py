"""The command line: exit statuses, error lines, files."""

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from strips import COLUMNS

from deatwin.app.cli import main
from deatwin.app.options import fold_experiments, unfold_experiment
from deatwin.plant import Diaphragm, Experiment
from deatwin.plant.files import read_commands, read_recordings, write_csv
from deatwin.plant.sources import load_plant


def test_an_experiment_takes_the_files_up_to_the_next_option():
    given = "diagnose rig --experiment a b --seed 1 --experiment=c d --quiet".split()
    folded = fold_experiments(given)
    assert folded[:3] == ["diagnose", "rig", "--experiment"]
    assert unfold_experiment(folded[3]) == ["a", "b"]
    assert folded[4:7] == ["--seed", "1", "--experiment"]
    assert unfold_experiment(folded[7]) == ["c", "d"]
    assert folded[8:] == ["--quiet"]


def test_output_and_names_that_the_locale_cannot_encode(monkeypatch, capsys):
    assert main(["look", "m\udce4ss.csv"]) == 1
    assert (
        r"m\udce4ss.csv: the locale cannot represent some characters of this name; rename the file, or set a UTF-8 locale"
        in capsys.readouterr().err
    )
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    main(["--version"])
    print("µm", flush=True)
    assert written.getvalue().endswith(b"\\xb5m\n")


def test_simulate_goes_through_the_history(on_bench, capsys):
    assert main(["simulate", "rig.toml", "second.csv", "--out", "alone.csv", "--quiet"]) == 0
    with_history = ["simulate", "rig.toml", "second.csv", "--history", "first.csv", "--out", "after.csv", "--quiet"]
    assert main(with_history) == 0
    assert capsys.readouterr().out == ""
    tables = [np.genfromtxt(name, delimiter=",", names=True) for name in ("alone.csv", "after.csv")]
    for table in tables:
        assert table.dtype.names == ("time_s", "displacement_mm", "low_mm", "high_mm")
        np.testing.assert_allclose(table["time_s"], np.arange(200) * 0.02 + 6)
        # a nominal plant: the band is that of noise and model error
        deviation = np.hypot(2e-3, 1e3 * Diaphragm.model_error)
        np.testing.assert_allclose(table["high_mm"] - table["low_mm"], 2 * 1.959964 * deviation, rtol=1e-3)
    difference = np.abs(tables[0]["displacement_mm"] - tables[1]["displacement_mm"])
    assert difference[0] > 1e-3  # the start procedure ends at the first command; the history does not
    assert difference[-1] < 0.1 * difference.max()


def test_a_rig_without_noise_has_no_band(on_bench):
    Path("exact.toml").write_text(
        """kind = "planar"
[film]
material = "Elastosil 2030"
thickness_mm = 0.1
length_mm = 40.0
width_mm = 60.0
prestretch = 1.2
[load]
mass_g = 20.0
[drive]
gain = 600.0
start_ramp_s = 2.0
start_hold_s = 3.0
[sensor]
sample_rate_Hz = 50.0
noise_um = 0.0
zero = "displacement at zero volts"
""",
        encoding="utf-8",
    )
    assert main(["simulate", "exact.toml", "first.csv", "--out", "exact.csv"]) == 0
    table = np.genfromtxt("exact.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["low_mm"], table["high_mm"])
    assert np.ptp(table["displacement_mm"]) > 0.01


def test_simulate_writes_further_readings_too(on_bench, capsys):
    sections = '\n[readings.current]\nunit = "nA"\nnoise = 5.0\n[readings.capacitance]\nunit = "pF"\nnoise = 1.5\n'
    Path("more.toml").write_text(Path("rig.toml").read_text(encoding="utf-8") + sections, encoding="utf-8")
    assert main(["simulate", "more.toml", "first.csv", "--out", "more.csv"]) == 0
    assert "displacement and of current and of capacitance with a 95 % predictive band" in capsys.readouterr().out
    table = np.genfromtxt("more.csv", delimiter=",", names=True)
    ends = ("current_uA", "capacitance_pF")
    assert table.dtype.names[4:] == tuple(f"{end}{name}" for name in ends for end in ("", "low_", "high_"))
    # A nominal plant: the band is that of the noise.
    np.testing.assert_allclose(table["high_capacitance_pF"] - table["capacitance_pF"], 1.959964 * 1.5, rtol=1e-3)
    plant, commands = load_plant("more.toml").plant, read_commands("first.csv")
    rows = plant.simulate(Experiment(recordings=(commands,))).outputs[0]
    np.testing.assert_allclose(table["current_uA"], 1e6 * rows[1], atol=1e-5)
    np.testing.assert_allclose(table["capacitance_pF"], 1e12 * rows[2], atol=1e-2)


def test_an_effect_is_added(on_bench, capsys):
    assert main(["simulate", "rig.toml", "first.csv", "--effect", "electrode_rc", "--out", "rc.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["effects"] == ["electrode_rc"]
    assert read_recordings("rc.csv", input_column="low_mm")[0].n_samples == 200


@pytest.mark.parametrize("method", ["svb", "frols", "lasso", "semp", "grow"])
def test_identify(on_bench, capsys, method):
    assert main(["identify", "pulls.csv", *COLUMNS, "--method", method, "--out", "narx.json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["terms"]
    assert 0 < found["unseen"][0]["one_step"] < 0.1
    assert found["complete"] and found["unseen"][0]["validation"]


def test_an_identification_that_fails_leaves_no_folder_for_its_report(at_desk):
    clock, command = 0.02 * np.arange(12), np.linspace(1.0, 2.0, 12)
    write_csv(Path("short.csv"), {"time_s": clock, "command_V": command, "displacement_mm": np.zeros(12)})
    assert main(["identify", "short.csv", "--out", "found.json", "--report", "new/report", "--quiet"]) == 1
    assert [path.name for path in at_desk.iterdir()] == ["short.csv"]
