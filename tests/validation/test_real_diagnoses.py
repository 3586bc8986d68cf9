"""Whole diagnoses of recordings of others: the documented physics is found, and helps on held-out data.

Silverbox: Wigren & Schoukens 2013; EMPS: Janot, Gautier & Brunot 2019; cascaded tanks: Schoukens, Mattsson, Wigren &
Noël 2016; Bouc-Wen (simulated): Noël & Schoukens 2016; VHB 4910: github.com/Chongran-Zhao/VHB4910_data.
"""

import json
import os
from pathlib import Path

import pytest

from deatwin.scenarios.real_physics import bouc_wen, cascaded_tanks, emps, silverbox
from deatwin.studies.folder import ResultFolder
from deatwin.studies.stories import Setting

DATA = Path(os.environ.get("DEATWIN_DATA") or Path(__file__).parents[2].parent / "shared" / "data")

pytestmark = [
    pytest.mark.study,
    pytest.mark.skipif(
        not (DATA / "silverbox").is_dir(),
        reason="the public recordings are absent: DEATWIN_DATA names the folder that holds them",
    ),
]
# Documented values. Silverbox: none. EMPS: 20.4 N by the benchmark's own inverse model on the same record.
# Tanks: the level saturates at 10 V. Bouc-Wen: 1 / (beta gamma) = 1.25 mm, alpha / (beta gamma) = 62.5 N.
STORIES = {
    "silverbox": (silverbox, "cubic_stiffness", {}, 0.1),
    "emps": (emps, "coulomb_friction", {"force": 20.4}, 0.5),
    "cascaded_tanks": (cascaded_tanks, "overflow", {"brim": 10.0}, 0.7),
    "bouc_wen": (bouc_wen, "hysteresis", {"distance": 1.25e-3, "force": 62.5}, 0.05),
}


@pytest.mark.parametrize("name", STORIES)
def test_the_documented_physics_is_named(name: str, tmp_path: Path) -> None:
    module, effect, documented, share = STORIES[name]
    setting = Setting(
        folder=ResultFolder(tmp_path), data=DATA, command=["test"], jobs=2, seed=0, progress=lambda done, text: None
    )
    result = module.run(setting)
    assert result["verdict"] == "named"
    assert result["causes"] == [effect]
    first = next(iter(result["held_out"].values()))
    assert first["amended"] < share * first["base"]
    diagnosis = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    found = diagnosis["causes"][0]["parameters"]
    for parameter, value in documented.items():
        size = 1e-3 if found[parameter]["unit"] == "mm" else 1.0
        assert size * found[parameter]["value"] == pytest.approx(value, rel=0.1)
    assert (tmp_path / "report.html").is_file()
