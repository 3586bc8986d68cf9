"""Packages that only some formats need, imported where they are used."""

import importlib
from typing import Any

from deatwin.plant.errors import DataError

__all__ = ["require"]


def require(package: str, purpose: str, *, install: str = '"deatwin[files]"') -> Any:
    """Import a package.

    Parameters
    ----------
    package : str
        Its import name.
    purpose : str
        What needs it, for the error text.
    install : str
        What pip is to install where it is missing.

    Returns
    -------
    module

    Raises
    ------
    DataError
        If it is not installed; the text says how to.

    Examples
    --------
    >>> require("json", "this example").loads("1")
    1
    >>> require("no_such_package", "rec.tdms")
    Traceback (most recent call last):
    ...
    deatwin.plant.errors.DataError: rec.tdms needs the package no_such_package; pip install "deatwin[files]"
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        raise DataError(f"{purpose} needs the package {error.name}; pip install {install}") from None
