"""Import objects of a user's modules, named as ``module:name``."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from deatwin.plant.errors import RigError, nearest

RAISED = (Exception, SystemExit)  # Errors that a user's own code may raise; a script without a guard calls `sys.exit`


def imported(text: str) -> Any:
    """Return the object named ``module:name``; modules are also searched in the working folder."""
    module_name, _, name = text.rpartition(":")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # kept there, because worker processes import the module, too
    try:
        module = importlib.import_module(module_name)
    except (ImportError, ValueError) as error:  # ValueError: the name is empty
        raise RigError(f"{text}: cannot be imported: {error}; write the argument as module:function") from error
    except RAISED as error:
        raise RigError(f"{text}: {module_name} raised {type(error).__name__}: {error}") from error
    if not hasattr(module, name):
        raise RigError(
            f"{text}: {module_name} has no {name!r}{nearest(name, vars(module))} (the argument is module:function)"
        )
    return getattr(module, name)
