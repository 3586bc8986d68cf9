"""Designs by name."""

from dataclasses import replace

import pytest
from made_narx import trained_on

from deatwin.app.commands.check import DesignName
from deatwin.control import LinearController, MissingPackageError, linearise
from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.inverse import InverseController
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.design.named import DESIGNS, Wanted, design_named
from deatwin.ident.narx import NarxModel
from deatwin.plant import Coupon

KINDS: dict[str, tuple[type[Controller], str]] = {
    "pi": (LinearController, "I"),
    "pid": (LinearController, "PID"),
    "inverse": (InverseController, "inverse"),
    "lqg": (LinearController, "LQG"),
    "hinf": (LinearController, "H-infinity"),
    "shaped": (LinearController, "I"),
    "scheduled": (ScheduledController, "scheduled"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.extras if name == "hinf" else ()) for name in DESIGNS]
)
def test_each_design_is_what_its_name_says(name: str) -> None:
    """On y = 1.5 y(k-1) - 0.55 y(k-2) + 0.04 u + 0.01 u^2: lags of 0.67 and 0.22 s, and a gain of 1 at 0.5."""
    terms = {"y(k-1)": 1.5, "y(k-2)": -0.55, "u(k)": 0.04, "u(k)^2": 0.01}
    trained = trained_on((0.2, 1.0), (0.0, 1.0))
    model = replace(NarxModel.from_terms(terms, sample_time=0.1), operating=trained)
    reading = Coupon().reading
    linear = linearise(model, 0.5).in_loop(reading)
    assert linear.static_gain == pytest.approx(1.0)
    seconds = 3.0 if name == "hinf" else 1.5  # the former has stricter bounds than a PI's, and reaches less
    wanted = Wanted(model=model, reading=reading, closed_loop_time=seconds, band_Hz=1.0, operating_range=None)
    kind, said = KINDS[name]
    try:
        found = design_named(name, wanted)(linear, command_limits=(0.0, 1.2))
    except MissingPackageError:
        assert name == "hinf"
        return
    assert isinstance(found, kind) and said in found.name
    assert found.sample_time == 0.1 and found.operating_input == 0.5
    assert found.closed_loop_time == pytest.approx(seconds)
    # Integral action: at rest, reading and reference apart by one, the command keeps rising.
    state = found.start()
    commands = []
    for _ in range(8):
        command, state = found.command(found.operating_output + 1e-3, found.operating_output, state)
        commands.append(float(command))
    assert commands[-1] > commands[-2] > 0.5


def test_the_command_line_knows_every_design() -> None:
    assert [name.value for name in DesignName] == list(DESIGNS)
