"""The claims that are made for prestretch, each judged by what the sweep found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from deatwin.plant.material import material
from deatwin.studies.report.prose import notes

RELAXING = "VHB 4910 Wang 2016"
"""Film whose three branches are a whole published set; the plant's VHB 4905 has only the first of them."""


class Verdict(Enum):
    """Result of the simulations for a claim."""

    TRUE = "true"
    CONDITIONAL = "conditional"
    FALSE = "false"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim, its verdict, and the numbers behind it."""

    claim: str
    verdict: Verdict
    finding: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Results of the simulations over the prestretch."""

    columns: Mapping[str, np.ndarray]  # shape (n,): by prestretch; NaN where there is no such thing
    ratios: Mapping[str, np.ndarray]  # shape (m,): for unequal prestretch, at one thickness
    pull_in_end: float  # Prestretch from which on a film under dead load no longer pulls in

    @property
    def stretch(self) -> np.ndarray:
        """The prestretches, shape (n,)."""
        return self.columns["prestretch"]

    def at(self, name: str, prestretch: float) -> float:
        """A column's value at a prestretch."""
        return float(np.interp(prestretch, self.stretch, self.columns[name]))

    def best(self, name: str) -> tuple[float, float]:
        """Prestretch at which a column is largest, and its value there."""
        most = int(np.nanargmax(self.columns[name]))
        return float(self.stretch[most]), float(self.columns[name][most])

    def rises(self, values: np.ndarray) -> Verdict:
        """Return whether values rise with the prestretch, shape (n,)."""
        steps = np.diff(values[np.isfinite(values)])
        return Verdict.TRUE if np.all(steps > 0) else Verdict.CONDITIONAL if np.any(steps > 0) else Verdict.FALSE


def judged_claims(s: Sweep) -> tuple[Claim, ...]:
    """Judge all claims; the words stand in a template, in the same order."""
    columns, needed, prompt = s.columns, s.columns["voltage_for_5_percent_V"], s.columns["prompt_share"]
    gain = columns["strain_at_1kV"] / s.stretch**4  # at one true field: the thickness goes with 1/stretch²
    cheapest, slowest = int(np.argmin(needed)), int(np.argmin(prompt))
    along, across = s.ratios["strain_along"], s.ratios["strain_across"]
    verdicts = (
        s.rises(columns["strain_at_1kV"]),
        s.rises(-needed),
        s.rises(columns["breakdown_field_MV_m"]),
        s.rises(columns["breakdown_voltage_as_mounted_V"]),
        _suppressed(np.isfinite(columns["pull_in_V"])),
        s.rises(columns["largest_strain"]),
        s.rises(prompt),
        s.rises(along / across),
        _certain(columns["slack_V"][0] == 0 and np.all(columns["slack_V"][1:] > 0)),
        _certain(np.nanmin(columns["tension_lost"]) > 0),
        s.rises(columns["ball_at_2kV_mm"]),
    )
    findings = notes(
        __package__,
        "claims.md.j2",
        s=s,
        less=gain[0] / np.interp(3.5, s.stretch, gain),
        needed=needed,
        cheapest=cheapest,
        prompt=prompt,
        slowest=slowest,
        faster=np.interp(prompt[0], prompt[slowest:], s.stretch[slowest:]),
        along=along,
        across=across,
        relaxed=3 * max(branch.time.value for branch in material(RELAXING).branches),
    )
    return tuple(
        Claim(claim=note.title, verdict=verdict, finding=note.paragraphs[0])
        for note, verdict in zip(findings, verdicts, strict=True)
    )


def _suppressed(pulls_in: np.ndarray) -> Verdict:
    return Verdict.FALSE if pulls_in.all() else Verdict.CONDITIONAL if pulls_in.any() else Verdict.TRUE


def _certain(holds: bool | np.bool_) -> Verdict:
    return Verdict.TRUE if holds else Verdict.FALSE
