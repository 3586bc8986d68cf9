"""The rig file to be filled in: what it lacks is told, and filled in it is read."""

import re
from pathlib import Path

import pytest

from deatwin.plant import RigError, load_plant, read_rig
from deatwin.plant.rigs.rigkeys import RIG_KEYS
from deatwin.plant.rigs.rigtemplate import rig_template

KNOWN = {"sample_rate_Hz": (100.0, "as recorded"), "noise_um": (1.25, "at most")}


def test_every_key_that_is_missing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_template(KNOWN), encoding="utf-8")
    with pytest.raises(RigError) as told:
        read_rig(path)
    needed = {name for keys in RIG_KEYS.values() for name, key in keys.items() if key.required}
    assert set(re.findall(r'the key "(\w+)" is missing', str(told.value))) == needed - {"zero", *KNOWN}


def test_filled_in_it_is_a_plant(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(re.sub(r"^#(?=\w)", "", rig_template(KNOWN), flags=re.MULTILINE), encoding="utf-8")
    rig = read_rig(path)
    assert (rig.sensor.sample_rate, rig.sensor.noise) == (100.0, 1.25e-6)
    assert (rig.film.material, rig.film.thickness, rig.film.ball) == ("VHB 4905", 0.5e-3, "sliding")
    assert load_plant(rig).plant.rig.kind == "diaphragm"


def test_each_key_has_its_meaning_above_it() -> None:
    lines = rig_template({}).splitlines()
    for keys in RIG_KEYS.values():
        for name, key in keys.items():
            at = next(k for k, line in enumerate(lines) if re.match(rf"#?{name} = ", line))
            assert lines[at - 1].startswith(f"# {name}: {key.about}")
            assert ("may be left out" in lines[at - 1]) == (not key.required)
