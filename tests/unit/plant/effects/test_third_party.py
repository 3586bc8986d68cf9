"""An effect of somebody else: its package is built, installed and found, and a diagnosis names it among others."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from deatwin.plant import Creep, Parameter
from deatwin.plant.effects import catalogue
from deatwin.plant.errors import RigError
from deatwin.plant.integrator.compiled import compiler

DOCS = Path(__file__).parents[4] / "docs/how-to"
# The page builds with hatchling; this is the least that pip needs, so that nothing is fetched.
PROJECT = """
[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]
"""
BACKEND = """
import zipfile

def build_wheel(folder, config_settings=None, metadata_directory=None):
    name, about = "weak_coil-0.1.0-py3-none-any.whl", "weak_coil-0.1.0.dist-info"
    with zipfile.ZipFile(f"{folder}/{name}", "w") as wheel:
        wheel.write("weak_coil.py")
        wheel.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\\nName: weak-coil\\nVersion: 0.1.0\\n")
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n")
        wheel.writestr(f"{about}/entry_points.txt", "[deatwin.effects]\\nweak_coil = weak_coil:WeakCoil\\nlost = absent:Lost\\n")
        wheel.writestr(f"{about}/RECORD", "")
    return name
"""
DIAGNOSED = """
import json
import numpy as np
from scipy.integrate import solve_ivp
from deatwin.ident.mismatch import diagnose
from deatwin.plant import CalibratedPlant, Experiment, Recording
from shaker import plant

rng, state, readings = np.random.default_rng(3), [0.0, 0.0], []
commands = np.repeat(rng.uniform(-2.0, 2.0, 30), 10)
for u in commands:
    rates = lambda t, x: [x[1], ((1 - 1e4 * x[0] ** 2) * u - 1050.0 * x[0] - 5.0 * x[1]) / 0.25]
    state = solve_ivp(rates, (0.0, 0.005), state, method="LSODA", rtol=1e-9, atol=1e-12).y[:, -1]
    readings.append(state[0])
noisy = np.array(readings) + 2e-6 * rng.standard_normal(commands.size)
others = "coulomb_friction", "cubic_stiffness", "delay"
offered = [effect for effect in plant().rig.effects() if effect.name in ("weak_coil", *others)]
found = diagnose(plant(), Experiment(recordings=(Recording.from_arrays(commands, noisy, 0.005),)), effects=offered)
loss = {cause.effect: cause.parameters["loss"].value for cause in found.causes}
print(json.dumps([found.verdict.value, found.sentence, loss]))
"""


def page(name: str, title: str) -> str:
    text = (DOCS / name).read_text(encoding="utf-8")
    code = re.search(rf'^```python title="{title}"\n(.*?)^```', text, re.S | re.M)
    assert code is not None
    return code[1]


def installed(folder: Path) -> tuple[Path, dict[str, str]]:
    """A working folder, and the environment in which the package of docs/how-to/own-effect.md is installed."""
    made = folder / "package"
    made.mkdir()
    name = '\n[project]\nname = "weak-coil"\nversion = "0.1.0"\n'
    (made / "pyproject.toml").write_text(PROJECT + name)
    (made / "backend.py").write_text(BACKEND)
    (made / "weak_coil.py").write_text(page("own-effect.md", "weak_coil.py"))
    (folder / "shaker.py").write_text(page("own-plant.md", "shaker.py"))
    target = folder / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--target", str(target)]
    subprocess.run([*pip, str(made)], check=True, capture_output=True)
    paths = [str(target), *sys.path]
    return folder, {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)}


@pytest.mark.skipif(compiler() is None, reason="many simulations: without a C compiler they take long")
def test_a_diagnosis_names_it_among_others_and_the_command_line_knows_it(tmp_path: Path) -> None:
    folder, environment = installed(tmp_path)
    rows = "".join(f"{0.005 * k:.3f},{k % 3 - 1}\n" for k in range(40))
    (folder / "input.csv").write_text("time_s,command_V\n" + rows)
    call = ["simulate", "shaker:plant", "input.csv", "--effect", "weak_coil", "--quiet", "--out", "out.csv"]
    code = f"{DIAGNOSED}\nfrom deatwin.app.cli import main\nraise SystemExit(main({call}))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    verdict, sentence, loss = json.loads(done.stdout)
    assert verdict == "named" and "the coil loses " in sentence
    # The interval is some 0.6 % wide to either side.
    assert loss == {"weak_coil": pytest.approx(1e4, rel=0.02)}
    assert "the effect lost (absent:Lost) is left out: ModuleNotFoundError" in done.stderr
    assert (folder / "out.csv").read_text().startswith("time_s,position_")


class Point:
    """An entry point of somebody else."""

    def __init__(self, name: str, kind: object) -> None:
        self.name, self.value, self._kind = name, f"theirs:{name}", kind

    def load(self) -> object:
        return self._kind


class Odd(Creep):
    wording = "Creeps by {amount}"


class Silent(Creep):
    name = "silent"

    def describe(self) -> tuple[Parameter, ...]:
        return ()


class Heavy(Creep):
    name = "heavy"
    strength = "weight"


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        (dict, "odd", "it is not a subclass of deatwin.plant.Effect"),
        (Creep, "crawl", "the class calls itself 'creep'; entry point and class need the same name"),
        (Odd, "creep", "its wording 'Creeps by {amount}' has a placeholder that is no parameter: 'amount'"),
        (Silent, "silent", "it describes nothing; it must describe each of its fields and its strength"),
        (Heavy, "heavy", "it must describe each of its fields and its strength"),
    ],
)
def test_an_effect_that_no_diagnosis_could_use_is_left_out(
    monkeypatch: pytest.MonkeyPatch, kind: type, name: str, said: str
) -> None:
    module = sys.modules["deatwin.plant.effects.catalogue"]
    monkeypatch.setattr(module, "entry_points", lambda group: [Point(name, kind)])
    module._types.cache_clear()
    try:
        with pytest.warns(UserWarning, match=f"the effect {name} .* is left out: .*{said}"):
            assert catalogue() == ()
        with pytest.raises(RigError, match="there is no effect"):
            module.effect_named(name)
    finally:
        module._types.cache_clear()
