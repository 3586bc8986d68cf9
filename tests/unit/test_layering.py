"""Who may import whom: plant <- ident <- control <- studies <- app and stories; what is imported for types counts."""

import ast

import pytest
from size import Module, product

ORDER = ("plant", "ident", "control", "studies", "app")


@pytest.fixture(scope="module")
def modules() -> dict[str, Module]:
    return product()


def room(module: str) -> str:
    return module.split(".")[1]


def story(module: str) -> str:
    return module.split(".")[2]


def imports(module: Module) -> set[str]:
    """Names of deatwin that a module imports, inside of functions and for type checkers, too."""
    return {f"{source}.{there}" for source, there, _ in module.imports() if source.startswith("deatwin.")}


def test_no_package_imports_what_stands_above_it(modules: dict[str, Module]) -> None:
    wrong = [
        f"{name} imports {one}"
        for name, module in modules.items()
        if room(name) in ORDER
        for one in imports(module)
        if room(one) not in ORDER[: ORDER.index(room(name)) + 1]
    ]
    assert len(modules) > 100 and wrong == []


def test_no_story_imports_another_or_the_application(modules: dict[str, Module]) -> None:
    wrong = [
        f"{name} imports {one}"
        for name, module in modules.items()
        if room(name) == "scenarios" and name != "deatwin.scenarios"
        for one in imports(module)
        if room(one) == "app" or (room(one) == "scenarios" and story(one) != story(name))
    ]
    assert wrong == []


def test_narx_and_grey_boxes_do_not_know_each_other(modules: dict[str, Module]) -> None:
    wrong = [
        f"{name} imports {one}"
        for own, other in (("narx", "greybox"), ("greybox", "narx"))
        for name, module in modules.items()
        if name.startswith(f"deatwin.ident.{own}")
        for one in imports(module)
        if one.startswith(f"deatwin.ident.{other}")
    ]
    assert wrong == []


def test_imports_are_absolute(modules: dict[str, Module]) -> None:
    trees = ((name, node) for name, module in modules.items() for node in ast.walk(module.tree))
    assert [name for name, node in trees if isinstance(node, ast.ImportFrom) and node.level] == []
