"""Compare the result of each case with the concealed truth, and decide what may be counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deatwin.plant import DataError, effect_named
from deatwin.scenarios.concealed_physics.key import TERM_NAMES
from deatwin.studies.sweep.seal import digest
from deatwin.studies.sweep.store import CaseStore

FAR = 16.0  # Distance d² from which on two explanations can be told apart
CLEAN_VERDICTS = frozenset({"none", "parameters"})


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A case with its truth; a failed case has no causes, and its ratio is the intended one."""

    name: str
    kind: str
    mechanisms: tuple[str, ...]  # Concealed mechanisms
    truth: tuple[str, ...]  # The name under which each mechanism of the catalogue is counted
    rich: bool  # True if the input distinguishes mechanisms
    failed: bool
    ratio: float  # Structural residual over noise
    verdict: str  # ``error`` if the case failed
    causes: tuple[str, ...]  # Effects that are built in, the one that explains most first
    answer: frozenset[str]  # Causes and set together
    cleared: bool  # The verdict is that no physics is missing
    detected: bool  # The verdict is that some is
    wrong_cause: bool  # Some cause is not right
    confidently_wrong: bool  # The verdict is named or partly, with a cause that is not right
    first_right: bool  # The first cause is right
    family_right: bool  # The first cause is of a right family
    inside: bool  # The answer holds a right name for every mechanism
    all_named: bool  # The causes hold a right name for every mechanism, and the verdict claims no more to be missing
    named_right: bool  # The verdict is named, with a right name for every mechanism and no other cause
    nearest: float  # Distance d² to the nearest rival that the diagnosis states; infinite where it states none
    resolved: bool  # The advised experiment let the diagnosis name what is right, alone
    heavier: bool  # The advised experiment was diagnosed with a mass added and the tied effects as catalogue
    sparse_right: bool  # The strongest term of the sparse dynamics may stand for what is right
    errors: Mapping[str, float]  # Rms errors on the check record by who made them, SI; of those that could follow
    stated: tuple[tuple[float, bool], ...]  # Probability of each cause, and whether it is right
    covered: tuple[bool, ...]  # Whether the 95 % interval of each parameter that has a true value holds it
    advised: str  # What the advised experiment came to; empty where none was run
    again: bool  # It was diagnosed
    sparse_term: str  # The strongest term of the sparse dynamics
    lost: frozenset[str]  # Models of the residual that diverged or failed
    seconds: float | None  # Processor time


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened:
    """A study with its key and all finished cases."""

    cases: tuple[Case, ...]
    intervals: tuple[bool, ...]  # Whether each interval of the fits holds the true value
    failures: Mapping[str, str]  # Messages of the cases and fits that ended in an error
    seconds: tuple[float, ...]  # Processor time of each case
    planned: int  # Cases and fits that the key has
    missing: tuple[str, ...]  # Those of them that have not been run

    def of(self, *kinds: str, ratio: float = 0.0) -> list[Case]:
        """Return the cases of some kinds."""
        return [case for case in self.cases if case.kind in kinds and case.ratio >= ratio]


def open_key(store: CaseStore, key: Mapping[str, Any]) -> Opened:
    """Put the concealed effects beside the results that there are."""
    if digest(key) != (sealed := str(store.seal.parts["key"])):
        raise DataError(
            f"the key (hash {digest(key)[:12]}) is not the one that was sealed ({sealed[:12]}): "
            "labels must not change once a study has begun"
        )
    missing = store.missing([spec["name"] for spec in key["cases"]])
    results = [(spec, store.get(spec["name"])) for spec in key["cases"] if spec["name"] not in set(missing)]
    cases = [(spec, result) for spec, result in results if spec["kind"] != "interval"]
    fits = [result for spec, result in results if spec["kind"] == "interval"]
    return Opened(
        cases=tuple(_case(spec, result, key["names"]["key"]) for spec, result in cases),
        intervals=tuple(held for result in fits for held in _covered(result)),
        failures={spec["name"]: result["message"] for spec, result in results if result["status"] != "done"},
        seconds=tuple(float(result.get("seconds_in_all", 0.0)) for _, result in cases),
        planned=len(key["cases"]),
        missing=tuple(missing),
    )


def _case(spec: Mapping[str, Any], result: Mapping[str, Any], names: Mapping[str, Sequence[str]]) -> Case:
    diagnosis, again = result.get("diagnosis") or {}, result.get("advised") or {}
    stated, verdict = diagnosis.get("causes", ()), str(diagnosis.get("verdict", "error"))
    causes = tuple(cause["effect"] for cause in stated)
    answer = frozenset((*causes, *diagnosis.get("set", ())))
    accepted = [frozenset(names.get(mechanism, ())) for mechanism in spec["effects"]]
    right: frozenset[str] = frozenset().union(*accepted)
    failed, cleared = result["status"] != "done", verdict in CLEAN_VERDICTS
    wrong = any(cause not in right for cause in causes)
    all_named = bool(accepted) and all(one & set(causes) for one in accepted) and verdict != "partly"
    near = (float(pair["d2"]) for pair in diagnosis.get("indistinguishable", ()) if pair["d2"] is not None)
    later = {cause["effect"] for cause in again.get("causes", ())}
    baselines = result.get("baselines", {})
    errors = {**result.get("check", {}), **{name: made["rms"] for name, made in baselines.items()}}
    return Case(
        name=spec["name"],
        kind=spec["kind"],
        mechanisms=tuple(spec["effects"]),
        truth=tuple(spec["truth"]),
        rich=bool(spec["rich"]),
        failed=failed,
        ratio=float(result.get("ratio", spec["target_ratio"])),
        verdict=verdict,
        causes=causes,
        answer=answer,
        cleared=cleared,
        detected=not failed and not cleared,
        wrong_cause=wrong,
        confidently_wrong=verdict in ("named", "partly") and wrong,
        first_right=bool(causes) and causes[0] in right,
        family_right=bool(causes) and _family(causes[0]) in set(map(_family, right)),
        inside=bool(accepted) and all(one & answer for one in accepted),
        all_named=all_named,
        named_right=verdict == "named" and all_named and not wrong,
        nearest=min(near, default=float("inf")),
        resolved=again.get("verdict") == "named" and bool(later) and later <= right,
        heavier="verdict" in again and (diagnosis.get("next_experiment") or {}).get("added_mass_g") is not None,
        sparse_right=bool(TERM_NAMES.get(baselines.get("pysindy", {}).get("term", ""), frozenset()) & right),
        errors={name: float(rms) for name, rms in errors.items() if rms is not None},
        stated=tuple((float(cause["probability"]), cause["effect"] in right) for cause in stated),
        covered=_covered(result),
        advised=_advised(again),
        again="verdict" in again,
        sparse_term=baselines.get("pysindy", {}).get("term", ""),
        lost=frozenset(name for name, made in baselines.items() if made["failure"]),
        seconds=result.get("seconds_in_all"),
    )


def _covered(result: Mapping[str, Any]) -> tuple[bool, ...]:
    """Return whether the interval of each parameter that has a true value holds it."""
    return tuple(row["low"] <= row["true"] <= row["high"] for row in result.get("parameters", ()))


def _advised(again: Mapping[str, Any]) -> str:
    if not again:
        return ""
    causes = " + ".join(cause["effect"] for cause in again.get("causes", ()))
    return again.get("failure") or f"{again['verdict']}: {causes}"


def _family(effect: str) -> str:
    return effect_named(effect).family.value
