"""How the report of a check writes numbers, limits, units and gains."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from deatwin.app.check_report.page import groups, written_gains
from deatwin.app.check_report.view import View
from deatwin.control import Finding, Limit, Specification, Verdict
from deatwin.control.design.pid import PidGains


def test_numbers_that_are_far_off_are_told_so_in_the_table_and_limits_are_told_as_they_are():
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


def test_displacements_are_in_micrometres():
    operating = SimpleNamespace(output_unit="m", input_unit="V")
    model: Any = SimpleNamespace(output_names=("displacement",), input_names=("command",))
    check: Any = SimpleNamespace(operating=operating)
    view = View(check=check, model=model, plants={}, specification=Specification())
    assert (view.reading, view.command, view.unit, view.size) == ("displacement (µm)", "command (V)", "um", 1e-6)


H = 0.02


@pytest.mark.parametrize(
    ("input_unit", "output_unit", "gains", "expected"),
    [
        # 2e3 V/m is 2e-3 V/um
        ("V", "m", PidGains(proportional=2e3, integral=5e4), ["0.002 V/µm", "0.05 V/(µm s)"]),
        ("V", "1", PidGains(proportional=0.0, integral=3.0), ["0 V", "3 V/s"]),
        ("1", "N", PidGains(proportional=2.0, integral=3.0), ["2 1/N", "3 1/(N s)"]),
        (
            "V",
            "N",
            PidGains(proportional=2.0, integral=3.0, derivative=0.5, filter_time=0.1),
            ["2 V/N", "3 V/(N s)", "0.5 V s/N", "0.1 s"],
        ),
    ],
)
def test_each_gain_has_its_unit(input_unit, output_unit, gains, expected):
    law = gains.law(H)
    controller = SimpleNamespace(local=lambda _: law, operating_input=1.0, sample_time=H)
    check: Any = SimpleNamespace(
        controller=controller, operating=SimpleNamespace(input_unit=input_unit, output_unit=output_unit)
    )
    assert [text for _, text in written_gains(check)] == expected
