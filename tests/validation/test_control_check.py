"""What the inverse buys on the nominal rig, and the whole story, with few trials."""

import json
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from deatwin.plant import Diaphragm, Plant
from deatwin.scenarios import control_check
from deatwin.scenarios.control_check import study
from deatwin.scenarios.control_check.concealed import EFFECTS
from deatwin.scenarios.control_check.tracking import track

OTHER_SEEDS = [pytest.param(seed, marks=pytest.mark.study) for seed in (1, 2, 3, 4, 5, 6)]


@pytest.mark.parametrize("seed", [0, *OTHER_SEEDS])
def test_the_inverse_tracks_five_times_better_at_equal_margins_and_within_twice_the_oracle(seed):
    tracking = track("nominal rig", Plant(rig=Diaphragm()), np.random.default_rng(seed))
    alone = tracking.tracked["PI"]
    for name in ("inverse", "inverse with dynamics"):
        assert tracking.ratio("PI", name) > 5.0
        assert tracking.ratio(name, f"oracle: {name}") < 2.0
        for margin in ("gain", "phase_deg", "delay"):
            mine, its = (float(getattr(one.margins, margin)[0]) for one in (tracking.tracked[name], alone))
            assert mine == pytest.approx(its, rel=1e-6)  # one loop, whose margins are computed twice
    # 0.1 to 0.8 Hz, from beyond the start to the end, and none at its limits.
    assert all(one.run.status.ok and one.run.saturated_share == 0.0 for one in tracking.tracked.values())


@pytest.mark.study
def test_the_story_with_few_trials(setting, tmp_path, monkeypatch):
    monkeypatch.setattr(study, "SIZES", {"short": 2})
    monkeypatch.setattr(study, "EFFECTS", MappingProxyType({"electrode_rc": EFFECTS["electrode_rc"]}))
    told: list[float] = []
    result = control_check.run(replace(setting, progress=lambda share, text: told.append(share)))
    # All but the rates, which two trials do not give.
    assert [row["passed"] for row in result["measures"]][:5] == [True] * 5
    assert [path.name for path in sorted((tmp_path / "trials").rglob("*.nc"))] == ["000.nc", "001.nc"]
    assert told == sorted(told) and told[-1] == 1.0
    written = json.loads((tmp_path / "run.json").read_text())["outputs"]
    assert all((tmp_path / name).exists() for name in written)
    assert {"trials", "control-check.json", "report.html", "figures/tracking.csv"} <= set(written)
