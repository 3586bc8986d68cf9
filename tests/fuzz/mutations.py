"""How a sound file is spoilt: the same ways for random bytes of atheris and for draws of hypothesis."""

import re
from collections.abc import Callable
from typing import Any

__all__ = ["HOSTILE", "WAYS", "mutated"]

Whole = Callable[[int, int], int]
"""Draws a whole number between two, both included."""

HOSTILE = (
    b"\x00",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\r",
    b"\n",
    b"\x1b[31m",
    b"\xed\xa0\x80",
    b"\xc2\x85",
    b'"',
    b"'",
    b",",
    b";",
    b"\t",
    b"#",
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b"-",
    b"_",
    b"../../x",
    b"1979-05-27",
    b"1e400",
    b"-1e400",
    b"nan",
    b"inf",
    b"1e999999999",
    b"9" * 400,
    b"9" * 5000,
    b"null",
    b"true",
    b"0",
    b"-0.0",
    b"1e-320",
    b"1e300",
    b"4294967295",
    b"9223372036854775808",
    b"^99999999999",
    b"k-999999999999",
    b"[" * 3000,
    b'{"a":' * 3000,
    b"a." * 500,
    b"x" * 140_000,
    "٣".encode(),
    "µ".encode(),
    "１".encode(),
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x80",
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
)


def flip(content: bytearray, whole: Whole) -> None:
    """One bit."""
    if content:
        content[whole(0, len(content) - 1)] ^= 1 << whole(0, 7)


def overwrite(content: bytearray, whole: Whole) -> None:
    """Some bytes, by hostile ones; the length stays."""
    if content:
        place, new = whole(0, len(content) - 1), HOSTILE[whole(0, len(HOSTILE) - 1)][:16]
        content[place : place + len(new)] = new


def insert(content: bytearray, whole: Whole) -> None:
    """Hostile bytes."""
    place = whole(0, len(content))
    content[place:place] = HOSTILE[whole(0, len(HOSTILE) - 1)]


def cut(content: bytearray, whole: Whole) -> None:
    """The end is lost."""
    del content[whole(0, len(content)) :]


def remove(content: bytearray, whole: Whole) -> None:
    """A block is lost."""
    place = whole(0, len(content))
    del content[place : place + whole(1, 64)]


def repeat(content: bytearray, whole: Whole) -> None:
    """A block comes twice, or many times."""
    place = whole(0, len(content))
    block = bytes(content[place : place + whole(1, 64)])
    content[place:place] = block * (1 if whole(0, 3) else 50)


def token(content: bytearray, whole: Whole) -> None:
    """A word or number of a text becomes a hostile one."""
    words = [match.span() for match in re.finditer(rb'"[^"]*"|[-+.\w]+', bytes(content))]
    if words:
        first, last = words[whole(0, len(words) - 1)]
        content[first:last] = HOSTILE[whole(0, len(HOSTILE) - 1)]


def move(content: bytearray, whole: Whole) -> None:
    """A word of a text takes the place of another."""
    words = [match.span() for match in re.finditer(rb'"[^"]*"|[-+.\w]+|\[[^\[\]]*\]', bytes(content))]
    if words:
        (first, last), (begin, end) = (words[whole(0, len(words) - 1)] for _ in range(2))
        content[first:last] = content[begin:end]


def encode(content: bytearray, whole: Whole) -> None:
    """A text is saved in another encoding."""
    codec = ("utf-16", "utf-8-sig", "utf-16-be", "gbk", "latin-1", "utf-32")[whole(0, 5)]
    content[:] = bytes(content).decode("utf-8", errors="replace").encode(codec, errors="replace")


WAYS: tuple[Callable[[bytearray, Whole], Any], ...] = (
    flip,
    overwrite,
    insert,
    cut,
    remove,
    repeat,
    token,
    move,
    encode,
)


def mutated(seed: bytes, whole: Whole) -> bytes:
    """Return a file spoilt in one to three ways.

    Parameters
    ----------
    seed : bytes
        A sound file.
    whole : callable
        Draws a whole number between two.

    Returns
    -------
    bytes
    """
    content = bytearray(seed)
    for _ in range(whole(1, 3)):
        WAYS[whole(0, len(WAYS) - 1)](content, whole)
    return bytes(content)
