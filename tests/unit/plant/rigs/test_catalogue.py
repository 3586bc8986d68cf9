"""Rigs by name, the project's own and those of others."""

import subprocess
import sys

import pytest

from deatwin.plant.errors import RigError
from deatwin.plant.rigs import catalogue
from deatwin.plant.rigs.catalogue import rig_kind
from deatwin.plant.rigs.diaphragm import Diaphragm


class Point:
    """An entry point of somebody else."""

    def __init__(self, name, load):
        self.name, self.load = name, load


def broken():
    raise ImportError("a package of somebody else that does not go with this version")


def test_a_broken_rig_of_others_hinders_nobody(monkeypatch):
    points = [Point("diaphragm", lambda: Diaphragm), Point("theirs", broken)]
    monkeypatch.setattr(
        catalogue, "entry_points", lambda group, name=None: [p for p in points if name in (None, p.name)]
    )
    catalogue._point_named.cache_clear()
    try:
        assert rig_kind("diaphragm") is Diaphragm
        with pytest.raises(ImportError, match="somebody else"):
            rig_kind("theirs")
    finally:
        catalogue._point_named.cache_clear()


def test_an_unknown_rig_is_told_with_the_nearest_name():
    with pytest.raises(RigError, match=r"there is no rig 'diafragm'.*diaphragm"):
        rig_kind("diafragm")


def test_a_rig_is_loaded_without_the_stories():
    program = (
        "import sys; from deatwin.plant.rigs.catalogue import rig_kind; rig_kind('diaphragm');"
        "sys.exit(any(name.startswith('deatwin.scenarios') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
