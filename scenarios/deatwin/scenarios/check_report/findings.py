"""The table of findings: each number beside what was asked, in groups."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite

from deatwin.control.checking.specification import Limit, Verdict
from deatwin.control.checking.verdict import Finding
from deatwin.scenarios.check_report.view import View

__all__ = ["TONES", "Group", "Row", "groups"]

TONES = {Verdict.PASS: "good", Verdict.MARGINAL: "doubt", Verdict.FAIL: "bad"}
"""Classes of the page's style."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A line of the table.

    Parameters
    ----------
    subject, value, good, poor, verdict, tone, text : str
        As they are shown.
    """

    subject: str
    value: str
    good: str
    poor: str
    verdict: str
    tone: str
    text: str


@dataclass(frozen=True, kw_only=True)
class Group:
    """Lines that belong together.

    Parameters
    ----------
    title : str
        Their heading.
    rows : list of Row
        In the order of the check.
    """

    title: str
    rows: list[Row]


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """How findings on one subject are shown.

    Parameters
    ----------
    group : str
        Where they stand, with ``{}`` for whose they are.
    shown : callable
        A value as text.
    limit : str
        Field of the specification; empty where none belongs to it.
    """

    group: str
    shown: Callable[[float], str] = lambda value: f"{value:.3g}"
    limit: str = ""


def groups(view: View) -> list[Group]:
    """Gather the findings of a check.

    Parameters
    ----------
    view : View
        Of the check.

    Returns
    -------
    list of Group
    """
    found: dict[str, list[Row]] = {}
    for finding in view.check.findings:
        subject, source = _split(finding.subject, view)
        kind = _KINDS.get(subject, _Kind(group="Further findings"))
        found.setdefault(kind.group.format(_whose(source, view)), []).append(_row(finding, subject, kind, view))
    return [Group(title=title, rows=rows) for title, rows in found.items()]


def _split(subject: str, view: View) -> tuple[str, str]:
    """What a finding is about, and whose: the model's or the physics plant's own say nothing in brackets."""
    match = re.fullmatch(r"(.+?) \((.+)\)", subject)
    if match is not None and match[2] in view.looks:
        return match[1], match[2]
    return subject, "model" if subject in _MARGINS else "plant"


def _whose(source: str, view: View) -> str:
    label = view.looks[source].label
    return f"the {label}" if source.split(" ")[0] in ("model", "plant") else label


def _row(finding: Finding, subject: str, kind: _Kind, view: View) -> Row:
    good, poor = _limits(finding, subject, kind, view)
    return Row(
        subject=subject, value=_number(finding.value, kind.shown), good=good, poor=poor,
        verdict=finding.verdict.value, tone=TONES[finding.verdict], text=finding.text,
    )  # fmt: skip


def _number(value: float | None, shown: Callable[[float], str]) -> str:
    if value is None:
        return "–"
    return shown(value) if isfinite(value) else "∞"


def _limits(finding: Finding, subject: str, kind: _Kind, view: View) -> tuple[str, str]:
    """What is good, and what is still tolerated."""
    if kind.limit:
        limit: Limit = getattr(view.specification.on_a_stand_in, kind.limit)
        sign = "≥" if limit.good > limit.poor else "≤"
        return f"{sign} {kind.shown(limit.good)}", f"{sign} {kind.shown(limit.poor)}"
    if subject == "excitation" and view.check.excited_band_Hz is not None:
        band = view.check.excited_band_Hz
        if finding.verdict is Verdict.MARGINAL and finding.value is not None and finding.value <= band:
            return "in no hole", "in a hole"
        return f"≤ {kind.shown(band)}", "beyond"
    return ("none", "at the limits only") if subject == "film" else ("–", "–")


def _percent(value: float) -> str:
    return f"{100 * value:.3g} %"


_OF_RUNS = "Runs on {}"
_MARGINS: Mapping[str, _Kind] = {
    name: _Kind(group="Margins of {}", shown=shown, limit=limit)
    for name, shown, limit in (
        ("stability", _percent, "stable_share"),
        ("gain margin", lambda value: f"{value:.2f}", "gain"),
        ("phase margin", lambda value: f"{value:.0f}°", "phase_deg"),
        ("delay margin", lambda value: f"{value:.1f} samples", "delay_samples"),
        ("disk margin", lambda value: f"{value:.2f}", "disk"),
    )
}
_KINDS: Mapping[str, _Kind] = {
    **_MARGINS,
    "plant": _Kind(group=_OF_RUNS),
    "overshoot": _Kind(group=_OF_RUNS, shown=_percent, limit="overshoot"),
    "steady error": _Kind(group=_OF_RUNS, shown=_percent, limit="steady_error"),
    "ripple": _Kind(group=_OF_RUNS, shown=_percent, limit="ripple"),
    "saturation": _Kind(group=_OF_RUNS, shown=_percent, limit="saturated"),
    "tracking": _Kind(group=_OF_RUNS, shown=lambda value: f"{value:.2f} times", limit="tracking"),
    "gain margin on the plant": _Kind(group=_OF_RUNS, shown=lambda value: f"{value:.2g} times", limit="gain"),
    "model in closed loop": _Kind(group="Prediction", shown=_percent, limit="diverged"),
    "prediction": _Kind(group="Prediction", shown=_percent, limit="inside"),
    "film": _Kind(group="Film", shown=lambda value: f"{value:.0f} plants"),
    "limit cycle": _Kind(group="Limit cycles", shown=_percent, limit="limit_cycle"),
    "excitation": _Kind(group="Excitation", shown=lambda value: f"{value:.2f} Hz"),
    "model": _Kind(group="Design"),
    "design": _Kind(group="Design"),
}
