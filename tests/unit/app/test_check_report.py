"""How the report of a check writes numbers, limits and units."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from deatwin.app.check_report.page import groups
from deatwin.app.check_report.view import View
from deatwin.control import Finding, Limit, Specification, Verdict


def test_numbers_that_are_far_off_are_told_so_in_the_table_and_limits_are_told_as_they_are() -> None:
    findings = [
        Finding(subject=subject, value=value, verdict=Verdict.FAIL, text="far off")
        for subject, value in (
            ("overshoot", 7.3e11),
            ("ripple", 0.4),
            ("tracking", 101.0),
            ("limit cycle", 10.1),
            ("unstable limit cycle", 0.9),
            ("plant", None),
            ("steady-state error", np.inf),
        )
    ]
    wanted = Specification(overshoot=Limit(good=20.0, poor=50.0, unit="%"), reserve=0.0)
    check: Any = SimpleNamespace(findings=findings, table=())
    model: Any = None
    view = View(check=check, model=model, plants={}, specification=wanted)
    rows = {row.subject: row for group in groups(view) for row in group.rows}
    assert [rows[finding.subject].value for finding in findings] == [
        "more than 1000 %",
        "40 %",
        "more than 100 times",
        "more than 1000 %",
        "90 %",
        "–",
        "∞",
    ]
    assert (rows["overshoot"].good, rows["overshoot"].poor) == ("≤ 2e+03 %", "≤ 5e+03 %")
    assert (rows["limit cycle"].good, rows["limit cycle"].poor) == ("≤ 5 %", "≤ 30 %")
    assert (rows["unstable limit cycle"].good, rows["unstable limit cycle"].poor) == ("≥ 200 %", "≥ 100 %")
    assert (rows["tracking"].good, rows["tracking"].poor) == ("≤ 1.50 times", "≤ 3.00 times")


def test_displacements_are_in_micrometres() -> None:
    operating = SimpleNamespace(output_unit="m", input_unit="V")
    model: Any = SimpleNamespace(output_names=("displacement",), input_names=("command",))
    check: Any = SimpleNamespace(operating=operating)
    view = View(check=check, model=model, plants={}, specification=Specification())
    assert (view.reading, view.command, view.unit, view.size) == ("displacement (µm)", "command (V)", "um", 1e-6)
