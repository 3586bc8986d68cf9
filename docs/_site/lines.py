"""Keep units on the lines of their numbers, and names of options on one line, as the reports do.

A hook of MkDocs (`on_page_content`), named in mkdocs.yml. Code blocks stay as they are, because readers copy them.
"""

from __future__ import annotations

import re
from typing import Any

from deatwin.studies.report.rendering import kept_together

PARTS = re.compile(r"<(pre|svg|math|script|style)\b.*?</\1>|<[^>]*>|[^<]+", re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Mark the places in the text at which no line may break.

    Parameters
    ----------
    content : str
        HTML of a page's content.

    Returns
    -------
    str
    """
    return PARTS.sub(lambda found: found[0] if found[0].startswith("<") else kept_together(found[0]), content)
