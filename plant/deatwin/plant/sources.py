"""Plants from where users keep them: a rig file, a ``model.json``, or a function of their own."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import RigError
from deatwin.plant.model import Plant
from deatwin.plant.rigs.diaphragm import Diaphragm
from deatwin.plant.rigs.rigfile import read_rig

__all__ = ["load_plant"]


def load_plant(source: str | os.PathLike[str]) -> CalibratedPlant:
    """The plant that a command line names.

    Parameters
    ----------
    source : str or path
        A rig file (``.toml``), a ``model.json``, or ``module:function`` whose function returns a Plant; modules
        are also looked for in the working folder.

    Returns
    -------
    CalibratedPlant
        Nominal, unless the source is a calibrated model.

    Raises
    ------
    RigError, ModelError
        If the source does not give a plant.
    """
    text = os.fspath(source)
    if text.endswith(".json"):
        return CalibratedPlant.load(text)
    if ":" in text and not Path(text).exists():
        return CalibratedPlant.nominal(_call(text))
    return CalibratedPlant.nominal(Plant(rig=Diaphragm.from_rig_file(read_rig(text))))


def _call(text: str) -> Plant:
    module_name, _, function_name = text.rpartition(":")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # stays there: worker processes import the module too
    try:
        plant = getattr(importlib.import_module(module_name), function_name)()
    except (ImportError, AttributeError, ValueError) as error:
        raise RigError(f"{text}: cannot be imported: {error}; give module:function") from error
    except Exception as error:  # whatever a user's own code may raise
        raise RigError(f"{text}: raised {type(error).__name__}: {error}") from error
    if not isinstance(plant, Plant):
        raise RigError(f"{text}: returned a {type(plant).__name__}, a Plant is needed")
    return plant
