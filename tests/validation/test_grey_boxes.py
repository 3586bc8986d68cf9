"""The documented physics of public benchmarks, calibrated: errors on the official test parts, beside published ones."""

import os
from pathlib import Path

import pytest

from deatwin.scenarios.real_physics import grey_boxes
from deatwin.studies.folder import ResultFolder
from deatwin.studies.stories import Setting

DATA = Path(os.environ.get("DEATWIN_DATA") or Path(__file__).parents[2].parent / "shared" / "data")

pytestmark = [
    pytest.mark.study,
    pytest.mark.skipif(
        not (DATA / "emps").is_dir(),
        reason="the public recordings are absent: DEATWIN_DATA names the folder that holds them",
    ),
]


def test_free_runs_over_the_test_parts(tmp_path: Path) -> None:
    setting = Setting(
        folder=ResultFolder(tmp_path), data=DATA, command=["test"], jobs=2, seed=0, progress=lambda done, text: None
    )
    errors = grey_boxes.run(setting)["errors"]
    # The best published black boxes leave 0.306 V and 18.7 µm, the published physics of four parameters about 5.4 mm.
    assert errors["Cascaded tanks"] < 0.306
    assert errors["EMPS, four parameters"] == pytest.approx(5.4, rel=0.05)
    assert errors["Bouc-Wen, multisine"] < 1.0
    assert (tmp_path / "report.html").is_file()
