"""Compare the answers with the key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Self

from deatwin.ident.mismatch import Diagnosis, Verdict
from deatwin.plant.records import plain
from deatwin.scenarios.unexplained_drift.sealed import Key
from deatwin.scenarios.unexplained_drift.study import Finding
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
OUTSIDE = frozenset({"grease_ridge"})
"""Concealed, but no effect of the catalogue, so that nobody could name it: a roughness of 20 s, no drift."""


class Mark(Enum):
    """Relation of an answer to the truth."""

    RIGHT = "right", "all drifts are named, and nothing else"
    PARTLY = "partly", "some drifts are named, and nothing else"
    IN_THE_SET = "in the set", "the diagnosis cannot decide, and all drifts are among its alternatives"
    OPEN = "left open", "nothing is claimed with confidence"
    WRONG = "wrong", "an absent effect is named"

    advice: str

    def __new__(cls, value: str, advice: str) -> Self:
        """Keep the meaning beside the word."""
        mark = object.__new__(cls)
        mark._value_, mark.advice = value, advice
        return mark


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An estimated parameter of a true cause, and its true value."""

    effect: str
    name: str
    unit: str
    value: float  # With its 95 % interval, SI
    low: float
    high: float
    truth: float  # SI

    @property
    def covered(self) -> bool:
        """True if the interval contains the true value."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """An answer with its mark."""

    name: str
    truth: Mapping[str, Mapping[str, float]]
    diagnosis: Diagnosis  # The answer
    mark: Mark
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
    """Compare answers with the opened key."""
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
    if diagnosis.verdict in (Verdict.NAMED, Verdict.PARTLY):
        if not causes <= set(truth):
            return Mark.WRONG
        return Mark.RIGHT if wanted <= causes and diagnosis.verdict is Verdict.NAMED else Mark.PARTLY
    if diagnosis.verdict is Verdict.AMBIGUOUS and wanted <= set(diagnosis.names):
        return Mark.IN_THE_SET
    return Mark.OPEN


def measures(scores: Sequence[Judged]) -> list[Measure]:
    """Compare the answers with their goals."""
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
        WORDS.measure("named", right == count, count=count, reached=right),
        WORDS.measure("wrong", not wrong, reached=wrong),
        WORDS.measure("inside", inside == count, count=count, reached=inside),
        WORDS.measure("better", better == len(claimed), count=len(claimed), reached=better),
        WORDS.measure("covered", covered >= allowed, allowed=allowed, count=len(estimates), reached=covered),
    ]
