"""The fleet identified: twelve models, as the thesis has them, and what their validation says.

What is demanded is stated in `deatwin.scenarios.fleet_models.page`. That all correlation tests pass is demanded and
not reached: the pages say why. That SVB runs free as well as SEMP, to 10 %, is reached with seed 0 (a median of 0.89
times its error) and missed with seed 1 (1.18): SVB looks one step ahead only. This test says that it is only that.
"""

import json
from dataclasses import replace

import pytest

from deatwin.app.stories import story
from deatwin.ident.narx import NarxModel


@pytest.mark.study
@pytest.mark.parametrize(("name", "method", "seed"), [("semp-fleet", "SEMP", 0), ("svb-fleet", "SVB", 1)])
def test_six_models_pass_all_but_correlation_tests(name, method, seed, setting, tmp_path):
    setting = replace(setting, jobs=2, seed=seed)
    result = story(name).run(setting)
    missed = [row["measure"] for row in result["measures"] if not row["passed"]]
    assert all("correlation tests" in measure or "over that of SEMP" in measure for measure in missed), missed
    recorded = [m for m in result["models"] if m["recording"] == "as recorded" and m["method"] == method]
    assert len(recorded) == 6
    # A model of constant parameters is good to what the actuator drifts within its sections and to its hysteresis.
    assert all(m["validation"]["free_run"]["nrmse"][0] < 0.3 for m in recorded)
    assert len(list((tmp_path / "models").glob("*.json"))) == 6
    sample_time = NarxModel.load(tmp_path / f"models/dea5_{method.lower()}.json").sample_time
    assert sample_time == pytest.approx(0.12, abs=0.05)
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["seed"] == seed
    assert (tmp_path / "report.html").is_file()
