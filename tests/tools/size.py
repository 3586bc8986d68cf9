"""Print how large the project is beside what it was and what it should be: ``python tests/tools/size.py``.

The figures measure; they are no end. All are read from the sources, of which nothing is imported or run.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
APART = "deatwin.ident.mismatch"
"""The diagnosis engine, which is measured on its own."""
STORIES = "deatwin.scenarios"
LOST = re.compile(r"(What|Whether|Of|Where|The same|That|Those|As|By|From|With|In|At|On|To|Which|How|When)\b")
"""How a fragment begins: a clause or a preposition, to which no subject comes. A noun with what describes it, such as
"Sampling time, s.", is an entry as numpydoc has them, and no fragment."""
ENTRY = re.compile(r"^ {4}(\S.*)$")
PATCHED = re.compile(r"\b(?:patch|setattr)\(\s*f?\"deatwin")


@dataclass(frozen=True)
class Module:
    """A module's dotted name, text and syntax tree."""

    name: str
    path: Path
    text: str
    tree: ast.Module

    @property
    def lines(self) -> int:
        return len(self.text.splitlines())

    @cached_property
    def exported(self) -> list[str]:
        """What its ``__all__`` lists."""
        for node in self.tree.body:
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                return list(ast.literal_eval(node.value))
        return []

    @property
    def docstring_lines(self) -> int:
        """Lines of the docstrings of modules, classes and functions, and of the texts below constants and fields."""
        texts = [
            node.value
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        ]
        return sum((text.end_lineno or text.lineno) - text.lineno + 1 for text in texts)

    def imports(self) -> Iterator[tuple[str, str, str]]:
        """Module, name there and name here of everything it imports anywhere, for type checking too."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                yield from ((alias.name, "", alias.asname or alias.name) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                yield from ((node.module, alias.name, alias.asname or alias.name) for alias in node.names)


def product(root: Path = ROOT) -> dict[str, Module]:
    """All modules of the product by name."""
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    found = {}
    for source in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["sources"]:
        for path in sorted((root / source).rglob("*.py")):
            name = ".".join(path.relative_to(root / source).with_suffix("").parts).removesuffix(".__init__")
            text = path.read_text(encoding="utf-8")
            found[name] = Module(name, path, text, ast.parse(text))
    return found


def stories(modules: dict[str, Module]) -> dict[str, int]:
    """Lines by story, the largest first; each is a package or a module."""
    sizes: dict[str, int] = {}
    for name, module in modules.items():
        if name.startswith(STORIES + "."):
            inner = name.split(".")[2]
            sizes[inner] = sizes.get(inner, 0) + module.lines
    return dict(sorted(sizes.items(), key=lambda item: -item[1]))


def public(modules: dict[str, Module]) -> set[tuple[str, str]]:
    """What packages re-export: each thing once, as the module that defines it and its name there."""

    def origin(module: str, name: str) -> tuple[str, str]:
        for source, there, here in modules[module].imports() if module in modules else ():
            if here == name and there:
                return origin(source, there)
        return module, name

    packages = [module for module in modules.values() if module.path.name == "__init__.py"]
    return {origin(package.name, name) for package in packages for name in package.exported}


def circles(modules: dict[str, Module]) -> list[list[str]]:
    """Groups of modules that import one another, however indirectly, inside functions and for types too."""
    reached: dict[str, set[str]] = {}
    for name, module in modules.items():
        targets = {
            f"{source}.{there}" if f"{source}.{there}" in modules else source for source, there, _ in module.imports()
        }
        reached[name] = (targets & set(modules)) - {name}
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:  # Tarjan's strongly connected components
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in reached[name]:
            if other not in index:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == index[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                found.append(sorted(group))

    sys.setrecursionlimit(10_000)
    for name in reached:
        if name not in index:
            visit(name)
    return found


def untyped_fields(modules: Iterable[Module]) -> list[str]:
    """Fields of dataclasses that are mappings of anything, as ``module.Class.field``."""
    return [
        f"{module.name}.{kind.name}.{ast.unparse(field.target)}"
        for module in modules
        for kind in ast.walk(module.tree)
        if isinstance(kind, ast.ClassDef) and any("dataclass" in ast.unparse(made) for made in kind.decorator_list)
        for field in kind.body
        if isinstance(field, ast.AnnAssign) and re.search(r"(Mapping|dict)\[str, Any\]", ast.unparse(field.annotation))
    ]


def fragments(modules: dict[str, Module], names: Iterable[tuple[str, str]]) -> tuple[list[str], int]:
    """Summaries and entries of public docstrings that begin like a fragment, and how many sentences were read."""
    lost, read = [], 0
    for module, name in sorted(names):
        for node in modules[module].tree.body if module in modules else ():
            if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name != name:
                continue
            lines = (ast.get_docstring(node) or "").splitlines()
            entries = [
                found[1] for before, line in pairwise(lines) if before[:1].strip() and (found := ENTRY.match(line))
            ]
            sentences = [*lines[:1], *entries]
            read += len(sentences)
            lost += [f"{module}.{name}: {sentence}" for sentence in sentences if LOST.match(sentence)]
    return lost, read


def rows(root: Path = ROOT) -> list[tuple[str, str, str, str]]:
    """The table: what, before, now, wanted."""
    modules = product(root)
    ours = {name: module for name, module in modules.items() if not f"{name}.".startswith(APART + ".")}
    sizes = list(stories(modules).items()) or [("none", 0)]
    names = public(modules)
    everywhere = sum(len(m.exported) for m in modules.values() if m.path.name != "__init__.py")
    lost, read = fragments(modules, {name for name in names if not name[0].startswith(APART)})
    tests = [path.read_text(encoding="utf-8") for path in sorted((root / "tests").rglob("*.py"))]
    second = f", then {sizes[1][0]} {sizes[1][1]:,}" if len(sizes) > 1 else ""
    return [
        ("product, lines", "113,500", f"{sum(m.lines for m in modules.values()):,}", ""),
        ("  without ident/mismatch", "98,500", f"{sum(m.lines for m in ours.values()):,}", "<= 68,000"),
        (
            "  under scenarios/",
            "40,500",
            f"{sum(m.lines for m in modules.values() if m.path.is_relative_to(root / 'scenarios')):,}",
            "<= 23,000",
        ),
        ("largest story, lines", "6,300", f"{sizes[0][1]:,} {sizes[0][0]}{second}", "<= 2,500, others <= 1,200"),
        (
            "docstrings without ident/mismatch, lines",
            "34,100",
            f"{sum(m.docstring_lines for m in ours.values()):,}",
            "<= 19,000",
        ),
        ("public names (packages re-export them)", "1,765", f"{len(names):,}", "<= 450"),
        ("names in __all__ of other modules", "", f"{everywhere:,}", "0"),
        ("circles of imports, for types too", "22", f"{len(circles(modules))}", "<= 5"),
        (
            "fields of dataclasses typed Mapping[str, Any]",
            "many",
            f"{len(untyped_fields(modules.values()))}",
            "0 on results",
        ),
        (
            "public docstrings: summaries, entries that are fragments",
            "27 %",
            f"{100 * len(lost) / max(read, 1):.0f} % of {read}",
            "< 3 %",
        ),
        ("tests, lines", "51,000", f"{sum(len(text.splitlines()) for text in tests):,}", "<= 46,000"),
        ('patches of "deatwin..." in tests', "57", f"{sum(len(PATCHED.findall(text)) for text in tests)}", "< 10"),
    ]


if __name__ == "__main__":
    for what, before, now, wanted in [("", "before", "now", "wanted"), *rows()]:
        print(f"{what:<46} {before:>8}   {now:<52} {wanted}")
