"""Measured coupons of VHB 4910 (github.com/Chongran-Zhao/VHB4910_data): the missing relaxation is found."""

import os
from pathlib import Path

import pytest

from deatwin.app.stories import story
from deatwin.studies.folder import ResultFolder
from deatwin.studies.stories import Setting

DATA = Path(os.environ.get("DEATWIN_DATA") or Path(__file__).parents[2].parent / "shared" / "data")

pytestmark = [
    pytest.mark.study,
    pytest.mark.skipif(
        not (DATA / "vhb4910" / "loading_unloading").is_dir(),
        reason="the recordings vhb4910 are absent: DEATWIN_DATA names the folder that holds them",
    ),
]


def test_a_hyperelastic_strip_lacks_a_relaxation(tmp_path: Path) -> None:
    setting = Setting(
        folder=ResultFolder(tmp_path), data=DATA, command=["test"], jobs=1, seed=0, progress=lambda share, text: None
    )
    result = story("vhb4910").run(setting)
    assert result["verdict"] == "named"
    assert result["causes"] == ["creep"]
    assert result["held_out_N"]["amended"] < 0.5 * result["held_out_N"]["base"]
    assert (tmp_path / "report.html").is_file()
