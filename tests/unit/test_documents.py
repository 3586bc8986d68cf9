"""The documents say what is: their commands parse, their code imports, their links lead somewhere.

Nothing long is run here; the notebooks are executed, and the site is built, by steps of their own in .ci/run.
"""

import ast
import importlib
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
from documents import DOCS, FENCE, PAGES, ROOT, blocks, commands, name_of, text_of
from public import PUBLIC

from deatwin.app.cli import app
from deatwin.app.options import fold_experiments
from deatwin.app.stories import stories

REFERENCE = DOCS / "reference"
MOST_PUBLIC_NAMES = 450
PLACEHOLDER = re.compile(r"[A-Z]{3,}")


def parse(arguments: list[str]) -> None:
    """Parse a call as the command line does, and run nothing.

    A command that is only mentioned, without any argument, is looked up.
    """
    group: Any = typer.main.get_command(app)
    root = group.make_context("deatwin", [], resilient_parsing=True)
    name, *rest = fold_experiments(arguments)
    if name.startswith("-"):
        assert name in ("--help", "--version")
        return
    command = group.get_command(root, name)
    assert command is not None, f"there is no command {name}"
    if not rest:
        return
    context = command.make_context(name, rest, parent=root)
    chosen = context.params.get("name")
    if name == "scenario" and not PLACEHOLDER.fullmatch(chosen):
        stories()[chosen].require_size(context.params["size"])
        stories()[chosen].require_tasks(context.params["task"] or ())


def told_by(error: Exception) -> str:
    return error.format_message() if hasattr(error, "format_message") else str(error)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_parses(page: Path) -> None:
    for arguments in commands(page):
        try:
            parse(arguments)
        except Exception as error:
            pytest.fail(f"{name_of(page)}: deatwin {shlex.join(arguments)}: {told_by(error)}")


def test_commands_are_found_where_they_stand() -> None:
    assert ["demo"] in list(commands(ROOT / "README.md"))
    assert any(arguments[:1] == ["check"] for arguments in commands(DOCS / "tutorial.md"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["diagnose", "rig.toml", "--outt", "found"], "No such option"),
        (["identify", "a.csv", "--method", "magic", "--out", "m.json"], "not one of"),
        (["check", "narx.json", "--out", "control"], "Missing option"),
        (["scenario", "silver-box", "--out", "x"], "silver-box"),
        (["identfy", "a.csv"], "no command"),
    ],
)
def test_a_wrong_command_does_not_parse(arguments: list[str], message: str) -> None:
    told = "it parses"
    try:
        parse(arguments)
    except Exception as error:  # usage errors are typer's own, which keeps their classes private
        told = told_by(error)
    assert message in told


def shown_modules() -> dict[str, set[str]]:
    """Names that each file shown under a title defines at its top: other blocks may import them."""
    shown: dict[str, set[str]] = {}
    for page in PAGES:
        for title, code in blocks(page, "python"):
            if title:
                tree = ast.parse(code)
                kinds = (ast.FunctionDef, ast.ClassDef)
                shown[title.removesuffix(".py")] = {node.name for node in tree.body if isinstance(node, kinds)}
    return shown


def wrong_imports(tree: ast.AST, shown: dict[str, set[str]]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            wanted = [(alias.name, None) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            wanted = [(node.module or "", alias.name) for alias in node.names]
        else:
            continue
        for module, name in wanted:
            if module in shown:
                there = name is None or name in shown[module]
            else:
                there = name is None or hasattr(importlib.import_module(module), name)
            if not there:
                yield f"{module}.{name}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_python_block_compiles_and_imports_what_there_is(page: Path) -> None:
    shown = shown_modules()
    for _, code in blocks(page, "python"):
        tree = ast.parse(code, filename=name_of(page))
        compile(tree, name_of(page), "exec")
        assert list(wrong_imports(tree, shown)) == []


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, as the site and GitHub make them."""
    found = set(re.findall(r"\{ *#([\w-]+) *\}", text_of(page)))
    for heading in re.findall(r"^#+ (.+)$", FENCE.sub("", text_of(page)), re.MULTILINE):
        plain = re.sub(r"[^\w\s-]", "", re.sub(r"\{.*\}", "", heading)).strip().lower()
        found.add(re.sub(r"[\s]+", "-", plain))
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", text_of(page))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{name_of(page)} links to {target}"
        if anchor and there.suffix == ".md":
            assert anchor in anchors(there), f"{name_of(page)} links to {target}"


def test_every_page_is_in_the_navigation() -> None:
    listed = set(re.findall(r"([\w/-]+\.md)", (ROOT / "mkdocs.yml").read_text(encoding="utf-8")))
    assert listed == {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}


@pytest.mark.parametrize("name", stories())
def test_every_scenario_is_in_the_table(name: str) -> None:
    assert f"| `{name}` |" in text_of(DOCS / "thesis.md")


@pytest.mark.parametrize(
    ("page", "number", "least"), [("concealed-physics.md", 0, 8), ("concealed-physics-long.md", 1, 8)]
)
def test_what_is_said_of_a_study_is_what_its_table_has(page: str, number: int, least: int) -> None:
    said = text_of(DOCS / "explanation" / "limits.md").partition("## How often it is right")[2]
    of_each = re.findall(r"(?:^\|.*\n)+", said, re.MULTILINE)
    counts = re.findall(r"^\|[^|]*\| (\d+ of \d+|0\.\d+) \|", of_each[number], re.MULTILINE)
    table = text_of(DOCS / page)
    assert len(counts) >= least
    assert [count for count in counts if count not in table] == []


def test_the_reference_shows_what_packages_export_and_nothing_else() -> None:
    exported = {f"{package}.{name}" for package in PUBLIC for name in importlib.import_module(package).__all__}
    shown = {line[4:] for page in REFERENCE.glob("*.md") for line in text_of(page).splitlines() if line[:4] == "::: "}
    assert shown <= exported, shown - exported
    names = {target.rpartition(".")[2] for target in shown}  # an effect is exported by two packages and shown once
    assert {target.rpartition(".")[2] for target in exported} == names
    assert len(names) <= MOST_PUBLIC_NAMES


@pytest.mark.parametrize("path", sorted((DOCS / "notebooks").glob("*.ipynb")), ids=name_of)
def test_notebooks_are_small_and_hold_no_outputs(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    assert len(path.read_bytes()) < 20_000
    for cell in cells:
        assert list(wrong_imports(ast.parse("".join(cell["source"])), {})) == []
