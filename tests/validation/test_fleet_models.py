"""The fleet identified: twelve models, as the thesis has them, and what their validation says.

What is demanded is stated in `deatwin.scenarios.fleet_models.verdicts`. That all correlation tests pass is demanded and
not reached: the page says why, and this test says that it is only that.
"""

import json
from pathlib import Path

import pytest

from deatwin.ident.narx import NarxModel
from deatwin.scenarios.folder import ResultFolder
from deatwin.scenarios.stories import Setting, story


@pytest.mark.study
@pytest.mark.parametrize("seed", [0, 1])
def test_twelve_models_pass_all_but_correlation_tests(seed: int, tmp_path: Path) -> None:
    setting = Setting(
        folder=ResultFolder(tmp_path), data=None, command=["test"], jobs=2, seed=seed, progress=lambda share, text: None
    )
    result = story("fleet-models").run(setting)
    missed = [row["measure"] for row in result["measures"] if not row["passed"]]
    assert all("correlation tests" in measure for measure in missed), missed
    recorded = [m for m in result["models"] if m["recording"] == "as recorded" and m["method"] in ("SEMP", "SVB")]
    assert len(recorded) == 12
    # A model of constant parameters is good to what the actuator drifts within its sections and to its hysteresis.
    assert all(m["validation"]["free_run"]["nrmse"][0] < 0.3 for m in recorded)
    assert len(list((tmp_path / "models").glob("*.json"))) == 12
    assert NarxModel.load(tmp_path / "models/dea5_svb.json").sample_time == pytest.approx(0.12, abs=0.05)
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["seed"] == seed
    assert (tmp_path / "report.html").is_file()
