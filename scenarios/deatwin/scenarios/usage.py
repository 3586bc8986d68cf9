"""How commands show themselves in their help."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

__all__ = ["unwrapped"]  # the classes are made by typer, with typer's own arguments


class Command(TyperCommand):
    """A command whose flags stand in its help without a type: they take no value."""

    def get_params(self, *arguments: Any, **named: Any) -> list[Any]:
        """Return the parameters, those of typer's own among them."""
        return _flags_untyped(super().get_params(*arguments, **named))


class Group(TyperGroup):
    """The same for what stands before a command."""

    def get_params(self, *arguments: Any, **named: Any) -> list[Any]:
        """Return the parameters, those of typer's own among them."""
        return _flags_untyped(super().get_params(*arguments, **named))


def unwrapped(text: str | None) -> str:
    """Return a docstring with a line for each paragraph, so that the terminal's width breaks it and not the source's.

    Parameters
    ----------
    text : str or None
        As a function has it.

    Returns
    -------
    str

    Examples
    --------
    >>> unwrapped("Do it.\\n\\n    So that\\n    it is done.\\n    ")
    'Do it.\\n\\nSo that it is done.'
    """
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in (text or "").split("\n\n")).strip()


def _flags_untyped(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False) and parameter.metavar is None:
            parameter.metavar = ""
    return parameters
