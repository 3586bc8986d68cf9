"""Options that say how a file is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of `read_recordings`, by its names; None or False means not given."""

    input_column: str | None = None
    output_column: str | None = None
    time_column: str | None = None
    dt: float | None = None
    resample: float | None = None
    allow_gaps: bool = False

    @classmethod
    def of(cls, asked: Mapping[str, Any]) -> ReadOptions:
        """Take the options from the arguments of a command, ignoring others."""
        return cls(**{field.name: asked[field.name] for field in fields(cls) if field.name in asked})

    @property
    def given(self) -> dict[str, Any]:
        """Return the options that are given."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None and value is not False}

    def __bool__(self) -> bool:
        return bool(self.given)

    def __or__(self, other: ReadOptions) -> ReadOptions:
        """Combine two sets of options; where both give one, the second counts."""
        return replace(self, **other.given)

    def with_column(self, role: str, column: str) -> ReadOptions:
        """Return the options with another column as ``input``, ``output`` or ``time``."""
        named: dict[str, Any] = {f"{role}_column": column}
        return replace(self, **named)

    def without(self, *names: str) -> ReadOptions:
        """Return the options without some of them."""
        return ReadOptions(**{name: value for name, value in self.given.items() if name not in names})

    @property
    def flags(self) -> list[tuple[str, ...]]:
        """Return the flags of the command line, each with its value if it takes one."""
        found: list[tuple[str, ...]] = []
        for name, value in self.given.items():
            flag = f"--{name.replace('_', '-')}"
            shown = f"{value:.12g}" if isinstance(value, float) else str(value)
            found.append((flag,) if value is True else (flag, shown))
        return found

    @property
    def words(self) -> tuple[str, ...]:
        """Return the words of the command line."""
        return tuple(word for flag in self.flags for word in flag)

    def __str__(self) -> str:
        """Write the options for an error text, with columns in quotes."""
        return " ".join(
            f'{flag[0]} "{flag[1]}"' if flag[0].endswith("-column") else " ".join(flag) for flag in self.flags
        )


NO_OPTIONS = ReadOptions()
