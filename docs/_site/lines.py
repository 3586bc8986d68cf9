"""Keep units on the lines of their numbers, and names of options on one line, as the reports do; break long addresses.

A hook of MkDocs (`on_page_content`), named in mkdocs.yml. Code keeps its characters, because readers copy it.
"""

from __future__ import annotations

import re
from typing import Any

from deatwin.studies.report.rendering import kept_together, whole_options

PARTS = re.compile(r"<(pre|svg|math|script|style|code)\b.*?</\1>|<[^>]*>|[^<]+", re.DOTALL)
TEXT = re.compile(r"(?<=>)[^<]+")
EXTRA = re.compile(r"(?:\"|&quot;)\.\[\w+\](?:\"|&quot;)")
"""What pip is given to install an extra, as in ``".[files]"``; browsers would break it behind the point."""
PATH = re.compile(r"[^\s<>]{26,}")
"""An address or a path that may be too long for a line."""
LONGEST_NAME = 26
"""Characters of the longest code in a table that is a name, and stays on one line; longer code is a sentence."""


def on_page_content(content: str, **_: Any) -> str:
    """Mark the places in the text at which no line may break."""
    return PARTS.sub(lambda found: _whole(found[0]), content)


def _whole(part: str) -> str:
    if part.startswith("<pre"):
        return TEXT.sub(lambda found: whole_options(found[0]), part)
    if part.startswith("<code>"):
        long = sum(map(len, TEXT.findall(part))) > LONGEST_NAME
        part = TEXT.sub(
            lambda found: _paths(EXTRA.sub(r'<span class="option">\g<0></span>', whole_options(found[0]))), part
        )
        return part.replace("<code>", '<code class="long">', 1) if long else part
    return part if part.startswith("<") else _paths(kept_together(part))


def _paths(text: str) -> str:
    """Break a long path behind its slashes."""
    return PATH.sub(lambda found: found[0].replace("/", "/<wbr>"), text)
