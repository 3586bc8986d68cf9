"""Write names, lists and remarks in words."""

from __future__ import annotations

import re
from collections.abc import Sequence

_PROPER = re.compile(r"\b(?:(rc)|coulomb|mullins)\b")


def spaced(name: str) -> str:
    """Write a name as words, with the capitals of names of persons and abbreviations.

    >>> spaced("sensor_drift"), spaced("electrode_rc + coulomb_friction")
    ('sensor drift', 'electrode RC + Coulomb friction')
    """
    return _PROPER.sub(lambda found: found[0].upper() if found[1] else found[0].title(), name.replace("_", " "))


def listed(texts: Sequence[str]) -> str:
    """Join texts in words.

    >>> listed(["A", "B", "C"]), listed(["A"]), listed([])
    ('A, B and C', 'A', '')
    """
    return " and ".join([*filter(None, [", ".join(texts[:-1])]), *texts[-1:]])


def first_of(texts: Sequence[str], most: int, between: str = ", ") -> str:
    """Join the first texts, and count the others.

    >>> first_of(["A", "B", "C", "D"], 2), first_of(["A", "B"], 2)
    ('A, B and 2 more', 'A, B')
    """
    more = len(texts) - most
    return between.join(texts[:most]) + (f" and {more} more" if more > 0 else "")


def as_sentence(text: str) -> str:
    """Write a text as a sentence; a name at its beginning, such as that of a file, keeps its small letter.

    >>> as_sentence("the reading jumps"), as_sentence("noise.csv: the reading jumps")
    ('The reading jumps.', 'noise.csv: the reading jumps.')
    """
    start = text[:1] if re.search(r"[._]", text.partition(" ")[0]) else text[:1].upper()
    return f"{start}{text[1:]}."
