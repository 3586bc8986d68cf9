"""Gains in the units in which a person would type them into a controller."""

from types import SimpleNamespace
from typing import Any

import pytest

from deatwin.app.check_report.page import written_gains
from deatwin.control.design.pid import PidGains

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
def test_each_gain_has_its_unit(input_unit: str, output_unit: str, gains: PidGains, expected: list[str]) -> None:
    law = gains.law(H)
    controller = SimpleNamespace(local=lambda _: law, operating_input=1.0, sample_time=H)
    check: Any = SimpleNamespace(
        controller=controller, operating=SimpleNamespace(input_unit=input_unit, output_unit=output_unit)
    )
    assert [text for _, text in written_gains(check)] == expected
