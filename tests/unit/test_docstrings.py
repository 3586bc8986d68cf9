"""Every public function, class and method says what each of its arguments is.

Public is what a package's ``__init__`` re-exports; the reference shows just that (tests/unit/test_documents.py).
"""

import importlib
import inspect
import re
from enum import Enum

import pytest
from public import PUBLIC


def arguments(function: object) -> list[str]:
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    found = [p for p in inspect.signature(function).parameters.values() if p.kind not in kinds]
    return [p.name for p in found if p.name not in ("self", "cls") and not p.name.startswith("_")]


def missing(where: str, function: object, text: str | None) -> list[str]:
    if not text:
        return [f"{where}: no docstring"]
    return [f"{where}: {name}" for name in arguments(function) if not re.search(rf"\b{name}\b", text)]


def faults_of_class(where: str, kind: type) -> list[str]:
    if issubclass(kind, Enum | Exception):
        return [] if kind.__doc__ else [f"{where}: no docstring"]
    faults = missing(where, kind, kind.__doc__)
    for name, member in vars(kind).items():
        if name.startswith("_") or isinstance(member, property):
            continue
        member = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        if inspect.isfunction(member):
            faults += missing(f"{where}.{name}", member, inspect.getdoc(getattr(kind, name)))
    return faults


@pytest.mark.parametrize("package", PUBLIC)
def test_every_argument_is_documented(package: str) -> None:
    faults: list[str] = []
    module = importlib.import_module(package)
    for name in module.__all__:
        thing = getattr(module, name)
        if inspect.isclass(thing):
            faults += faults_of_class(f"{package}.{name}", thing)
        elif inspect.isfunction(thing):
            faults += missing(f"{package}.{name}", thing, thing.__doc__)
    assert not faults, "\n".join(faults)
