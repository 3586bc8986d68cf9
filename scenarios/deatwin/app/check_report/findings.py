"""The table of findings: each number with its limit, in groups."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite

from deatwin.app.check_report.view import View
from deatwin.control.checking.amounts import amount
from deatwin.control.checking.specification import Limit, Verdict
from deatwin.control.checking.verdict import Finding

TONES = {Verdict.PASS: "good", Verdict.MARGINAL: "doubt", Verdict.FAIL: "bad"}  # Classes of the page's style


@dataclass(frozen=True, kw_only=True)
class Row:
    """A line of the table."""

    subject: str
    value: str
    good: str
    poor: str
    verdict: str
    tone: str
    text: str


@dataclass(frozen=True, kw_only=True)
class Group:
    """Lines of the table that belong together."""

    title: str  # Heading
    rows: list[Row]


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """Format of the findings on one quantity."""

    group: str  # Heading, in which ``{}`` stands for the source
    form: str = ".3g"  # Format of a number, and its unit with the space before it
    unit: str = ""
    scale: float = 1.0
    limit: str = ""  # Field of the specification; empty if there is none

    def value(self, value: float | None) -> str:
        """Write the value of a finding."""
        if value is None:
            return "–"
        return amount(self.scale * value, self.form, self.unit) if isfinite(value) else "∞"

    def asked(self, value: float) -> str:
        """Write a limit, whatever its size."""
        return f"{self.scale * value:{self.form}}{self.unit}"


def groups(view: View) -> list[Group]:
    """Arrange the findings of a check in groups."""
    found: dict[str, list[Row]] = {}
    for finding in view.check.findings:
        subject, source = _split(finding.subject, view)
        kind = _KINDS.get(subject, _Kind(group="Further findings"))
        found.setdefault(kind.group.format(_whose(source, view)), []).append(_row(finding, subject, kind, view))
    return [Group(title=title, rows=rows) for title, rows in found.items()]


def _split(subject: str, view: View) -> tuple[str, str]:
    """Split a finding's subject into its name and its source; the model and the plant model need no brackets."""
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
        subject=subject,
        value=kind.value(finding.value),
        good=good,
        poor=poor,
        verdict=finding.verdict.value,
        tone=TONES[finding.verdict],
        text=finding.text,
    )


def _limits(finding: Finding, subject: str, kind: _Kind, view: View) -> tuple[str, str]:
    """Write the limits for a pass and for marginal."""
    if kind.limit:
        limit: Limit = getattr(view.specification.on_a_stand_in, kind.limit)
        sign = "≥" if limit.good > limit.poor else "≤"
        return f"{sign} {kind.asked(limit.good)}", f"{sign} {kind.asked(limit.poor)}"
    if subject == "excitation" and view.check.excited_band_Hz is not None:
        band = view.check.excited_band_Hz
        if finding.verdict is Verdict.MARGINAL and finding.value is not None and finding.value <= band:
            return "in no gap", "in a gap"
        return f"≤ {kind.asked(band)}", "beyond"
    return ("none", "only at the limits") if subject == "film" else ("–", "–")


_percent = partial(_Kind, unit=" %", scale=100.0)
_OF_RUNS = "Simulation with {}"
_MARGINS: Mapping[str, _Kind] = {
    name: _Kind(group="Margins of {}", form=form, unit=unit, scale=scale, limit=limit)
    for name, form, unit, scale, limit in (
        ("stability", ".3g", " %", 100.0, "stable_share"),
        ("gain margin", ".2f", "", 1.0, "gain"),
        ("phase margin", ".0f", "°", 1.0, "phase_deg"),
        ("delay margin", ".1f", " samples", 1.0, "delay_samples"),
        ("disk margin", ".2f", "", 1.0, "disk"),
    )
}
_KINDS: Mapping[str, _Kind] = {
    **_MARGINS,
    "plant": _Kind(group=_OF_RUNS),
    "overshoot": _percent(group=_OF_RUNS, limit="overshoot"),
    "steady-state error": _percent(group=_OF_RUNS, limit="steady_error"),
    "ripple": _percent(group=_OF_RUNS, limit="ripple"),
    "saturation": _percent(group=_OF_RUNS, limit="saturated"),
    "tracking": _Kind(group=_OF_RUNS, form=".2f", unit=" times", limit="tracking"),
    "gain margin on the plant": _Kind(group=_OF_RUNS, form=".2g", unit=" times", limit="gain"),
    "model in closed loop": _percent(group="Prediction", limit="diverged"),
    "prediction": _percent(group="Prediction", limit="inside"),
    "film": _Kind(group="Film", form=".0f", unit=" actuators"),
    "limit cycle": _percent(group="Limit cycles", limit="limit_cycle"),
    "unstable limit cycle": _percent(group="Limit cycles", limit="safe_region"),
    "excitation": _Kind(group="Excitation", form=".2f", unit=" Hz"),
    "model": _Kind(group="Design"),
    "design": _Kind(group="Design"),
}
