"""Who may import whom: plant <- ident <- control <- studies <- app and stories; what is imported for types counts."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ORDER = ("plant", "ident", "control", "studies", "app")
ROOTS = {"plant": "plant", "ident": "ident", "control": "control", "studies": "scenarios", "app": "scenarios"}


def modules(folder: Path) -> Iterator[tuple[str, Path]]:
    """Dotted names and files of all modules of a package."""
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder.parents[1]).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def imports(path: Path) -> set[str]:
    """Modules of deatwin that a file imports, inside of functions and for type checkers, too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute here"
            found |= {f"{node.module}.{name.name}" for name in node.names}
    return {name for name in found if name.startswith("deatwin.")}


def room(module: str) -> str:
    return module.split(".")[1]


def story(module: str) -> str:
    return module.split(".")[2]


def test_no_package_imports_what_stands_above_it() -> None:
    wrong = []
    for place, package in enumerate(ORDER):
        for name, path in modules(ROOT / ROOTS[package] / "deatwin" / package):
            below = {*ORDER[: place + 1]}
            wrong += [f"{name} imports {one}" for one in imports(path) if room(one) not in below]
    assert wrong == []


def test_no_story_imports_another_or_the_application() -> None:
    wrong = []
    for name, path in modules(ROOT / "scenarios" / "deatwin" / "scenarios"):
        if name == "deatwin.scenarios":
            continue
        for one in imports(path):
            other = room(one) == "scenarios" and story(one) != story(name)
            if other or room(one) == "app":
                wrong.append(f"{name} imports {one}")
    assert wrong == []


def test_narx_and_grey_boxes_do_not_know_each_other() -> None:
    wrong = []
    for own, other in (("narx", "greybox"), ("greybox", "narx")):
        for name, path in modules(ROOT / "ident" / "deatwin" / "ident" / own):
            wrong += [f"{name} imports {one}" for one in imports(path) if one.startswith(f"deatwin.ident.{other}")]
    assert wrong == []
