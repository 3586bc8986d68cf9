"""What `deatwin identify` says of periodic recordings."""

import numpy as np
import pytest

from deatwin.app.cli import main
from deatwin.plant.excitation import random_odd_harmonics, random_phase_multisine


@pytest.mark.parametrize(("power", "said"), [(3, True), (2, False)])
def test_an_odd_distortion_asks_for_an_odd_degree(power, said, tmp_path, capsys):
    rng = np.random.default_rng(1)
    harmonics, _ = random_odd_harmonics(rng, 5.12, 20.0)
    u = random_phase_multisine(rng, 5.12, 0.01, harmonics, 1.0, periods=4, lower=-2.0, upper=7.0)
    y = (u - 2.4) + 0.1 * (u - 2.4) ** power + 0.01 * rng.normal(size=u.size)
    table = np.column_stack([0.01 * np.arange(u.size), u, y])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="time_s,command_V,displacement_mm", comments="")
    options = ["--method", "frols", "--output-lags", "1", "--input-lags", "2", "--max-terms", "4"]
    out = tmp_path / "found"
    report = ["--report", str(out)] if said else []
    assert main(["identify", str(tmp_path / "a.csv"), *options, "--out", str(tmp_path / "m.json"), *report]) == 0
    assert ("allow terms of the third degree (--degree 3)" in capsys.readouterr().out) is said
    assert main(["look", str(tmp_path / "a.csv")]) == 0
    assert ("--degree 3" in capsys.readouterr().out) is said
    if said:
        page = (out / "report.html").read_text(encoding="utf-8")
        assert "Best linear approximation, estimated without a model" in page
