"""The key is opened: each case beside what was concealed in it, and what may be counted of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.errors import DataError
from deatwin.scenarios.concealed_physics.baselines import TERM_NAMES
from deatwin.scenarios.concealed_physics.store import Store
from deatwin.studies.sweep.seal import digest

FAR = 16.0
"""Distance d² from which on two explanations can be told apart."""
CLEAN_VERDICTS = frozenset({"none", "parameters"})


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A case with its truth."""

    name: str
    kind: str
    mechanisms: tuple[str, ...]  # What was concealed
    accepted: tuple[frozenset[str], ...]
    truth: tuple[str, ...]  # The name under which each mechanism of the catalogue is counted
    rich: bool  # Whether the input tells mechanisms apart
    target_ratio: float  # Structural residual over noise that was aimed at
    result: Mapping[str, Any]  # What was written of the case

    @property
    def failed(self) -> bool:
        """Whether it ended in an error."""
        return bool(self.result["status"] != "done")

    @property
    def ratio(self) -> float:
        """Structural residual over noise, as it was; what was aimed at where the case failed."""
        return float(self.result.get("ratio", self.target_ratio))

    @property
    def diagnosis(self) -> Mapping[str, Any]:
        """The diagnosis; without content where the case failed."""
        return self.result.get("diagnosis") or {}

    @property
    def verdict(self) -> str:
        """The verdict, or ``error``."""
        return str(self.diagnosis.get("verdict", "error"))

    @property
    def causes(self) -> tuple[str, ...]:
        """Effects that are built in, the one that explains most first."""
        return tuple(cause["effect"] for cause in self.diagnosis.get("causes", ()))

    @property
    def answer(self) -> frozenset[str]:
        """Causes and set together."""
        return frozenset((*self.causes, *self.diagnosis.get("set", ())))

    @property
    def cleared(self) -> bool:
        """Whether the verdict is that no physics is missing."""
        return self.verdict in CLEAN_VERDICTS

    @property
    def detected(self) -> bool:
        """Whether it is that something is."""
        return not self.failed and not self.cleared

    @property
    def right(self) -> frozenset[str]:
        """All names that are right."""
        return frozenset().union(*self.accepted)

    @property
    def wrong_cause(self) -> bool:
        """Whether any cause is not right."""
        return any(cause not in self.right for cause in self.causes)

    @property
    def confidently_wrong(self) -> bool:
        """Whether a cause that is not right stands alone."""
        return self.verdict == "named" and self.wrong_cause

    @property
    def first_right(self) -> bool:
        """Whether the first cause is right."""
        return bool(self.causes) and self.causes[0] in self.right

    @property
    def family_right(self) -> bool:
        """Whether the first cause is of a right family."""
        return bool(self.causes) and _family(self.causes[0]) in {_family(name) for name in self.right}

    @property
    def inside(self) -> bool:
        """Whether the answer holds a right name for every mechanism."""
        return bool(self.accepted) and all(names & self.answer for names in self.accepted)

    @property
    def all_named(self) -> bool:
        """Whether the causes hold a right name for every mechanism."""
        return bool(self.accepted) and all(names & set(self.causes) for names in self.accepted)

    @property
    def named_right(self) -> bool:
        """Whether the verdict is named, with a right name for every mechanism and no other cause."""
        return self.verdict == "named" and self.all_named and not self.wrong_cause

    @property
    def nearest(self) -> float:
        """Distance d² to the nearest rival that the diagnosis states; infinite where it states none."""
        stated = self.diagnosis.get("indistinguishable", ())
        return min((float(pair["d2"]) for pair in stated if pair["d2"] is not None), default=float("inf"))

    @property
    def resolved(self) -> bool:
        """Whether the advised experiment let the diagnosis name what is right, alone."""
        again = self.result.get("advised") or {}
        names = {cause["effect"] for cause in again.get("causes", ())}
        return again.get("verdict") == "named" and bool(names) and names <= self.right

    @property
    def heavier(self) -> bool:
        """Whether the advised experiment, with a mass added, was diagnosed: with the tied effects as catalogue."""
        again = self.result.get("advised") or {}
        advice = self.diagnosis.get("next_experiment") or {}
        return "verdict" in again and advice.get("added_mass_g") is not None

    @property
    def sparse_right(self) -> bool:
        """Whether the strongest term of the sparse dynamics may stand for what is right."""
        term = self.result.get("baselines", {}).get("pysindy", {}).get("term", "")
        return bool(TERM_NAMES.get(term, frozenset()) & self.right)

    @cached_property
    def errors(self) -> dict[str, float]:
        """Rms errors on the check record by who made them, SI; those that could follow."""
        found = {**self.result.get("check", {})}
        found |= {name: made["rms"] for name, made in self.result.get("baselines", {}).items()}
        return {name: float(rms) for name, rms in found.items() if rms is not None}

    @property
    def stated(self) -> list[tuple[float, bool]]:
        """Each cause's probability, and whether it is right."""
        return [(float(c["probability"]), c["effect"] in self.right) for c in self.diagnosis.get("causes", ())]


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened:
    """A study with its key: all that has been run of it."""

    cases: tuple[Case, ...]
    intervals: tuple[Mapping[str, Any], ...]
    failures: Mapping[str, str]  # Messages of the cases and fits that ended in an error
    seconds: tuple[float, ...]  # Processor time of each case
    planned: int  # How many cases and fits the key has
    missing: tuple[str, ...]  # Those of them that have not been run

    def of(self, *kinds: str, ratio: float = 0.0) -> list[Case]:
        """The cases of some kinds."""
        return [case for case in self.cases if case.kind in kinds and case.ratio >= ratio]


def open_key(store: Store, key: Mapping[str, Any]) -> Opened:
    """Put the truth beside the results of a study that is through."""
    study = open_part(store, key)
    if study.missing:
        raise DataError(f"{len(study.missing)} cases have not been run, {study.missing[0]} first: go on with the study")
    return study


def open_part(store: Store, key: Mapping[str, Any]) -> Opened:
    """Put the truth beside the results that there are."""
    if digest(key) != store.seal.key:
        raise DataError(
            f"the key (hash {digest(key)[:12]}) is not the one that was sealed ({store.seal.key[:12]}): "
            "labels must not change once a study has begun"
        )
    missing = tuple(store.missing([spec["name"] for spec in key["cases"]]))
    absent = frozenset(missing)
    results = [(spec, store.get(spec["name"])) for spec in key["cases"] if spec["name"] not in absent]
    names = key["names"]["key"]
    return Opened(
        cases=tuple(_case(spec, result, names) for spec, result in results if spec["kind"] != "interval"),
        intervals=tuple(
            row for spec, result in results if spec["kind"] == "interval" for row in result.get("parameters", ())
        ),
        failures={spec["name"]: result["message"] for spec, result in results if result["status"] != "done"},
        seconds=tuple(
            float(result.get("seconds_in_all", 0.0)) for spec, result in results if spec["kind"] != "interval"
        ),
        planned=len(key["cases"]),
        missing=missing,
    )


def _case(spec: Mapping[str, Any], result: Mapping[str, Any], names: Mapping[str, Sequence[str]]) -> Case:
    return Case(
        name=spec["name"],
        kind=spec["kind"],
        mechanisms=tuple(spec["effects"]),
        truth=tuple(spec["truth"]),
        accepted=tuple(frozenset(names.get(mechanism, ())) for mechanism in spec["effects"]),
        rich=bool(spec["rich"]),
        target_ratio=float(spec["target_ratio"]),
        result=result,
    )


def _family(effect: str) -> str:
    return effect_named(effect).family.value
