"""Label the cells of wide tables with their columns, so that a narrow screen can show the cells of a row below each other.

A hook of MkDocs (`on_page_content`), named in mkdocs.yml. The stylesheet `extra.css` stacks the labelled cells. The
extension of griffe (`OwnRows`), named there too, gives each parameter its own row of a table, shows the numbers that
constants hold, and shows an exported function where a module has the same name.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from itertools import chain, repeat
from typing import Any

import griffe

TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
HEAD = re.compile(r"<th\b[^>]*>(.*?)</th>", re.DOTALL)
ROW = re.compile(r"<tr\b.*?</tr>", re.DOTALL)
SECTION = re.compile(
    r"^((?:Other )?Parameters|Attributes)\n-+\n(?:(?:[ \t]+\S.*|\w.*$(?!\n-)|[ \t]*)\n?)*", re.MULTILINE
)
SHARED = re.compile(r"^(\w+(?:, \w+)+)( : .*)?\n((?:[ \t]+.*\n?|[ \t]*\n)*)", re.MULTILINE)
BARE = re.compile(r"^Returns\n-+\n\S.*\n*(?=\w.*\n-+\n|\Z)", re.MULTILINE)
"""A return type without a description, which the signature above shows, too."""
NARROW = 2
"""Columns of a table that a narrow screen shows as it is."""


def on_page_content(content: str, **_: Any) -> str:
    """Label the cells of each table that has more than two columns."""
    return TABLE.sub(lambda found: _labelled(found[0]), content)


def _labelled(table: str) -> str:
    heads = [html.unescape(re.sub(r"<[^>]*>", "", head)).strip() for head in HEAD.findall(table)]
    if len(heads) <= NARROW:
        return table

    def cells(row: re.Match[str]) -> str:
        names = chain(heads, repeat(""))
        return re.sub(r"<td\b", lambda _: f'<td data-label="{html.escape(next(names))}"', row[0])

    return ROW.sub(cells, table)


class OwnRows(griffe.Extension):
    """Splits docstrings' entries of several names, to which griffe would give the type and default of the first name.

    The first row lists the names before their common description, to which the other rows refer.
    """

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Split the entries of one module, class, function or attribute."""
        if obj.docstring:
            text = BARE.sub("", obj.docstring.value)
            obj.docstring.value = SECTION.sub(lambda found: SHARED.sub(_split, found[0]), text)

    def on_package(self, *, pkg: griffe.Module, loader: griffe.GriffeLoader, **_: Any) -> None:
        """Write the numbers of constants that are defaults, and put exported functions before modules of the same name."""
        for obj in _below(pkg):
            if obj.is_function:
                for parameter in obj.parameters:
                    parameter.default = _number(parameter.default, obj)
            elif obj.is_attribute and obj.parent.is_class:
                obj.value = _number(obj.value, obj)
        loader.resolve_aliases(implicit=True)  # afterwards, the modules that are replaced are not found by their paths
        modules = [
            (package, name, module)
            for package in list(_below(pkg))
            if package.is_init_module
            for name, module in package.members.items()
            if (not module.is_alias or module.resolved) and module.is_module
        ]
        exported = {
            module.path: loader.modules_collection[package.imports[name]]
            for package, name, module in modules
            if not module.is_alias and name in package.imports
        }
        for package, name, module in modules:
            if module.canonical_path in exported:
                package.members[name] = griffe.Alias(name, exported[module.canonical_path], parent=package)


def _below(obj: griffe.Object) -> Iterator[griffe.Object]:
    for member in obj.members.values():
        if not member.is_alias:
            yield member
            yield from _below(member)


def _number(default: Any, obj: griffe.Object) -> Any:
    if not isinstance(default, griffe.ExprName):
        return default
    try:
        value = obj.modules_collection[default.canonical_path].value
    except (KeyError, AttributeError, griffe.NameResolutionError):  # a builtin, or something without a value
        return default
    return value if isinstance(value, str) and re.fullmatch(r"[\d.e-]+", value) else default


def _split(entry: re.Match[str]) -> str:
    names, kind, text = entry.groups(default="")
    first, *others = names.split(", ")
    listed = ", ".join(f"`{name}`" for name in (first, *others))  # the order in which the description speaks of them
    body = re.sub(r"\S", lambda found: f"{listed}: {found[0]}", text.rstrip(), count=1)
    return f"{first}{kind}\n{body}\n" + "".join(f"{name}{kind}\n    See `{first}`.\n" for name in others)
