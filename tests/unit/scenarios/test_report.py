"""The page of verdicts without an amendment and without evidence."""

from dataclasses import replace
from pathlib import Path

import pytest

from deatwin.ident.mismatch import Diagnosis, Verdict
from deatwin.scenarios.folder import ResultFolder
from deatwin.scenarios.report import Origin, write_report
from deatwin.scenarios.report.quantities import with_interval

DIAGNOSIS = Diagnosis(
    output={"name": "displacement", "unit": "um"},
    verdict=Verdict.UNKNOWN,
    noise=2.0,
    model_error=1.2,
    detect={"p_value": 0.0, "excess": 4.0, "smallest_detectable": {}},
    locate={"time": [], "frequency": [], "region": [], "place": []},
    sentence="Something is <missing>.",
    fit={"fitted": {"before": 5.0, "after": None}, "unseen": {"before": 6.0, "after": None, "gain_low": None}},
    warnings=("stretch_limit ended on a bound of its range",),
)


@pytest.mark.parametrize("verdict", [v for v in Verdict if v not in (Verdict.NAMED, Verdict.AMBIGUOUS)])
def test_every_verdict_has_a_page(tmp_path: Path, verdict: Verdict) -> None:
    folder = ResultFolder(tmp_path / "new")
    write_report(folder, replace(DIAGNOSIS, verdict=verdict), Origin(inputs=[], seed=3))
    page = (folder.path / "report.html").read_text(encoding="utf-8")
    assert folder.written == ["report.html"]
    assert "<h1>Something is &lt;missing&gt;.</h1>" in page
    assert verdict.value.replace("_", " ") in page
    assert "stretch_limit ended on a bound" in page
    assert "6.00" in page


def test_an_interval_has_the_prefix_of_its_value() -> None:
    assert with_interval(950.0, 900.0, 1100.0, "Pa") == ("950 Pa", "900 to 1100 Pa")
    assert with_interval(26.1e3, 24.5e3, 27.7e3, "Pa") == ("26.1 kPa", "24.5 to 27.7 kPa")
    assert with_interval(-0.1, -0.12, -0.08, "1") == ("-0.1", "-0.12 to -0.08")
