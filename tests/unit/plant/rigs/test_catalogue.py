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
        self.name, self.value, self.load = name, f"theirs:{name}", load


def broken():
    raise ImportError("a package of somebody else that does not go with this version")


def test_a_broken_rig_of_others_hinders_nobody(monkeypatch):
    points = [Point("diaphragm", lambda: Diaphragm), Point("theirs", broken), Point("no_rig", lambda: dict)]
    monkeypatch.setattr(
        catalogue, "entry_points", lambda group, name=None: [p for p in points if name in (None, p.name)]
    )
    for cached in (catalogue._point_named, catalogue._kinds):
        cached.cache_clear()
    try:
        assert rig_kind("diaphragm") is Diaphragm
        with pytest.raises(
            RigError, match=r"the rig theirs \(theirs:theirs\) cannot be used: ImportError: .* somebody else"
        ):
            rig_kind("theirs")
        with pytest.raises(RigError, match=r"the rig no_rig .* not a subclass of deatwin\.plant\.Rig"):
            rig_kind("no_rig")
        with (
            pytest.warns(UserWarning, match="the rig (theirs|no_rig) .* cannot be used: .*; it is left out"),
            pytest.raises(
                RigError, match=r"there is no rig 'diafragm'; did you mean \"diaphragm\"\? \(known: diaphragm;"
            ),
        ):
            rig_kind("diafragm")
    finally:
        for cached in (catalogue._point_named, catalogue._kinds):
            cached.cache_clear()


def test_an_unknown_rig_is_told_with_the_nearest_name():
    with pytest.raises(RigError, match=r"there is no rig 'diafragm'.*diaphragm"):
        rig_kind("diafragm")


def test_a_rig_is_loaded_without_the_stories():
    program = (
        "import sys; from deatwin.plant.rigs.catalogue import rig_kind; rig_kind('diaphragm');"
        "sys.exit(any(name.startswith('deatwin.scenarios') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
