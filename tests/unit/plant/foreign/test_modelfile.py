"""A file that names a Python function; tests/unit/plant/foreign/test_fmu.py has those that name an FMU."""

from pathlib import Path

import numpy as np
import pytest
from foreign_models import PARAMETERS, commands, experiment, motor

from deatwin.plant import ReadingTime, RigError, load_plant

FILE = """
[model]
function = "foreign_models:motor"
[input]
name = "voltage"
unit = "V"
size = 3.0
rest = 0.5
[output]
name = "speed"
unit = "rad/s"
size = 50.0
noise = 0.05
[time]
sample_rate_Hz = 100
period_s = 0.1
reading = "start of hold"
[channels]
temperature = 20.0
"""
PARAMETER = '[parameters.{name}]\nvalue = {value}\nlower = {lower}\nupper = {upper}\nunit = "{unit}"\n'
TABLES = "".join(
    PARAMETER.format(**{k: getattr(p, k) for k in ("name", "value", "lower", "upper", "unit")}) for p in PARAMETERS
)


def test_a_function_is_read_with_what_is_known_of_it(tmp_path: Path) -> None:
    (tmp_path / "motor.toml").write_text(FILE + TABLES)
    plant = load_plant(tmp_path / "motor.toml").plant
    rig = plant.rig
    assert (rig.reading, rig.start.rest_command, rig.noise) == (ReadingTime.START_OF_HOLD, 0.5, 0.05)
    assert plant.parameters["drag"].unit == "N m s"
    found = plant.simulate(experiment(commands())).outputs[0][0]
    values = {p.name: p.value for p in PARAMETERS}
    np.testing.assert_allclose(found, motor(values, {"voltage": commands()}, 0.01 * np.arange(400)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("foreign_models:motor", "foreign_models:moter", "foreign_models has no 'moter'; did you mean \"motor\"?"),
        ("foreign_models:motor", "no_such_module:motor", "cannot be imported: No module named 'no_such_module'"),
        ("foreign_models:motor", "foreign_models:SAMPLE", "a foreign model must be callable; a float is not"),
        ('function = "foreign_models:motor"', "", "[model] needs either file, an FMU, or function"),
        ('unit = "V"', "", "[input] unit is missing: give text in quotes"),
        ("[output]", "[output.more]", "[output] more is no key of a model file"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text((FILE + TABLES).replace(old, new, 1))
    with pytest.raises(RigError) as caught:
        load_plant(path)
    assert str(caught.value).startswith(str(path)) and said in str(caught.value)
