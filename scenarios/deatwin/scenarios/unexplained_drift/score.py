"""Answers held against the key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from deatwin.ident.mismatch import Diagnosis, Verdict
from deatwin.plant.records import plain
from deatwin.scenarios.unexplained_drift.examine import Finding
from deatwin.scenarios.unexplained_drift.sealed import Key
from deatwin.studies.report.story import Row

OUTSIDE = frozenset({"grease_ridge"})
"""What is concealed but no effect of the catalogue, so that nobody could name it: a roughness of 20 s, no drift."""


class Mark(Enum):
    """How an answer stands to the truth."""

    RIGHT = "right"
    PARTLY = "partly"
    IN_THE_SET = "in the set"
    OPEN = "left open"
    WRONG = "wrong"

    @property
    def advice(self) -> str:
        """What the mark means."""
        return _ADVICE[self]


_ADVICE: Mapping[Mark, str] = {
    Mark.RIGHT: "all that drifts is named, and nothing else",
    Mark.PARTLY: "some of what drifts is named, and nothing else",
    Mark.IN_THE_SET: "the diagnosis says that it cannot decide, and all that drifts is among what it lists",
    Mark.OPEN: "nothing is claimed with confidence",
    Mark.WRONG: "named with confidence what is not there",
}


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A parameter of a cause that is there, beside its true value."""

    effect: str
    name: str
    unit: str
    value: float  # With its 95 % interval, SI
    low: float
    high: float
    truth: float  # SI

    @property
    def covered(self) -> bool:
        """Whether the interval holds the truth."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """An answer with its mark."""

    name: str
    truth: Mapping[str, Mapping[str, float]]
    diagnosis: Diagnosis  # The answer
    mark: Mark  # How it stands to the truth
    estimates: tuple[Estimate, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the story's file."""
        return {
            "actuator": self.name,
            "concealed": {e: dict(p) for e, p in self.truth.items()},
            "verdict": self.diagnosis.verdict.value,
            "causes": [c.effect for c in self.diagnosis.causes],
            "set": list(self.diagnosis.names),
            "mark": self.mark.value,
            "fit": plain(self.diagnosis.fit),
            "estimates": [vars(e) | {"covered": e.covered} for e in self.estimates],
        }


def judged(findings: Sequence[Finding], key: Key) -> tuple[Judged, ...]:
    """Hold answers against the opened key."""
    return tuple(_judge(f.name, f.diagnosis, key.drifts[f.name]) for f in findings)


def _judge(name: str, diagnosis: Diagnosis, truth: Mapping[str, Mapping[str, float]]) -> Judged:
    estimates = tuple(
        Estimate(effect=c.effect, name=n, unit=p.unit, value=p.value, low=p.low, high=p.high, truth=truth[c.effect][n])
        for c in diagnosis.causes
        if c.effect in truth
        for n, p in c.parameters.items()
    )
    return Judged(name=name, truth=truth, diagnosis=diagnosis, mark=_mark(diagnosis, truth), estimates=estimates)


def _mark(diagnosis: Diagnosis, truth: Mapping[str, Any]) -> Mark:
    causes, wanted = {c.effect for c in diagnosis.causes}, set(truth) - OUTSIDE
    if diagnosis.verdict is Verdict.NAMED:
        if not causes <= set(truth):
            return Mark.WRONG
        return Mark.RIGHT if wanted <= causes else Mark.PARTLY
    if diagnosis.verdict is Verdict.AMBIGUOUS and wanted <= set(diagnosis.names):
        return Mark.IN_THE_SET
    return Mark.OPEN


def measures(scores: Sequence[Judged]) -> list[Row]:
    """What is demanded of the answers, and what they reach."""
    from scipy.stats import binom

    count = len(scores)
    right = sum(s.mark is Mark.RIGHT for s in scores)
    wrong = sum(s.mark is Mark.WRONG for s in scores)
    offered = [{*s.diagnosis.names, *(c.effect for c in s.diagnosis.causes)} for s in scores]
    inside = sum(set(s.truth) - OUTSIDE <= names for s, names in zip(scores, offered, strict=True))
    unseen = [score.diagnosis.fit.unseen for score in scores]
    claimed = [(errors.before, errors.after) for errors in unseen if errors.after is not None]
    better = sum(after < before for before, after in claimed)
    estimates = [e for s in scores if s.mark is Mark.RIGHT for e in s.estimates]
    covered = sum(e.covered for e in estimates)
    allowed = int(binom.ppf(0.025, len(estimates), 0.95)) if estimates else 0
    return [
        Row(
            measure="All that drifts is named, and nothing else",
            demanded=f"{count} of {count}",
            reached=f"{right} of {count}",
            passed=right == count,
        ),
        Row(measure="Named with confidence what is not there", demanded="0", reached=str(wrong), passed=not wrong),
        Row(
            measure="All that drifts is among what is named or listed",
            demanded=f"{count} of {count}",
            reached=f"{inside} of {count}",
            passed=inside == count,
        ),
        Row(
            measure="Where something is built in, the error on unseen data falls",
            demanded=f"{len(claimed)} of {len(claimed)}",
            reached=str(better),
            passed=better == len(claimed),
        ),
        Row(
            measure="Intervals of rightly named drifts that hold the truth",
            demanded=f"at least {allowed} of {len(estimates)} (95 % each)",
            reached=str(covered),
            passed=covered >= allowed,
        ),
    ]
