"""The gains of a controller in numbers with units."""

from __future__ import annotations

from deatwin.control import Check, PidGains
from deatwin.plant.amplitudes import written_amplitude


def written_gains(check: Check) -> list[tuple[str, str]]:
    """Return name and value of each gain of a PI or PID law at the operating input; empty for other laws."""
    controller = check.controller
    if controller is None:
        return []
    gains = PidGains.of_law(controller.local(controller.operating_input), controller.sample_time)
    if gains is None:
        return []
    output_unit, size = written_amplitude(check.operating.output_unit)
    below = "" if output_unit in ("", "1") else output_unit
    above = check.operating.input_unit if check.operating.input_unit not in ("", "1") else ""
    entries = [
        ("proportional gain", gains.proportional * size, _ratio(above, below)),
        ("integral gain", gains.integral * size, _ratio(above, f"{below} s".strip())),
    ]
    if gains.derivative:
        entries += [
            ("derivative gain", gains.derivative * size, _ratio(f"{above} s".strip(), below)),
            ("time constant of the derivative's filter", gains.filter_time, "s"),
        ]
    return [(name, f"{value:.4g} {unit}".rstrip()) for name, value, unit in entries]


def _ratio(above: str, below: str) -> str:
    """Return the quotient of two units; pure numbers have none."""
    if not below:
        return above
    return f"{above or '1'}/({below})" if " " in below else f"{above or '1'}/{below}"
