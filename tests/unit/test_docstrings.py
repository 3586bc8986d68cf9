"""Every public function, class and method says what each of its arguments is."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from enum import Enum

import pytest

PACKAGES = ("deatwin.plant", "deatwin.ident", "deatwin.control", "deatwin.studies", "deatwin.app", "deatwin.scenarios")
PAGES = ("deatwin.app.live.page",)  # written in the words of a framework that is an extra
SAID_BY_TYPER = "deatwin.app.commands"  # the command line documents its arguments by their help texts


def modules() -> Iterator[str]:
    for package in PACKAGES:
        yield package
        for info in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
            yield info.name


def public(name: str) -> Iterator[tuple[str, object]]:
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if name not in PAGES:
            raise
        pytest.skip(f"{error.name} of an optional extra is absent")
    for attribute in getattr(module, "__all__", ()):
        thing = getattr(module, attribute)
        if getattr(thing, "__module__", None) == name and (inspect.isfunction(thing) or inspect.isclass(thing)):
            yield f"{name}.{attribute}", thing


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


@pytest.mark.parametrize("name", sorted(set(modules())))
def test_every_argument_is_documented(name: str) -> None:
    if name.startswith(SAID_BY_TYPER):
        pytest.skip("its arguments carry help texts")
    faults: list[str] = []
    for where, thing in public(name):
        faults += faults_of_class(where, thing) if inspect.isclass(thing) else missing(where, thing, thing.__doc__)
    assert not faults, "\n".join(faults)
