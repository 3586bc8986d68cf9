"""Load plants from a rig file, a ``model.json``, or a user's function."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from deatwin.plant.arguments import instance, taking
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DeatwinError, RigError, nearest
from deatwin.plant.foreign.modelfile import ModelFile
from deatwin.plant.imported import RAISED, imported
from deatwin.plant.model import Plant
from deatwin.plant.rigs.bow_tie import BowTie
from deatwin.plant.rigs.cone import Cone
from deatwin.plant.rigs.coupon import Coupon
from deatwin.plant.rigs.diaphragm import Diaphragm
from deatwin.plant.rigs.disc import Disc
from deatwin.plant.rigs.film_actuator import FilmActuator
from deatwin.plant.rigs.planar import Planar
from deatwin.plant.rigs.pressure import Pressure
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.rigs.roll import Roll
from deatwin.plant.rigs.stack import Stack
from deatwin.plant.rigs.tomlfile import TomlFile

KINDS: Mapping[str, type[Diaphragm | FilmActuator | Coupon]] = MappingProxyType(
    {kind.kind: kind for kind in (Diaphragm, Disc, Planar, Stack, BowTie, Roll, Cone, Pressure, Coupon)}
)
"""Rigs that a rig file can describe, by their kind."""


@taking(source=instance(str, os.PathLike, RigFile, ModelFile, error=RigError))
def load_plant(source: str | os.PathLike[str] | RigFile | ModelFile) -> CalibratedPlant:
    """Load a plant from a rig file, a model file or a Python function.

    Parameters
    ----------
    source : str, path, RigFile or ModelFile
        One of these:

        - path of a rig file or of a model file (``.toml``), or the content of a rig file from `read_rig`;
        - path of an FMU (``.fmu``), beside which there is a model file of the same name;
        - path of a ``model.json``;
        - ``module:function``, the name of a function without arguments that returns a `Plant`. The module may be in the
          working folder.

    Returns
    -------
    CalibratedPlant
        Plant that the source describes. Its parameters have no uncertainty unless the source is a ``model.json`` with a
        calibrated plant.

    Raises
    ------
    RigError, ModelError
        If the source does not describe a plant.
    """
    if isinstance(source, RigFile | ModelFile):
        return _of_file(source)
    text = os.fspath(source)
    if text.endswith(".json"):
        return CalibratedPlant.load(text)
    if ":" in text and not Path(text).exists():
        return CalibratedPlant.nominal(_call(text))
    if not text.endswith(".toml") and not Path(text).is_file():
        beside = [entry.name for entry in Path().glob("*.*") if entry.suffix in (".toml", ".fmu", ".json")]
        raise RigError(
            f"{text}: no such rig; give a rig file (.toml), an FMU (.fmu), a model.json or module:function{nearest(text, beside, likeness=0.8)}"
        )
    return _of_file(read_described(text))


def read_described(source: str) -> RigFile | ModelFile:
    """Read the file that describes a plant: a rig file or a model file; for an FMU, the model file next to it."""
    if source.endswith(".fmu"):
        return ModelFile.beside(Path(source))
    file = TomlFile.read(source)
    return ModelFile.of(file) if "model" in file.data else RigFile.of(file)


def _of_file(described: RigFile | ModelFile) -> CalibratedPlant:
    if isinstance(described, ModelFile):
        return CalibratedPlant.nominal(described.read())
    try:
        kind = KINDS[described.kind]
        return CalibratedPlant.nominal(Plant(rig=kind.from_rig_file(described)))
    except DeatwinError as error:
        raise RigError(f"{described.source}: {error}") from error


def _call(text: str) -> Plant:
    try:
        plant = imported(text)()
    except RigError:
        raise
    except RAISED as error:
        raise RigError(f"{text}: raised {type(error).__name__}: {error}; it must return a Plant") from error
    if not isinstance(plant, Plant):
        raise RigError(f"{text}: returned {type(plant).__name__}; it must return a Plant")
    return plant
