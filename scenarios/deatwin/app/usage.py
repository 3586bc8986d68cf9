"""Help of the commands."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption


class _Untyped:
    """The help of a command or a group shows no type where it says nothing."""

    def get_params(self, *arguments: Any, **named: Any) -> list[Any]:
        """Return the parameters, those of typer's own among them."""
        parameters: list[Any] = super().get_params(*arguments, **named)  # type: ignore[misc]
        for parameter in parameters:
            if parameter.param_type_name == "argument" and parameter.metavar is not None:
                parameter.display_type_rich = lambda *_, **__: ""  # typer would add <list[Path]> to REC...
            if getattr(parameter, "is_flag", False) and parameter.metavar is None:
                parameter.metavar = ""
        return parameters


class Command(_Untyped, TyperCommand):
    """A command whose help shows no type for flags, which take no value, or for arguments with a word of their own."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of a command; a repeated single-valued option is an error."""
        *_, given = self.make_parser(ctx).parse_args(list(args))
        for option, times in Counter(given).items():
            single = isinstance(option, TyperOption) and not option.is_flag and not option.multiple
            if times > 1 and single and option.nargs == 1:
                raise typer.BadParameter("given more than once; it takes one value", param_hint=f"'{option.opts[0]}'")
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, *arguments: Any, **named: Any) -> list[str]:
        """Return the words of the usage line, with dots only once where several words may follow."""
        words = super().collect_usage_pieces(*arguments, **named)
        return [re.sub(r"\.\.\.([]}])\.\.\.$", r"\1...", word) for word in words]


class Group(_Untyped, TyperGroup):
    """A group of commands in whose help flags have no type."""


def unwrapped(text: str | None) -> str:
    """Return a docstring with one line for each paragraph, so that the terminal's width breaks it."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in (text or "").split("\n\n")).strip()
