"""Equations of the site: LaTeX in pages and docstrings becomes MathML while the site is built.

Browsers draw MathML by themselves, so that a page needs neither a script nor the network for its equations. This file
is a hook of MkDocs (`on_page_content`) and an extension of griffe (`RstMath`), both named in mkdocs.yml.
"""

from __future__ import annotations

import html
import logging
import re
from textwrap import dedent
from typing import Any

import griffe
from latex2mathml.converter import convert

log = logging.getLogger("mkdocs.hooks.equations")  # below "mkdocs", where --strict counts warnings

BLOCK = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
INLINE = re.compile(r'([([]?)<span class="arithmatex">\\\((.*?)\\\)</span>([,.;:)\]]*)', re.DOTALL)
DIRECTIVE = re.compile(r"^( *)\.\. math::[ \t]*(.*(?:\n(?:\1[ \t]+\S.*|[ \t]*(?=\n\1[ \t]+\S)))*)", re.MULTILINE)
SHAPE = re.compile(r"^( *(?:\w[\w, ]* : )?\w+), shape (?=\()", re.MULTILINE)
SPACE = re.compile(r"\\qquad(?![a-zA-Z])")
ROLE = re.compile(r":math:`([^`]+)`")


def on_page_content(content: str, **_: Any) -> str:
    """Put MathML where pymdownx.arithmatex has left LaTeX."""
    content = BLOCK.sub(lambda found: f'<div class="equation">{_equations(found[1])}</div>', content)
    return INLINE.sub(_inline, content)


def _equations(latex: str) -> str:
    r"""Write equations with \qquad between them as separate elements, which a narrow page puts on separate lines."""
    return "".join(_mathml(part, "block") for part in SPACE.split(latex))


def _inline(found: re.Match[str]) -> str:
    """Write an equation on one line with the brackets and the punctuation around it."""
    before, latex, after = found.groups()
    shown = _mathml(latex, "inline")
    return f'<span class="option">{before}{shown}{after}</span>' if before or after else shown


def _mathml(latex: str, display: str) -> str:
    text = html.unescape(latex).strip()
    try:
        return convert(text, display=display)
    except Exception as error:
        log.warning("no MathML for %r: %s", text, error)
        return f"<code>{html.escape(text)}</code>"


def to_markdown(docstring: str) -> str:
    """Write the equations of a reStructuredText docstring as Markdown has them, and keep the shapes of arrays as written.

    Parameters
    ----------
    docstring : str
        Without the indentation of its code.

    Returns
    -------
    str
    """
    docstring = SHAPE.sub("\\1, shape\xa0", docstring)  # else "ndarray, shape (n,)" is read as a tuple of Python
    docstring = DIRECTIVE.sub(_directive, docstring)
    return ROLE.sub(lambda found: rf"\({' '.join(found[1].split())}\)", docstring)


def _directive(found: re.Match[str]) -> str:
    indent, first, *rest = found[1], *found[2].split("\n")
    latex = " ".join(line.strip() for line in [first, *dedent("\n".join(rest)).split("\n")] if line.strip())
    return f"{indent}\n{indent}$$\n{indent}{latex}\n{indent}$$\n{indent}"


class RstMath(griffe.Extension):
    """Rewrites docstrings as they are loaded."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite one.

        Parameters
        ----------
        obj : griffe.Object
            Module, class, function or attribute.
        """
        if obj.docstring:
            obj.docstring.value = to_markdown(obj.docstring.value)
