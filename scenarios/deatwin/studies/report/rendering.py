"""Write pages: each one self-contained HTML file that includes its figures' data, and the origin of its result."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from deatwin.ident.mismatch.say import ends, risk, since_rest
from deatwin.plant.effects.titles import effects_in_words
from deatwin.plant.prefixes import time_span
from deatwin.plant.words import as_sentence
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord, versions
from deatwin.studies.report.drawing import COLOURS, MINUS, Drawing
from deatwin.studies.report.quantities import between, likely, quantity, raised, three_digits

if TYPE_CHECKING:
    from jinja2 import Environment

LEFT_OUT = {"--out": 1, "--report": 1, "--jobs": 1, "--json": 0, "--quiet": 0}
"""Options that change where results go and what is printed, but not the results, with the number of words that follow
each."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of a result, without what may differ between equal runs."""

    inputs: Sequence[Mapping[str, str]]  # ``file`` and ``sha256`` of each input
    seed: int
    command: Sequence[str] = ()  # The command line; empty if there was none

    @classmethod
    def of(cls, record: RunRecord) -> Origin:
        """Return the origin stated in the record of a run."""
        return cls(inputs=record.inputs, seed=record.seed, command=record.command)

    @property
    def files(self) -> str:
        """Names of the input files, without folders."""
        return ", ".join(PurePath(given["file"]).name for given in self.inputs)

    @property
    def shown(self) -> str:
        """Return the command line to repeat the run, without options that do not affect the results."""
        words = list(self.command)
        kept = [PurePath(word).name for word in words[:1]]
        place = 1
        while place < len(words):
            name = words[place].split("=")[0]
            if name not in LEFT_OUT:
                kept.append(words[place])
            elif "=" not in words[place]:
                place += LEFT_OUT[name]
            place += 1
        return shlex.join(kept)


LARGEST = 4_500_000
"""Most bytes of a page. Data that would make it larger stay in their files beside it, the largest of them first."""
REST = 300_000  # Most bytes of a page without its figures and their data
_UNIT = re.compile(
    r"(?<=\d) (?:%|°|dB|samples?|times|[pnµumkMG]?(?:Hz|Pa|ohm|Ω|rad|[msVANFgWKJ])(?: s)?(?:/[a-zµ]+)?(?: rms)?)(?!\w)"
    r"|(?<=[≥≤±=]) (?=[\d-])|(?<=&lt;|&gt;) (?=\d)|(?<=\d) of (?=\d)|(?<=\d) (?=\d{3}(?!\d))|(?<=[nµmk][mVNA]) (?=rms\b)"
)
_OPTION = re.compile(r"(?<!\S)(?:--[a-z][a-z-]+|[a-z]+(?:-[a-z]+)*-\d+)(?![\w-])")


def write_page(
    folder: ResultFolder,
    template: str,
    drawings: Iterable[Drawing],
    origin: Origin,
    package: str = "deatwin.studies.report",
    **shown: Any,
) -> None:
    """Write ``report.html`` from a template of a package; the template may extend those of this package."""
    script = files("deatwin.studies.report").joinpath("templates", "figures.js").read_text(encoding="utf-8")
    figures = list(drawings)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    page = templates(package).get_template(template)
    text = page.render(
        **shown,
        origin=origin,
        versions=versions(),
        colours=COLOURS,
        script=script,
        script_hash=f"sha256-{digest}",  # by which the page's security policy allows its one script
        data=packed(folder.path, figures),
    )
    folder.text("report.html", text)


def templates(package: str) -> Environment:
    """Return the templates of a package, with those of the reports as fallback."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("deatwin.studies.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": three_digits,
        "risk": risk,
        "likely": likely,
        "plain": effects_in_words,
        "between": between,
        "ends": ends,
        "since_rest": since_rest,
    }
    environment.filters |= {"quantity": quantity, "raised": raised, "sentence": as_sentence, "time_span": time_span}
    environment.filters["commands"] = lambda text: Markup(commands(str(unbroken(text))))
    environment.filters["whole_options"] = lambda text: Markup(whole_options(str(escape(text))))
    environment.finalize = unbroken
    return environment


def unbroken(shown: Any) -> Any:
    """Return text as HTML whose lines break at suitable places; leave everything else as it is."""
    from markupsafe import Markup, escape

    return Markup(kept_together(str(escape(shown)))) if type(shown) is str else shown


def kept_together(text: str) -> str:
    """Keep numbers on one line with their units and signs, write minus signs as figures do, and keep names of options whole.

    >>> kept_together("from 4.6 to -2.1 µm rms (p = 0.02), 2 of 20 000"), kept_together("with --out")
    ('from 4.6 to −2.1\xa0µm\xa0rms (p =\xa00.02), 2\xa0of\xa020\xa0000', 'with <span class="option">--out</span>')
    >>> kept_together("80.1 mN s/m"), kept_together("error (µm rms)"), kept_together("1 sample or 0.42 times, pair-01")
    ('80.1\xa0mN\xa0s/m', 'error (µm\xa0rms)', '1\xa0sample or 0.42\xa0times, <span class="option">pair-01</span>')
    """
    text = _UNIT.sub(lambda found: found[0].replace(" ", "\xa0"), text)
    return whole_options(MINUS.sub("−", text))


def commands(text: str) -> str:
    """Show the parts of a text of HTML that stand in backticks as code.

    >>> commands("use `deatwin check`")
    'use <code>deatwin check</code>'
    """
    return re.sub("`([^`]*)`", r"<code>\1</code>", text)


def whole_options(text: str) -> str:
    """Keep each option, such as ``--out``, and each numbered name, such as ``pair-01``, on one line, in the text of HTML."""
    return _OPTION.sub(r'<span class="option">\g<0></span>', text)


def packed(folder: Path, drawings: Iterable[Drawing]) -> dict[str, str]:
    """Return the figures' data, compressed, as far as the page's size limit allows."""
    figures = list(drawings)
    names = dict.fromkeys(name for figure in figures for name in figure.files)
    texts = {
        name: base64.b64encode(gzip.compress((folder / name).read_bytes(), mtime=0)).decode("ascii") for name in names
    }
    room = LARGEST - REST - sum(len(figure.svg.encode()) for figure in figures)
    kept = set()
    for name in sorted(texts, key=lambda name: len(texts[name])):
        room -= len(texts[name])
        if room < 0:
            break
        kept.add(name)
    return {name: text for name, text in texts.items() if name in kept}
