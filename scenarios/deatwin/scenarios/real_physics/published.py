"""What others reached on the standard tasks: each figure with its source, and with where it was read."""

from __future__ import annotations

from dataclasses import dataclass

from deatwin.studies.report.story import Table

_COPY = "transcription of tables 3 and 4 of Champneys et al. (secondary)"
_LATEX = "the authors' LaTeX, github.com/forgi86/dynonet, doc/paper/ms.tex"
_UNSEEN = "not read at its source, nor in a list that could be checked"
_BASELINES = "Champneys et al., IFAC-PapersOnLine 58 (2024), doi:10.1016/j.ifacol.2024.08.574, arXiv:2405.10779v2"
_DYNONET = "Forgione & Piga 2021, arXiv:2006.02250, section Examples"
_SUBNET = "Beintema, Tóth & Schoukens 2021, as listed by Champneys et al., arXiv:2405.10779v2"


@dataclass(frozen=True, kw_only=True)
class Published:
    """An error that others reached on a test part."""

    test: str
    error: str  # With its unit
    model: str
    source: str
    read: str  # Where the figure was read


def _of(test: str, *rows: tuple[str, str, str, str]) -> list[Published]:
    return [Published(test=test, error=row[0], model=row[1], source=row[2], read=row[3]) for row in rows]


PUBLISHED = (
    *_of(
        "Silverbox, multisine",
        ("0.301 mV", "GP-NARX", _BASELINES, _COPY),
        ("0.36 mV", "SUBNET", _SUBNET, _COPY),
    ),
    *_of(
        "Silverbox, arrow-head, whole",
        ("0.26 mV", "PNLSS", "Paduart et al., Automatica 46 (2010), doi:10.1016/j.automatica.2010.01.001", _UNSEEN),
        ("0.60 mV", "GP-NARX", _BASELINES, _COPY),
    ),
    *_of(
        "Silverbox, arrow-head, inside",
        ("0.259 mV", "GP-NARX", _BASELINES, _COPY),
        ("0.32 mV", "SUBNET", _SUBNET, _COPY),
    ),
    *_of(
        "Cascaded tanks, validation",
        (
            "0.191 V",
            "grey box",
            "Worden et al., Mechanical Systems and Signal Processing 112 (2018) 194-232, as listed by Champneys et al.",
            _COPY,
        ),
        ("0.306 V", "black box", "unknown", _UNSEEN),
        ("0.396 V", "GRU", _BASELINES, _COPY),
    ),
    *_of(
        "EMPS, pulses",
        ("2.64 mm", "dynoNet", _DYNONET, _LATEX),
        ("5.17 mm", "polynomial NARX", _BASELINES, _COPY),
        ("about 5.4 mm", "physics of four parameters", "unknown", _UNSEEN),
        ("5.53 mm", "linear state space", _BASELINES, _COPY),
    ),
    *_of(
        "Bouc-Wen, multisine",
        (
            "18.7 µm",
            "PNLSS",
            "Fakhrizadeh Esfahani et al. 2017, as quoted by Forgione & Piga, arXiv:2006.02250",
            _LATEX,
        ),
        ("45.2 µm", "dynoNet", _DYNONET, _LATEX),
    ),
)


def said(test: str) -> str:
    """Return the results of others on a test part, in one line."""
    return ", ".join(f"{one.error} ({one.model})" for one in PUBLISHED if one.test == test)


def sources() -> Table:
    """Return all figures with their sources."""
    return Table.of(
        "Published errors, and where they were read",
        PUBLISHED,
        {
            "test part": lambda one: one.test,
            "error": lambda one: one.error,
            "model": lambda one: one.model,
            "source": lambda one: one.source,
            "read in": lambda one: one.read,
        },
    )
