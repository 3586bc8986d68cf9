"""Tables in Markdown, for the documents."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from deatwin.plant.effects.catalogue import MACHINES, catalogue
from deatwin.plant.effects.titles import effects_in_words

_NAMES = "|".join(sorted((effect.name for effect in (*catalogue(), *MACHINES)), key=len, reverse=True))
_NAMED = re.compile(rf"`[^`]*`|\b(?:{_NAMES.replace('_', '[_ ]')})(?:_at_\w+)?\b")


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown; names of effects become words, and a vertical bar in a cell a slash."""
    return [
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
        *(f"| {' | '.join(in_words(cell).replace('|', '/') for cell in row)} |" for row in rows),
    ]


def in_words(cell: str) -> str:
    """Write the names of effects in words, but not in code.

    >>> in_words("electrode_rc, or `electrode_rc`"), in_words("coulomb friction")
    ('electrode RC, or `electrode_rc`', 'Coulomb friction')
    """
    return _NAMED.sub(lambda found: found[0] if found[0].startswith("`") else effects_in_words(found[0]), cell)
