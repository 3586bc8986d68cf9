"""A rig that is simulated in a moment, and recordings of it on the disk."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from rig_files import RIG
from strips import MODULE, pulled, strip, write

from deatwin.plant import Coupon, Creep
from deatwin.plant.files import write_csv

ROOT = Path(__file__).parents[3]
SCHEMAS = {
    "diagnosis": "ident/deatwin/ident/schemas/diagnosis.schema.json",
    "plant": "plant/deatwin/plant/schemas/plant.schema.json",
    "run": "scenarios/deatwin/studies/schemas/run.schema.json",
    "check": "control/deatwin/control/schemas/check.schema.json",
}


@pytest.fixture(scope="session")
def validate():
    """Checks a file against its JSON Schema, and returns its content."""

    def check(kind: str, path: Path) -> dict[str, Any]:
        schema = json.loads((ROOT / SCHEMAS[kind]).read_text(encoding="utf-8"))
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.validate(data, schema)
        return data

    return check


@pytest.fixture(scope="session")
def bench(tmp_path_factory):
    """A folder with a plant in a module, its recordings, a rig file and commands for it."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "strip_of_mine.py").write_text(MODULE, encoding="utf-8")
    (folder / "rig.toml").write_text(RIG, encoding="utf-8")
    soft = RIG.replace("prestretch = 3.5", "prestretch = 2.0")  # pulls in at a few kilovolts
    (folder / "soft.toml").write_text(soft, encoding="utf-8")
    creeping = strip().with_effects(Creep(modulus=60e3, time=25.0))
    for name, seed in (("pulls.csv", 1), ("again.csv", 2)):
        write(folder / name, pulled(creeping, seed, 13))
    time = np.arange(200) * 0.02
    command = (2.4 + 0.8 * np.sin(2 * np.pi * 0.5 * time)).round(5)
    write_csv(folder / "first.csv", {"time_s": time.round(6), "command_V": command})
    write_csv(folder / "second.csv", {"time_s": (time + 6).round(6), "command_V": command})
    write_csv(folder / "high.csv", {"time_s": time.round(6), "command_V": np.linspace(2, 14, 200)})
    return folder


@pytest.fixture
def on_bench(bench, monkeypatch):
    """The same, as the working folder."""
    monkeypatch.chdir(bench)
    yield bench


FEW = {"creep", "mullins", "prestretch_relaxation", "strain_stiffening"}
"""What is told apart here in little time; the whole catalogue is for tests/unit/app/test_documented_commands.py."""


@pytest.fixture(scope="module")
def few_effects():
    """The strip of the bench is offered few effects."""
    offered = Coupon.effects
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Coupon, "effects", lambda rig: tuple(effect for effect in offered(rig) if effect.name in FEW))
        yield


@pytest.fixture
def root(tmp_path):
    """A folder with a rig and a recording, and a secret beside it."""
    root = tmp_path / "lab"
    root.mkdir()
    (root / "rig.toml").write_text("", encoding="utf-8")
    for path in (root / "noise.csv", tmp_path / "secret.csv"):
        path.write_text("time_s,command_V,displacement_mm\n0.00,2.0,0.3\n", encoding="utf-8")
    return root


@pytest.fixture
def at_desk(tmp_path, monkeypatch):
    """An empty folder, as the working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
