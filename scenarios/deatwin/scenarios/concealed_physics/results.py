"""Compare the result of each case with the concealed truth, decide what may be counted, and hold it against the stated goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.plant import DataError, effect_named
from deatwin.scenarios.concealed_physics.cases import TERM_NAMES
from deatwin.studies.rates import Rate, brier_score, expected_calibration_error, median_interval, reliability
from deatwin.studies.report.words import Words
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
    ratio: float  # Structural residual over noise
    verdict: str  # "error" if the case failed
    causes: tuple[str, ...]  # Effects that are built in, the one that explains most first
    answer: frozenset[str]  # Causes and set together
    detected: bool  # The verdict is that some physics is missing
    wrong_cause: bool  # Some cause is not right
    confidently_wrong: bool  # The verdict is named or partly, with a cause that is not right
    first_right: bool  # The first cause is right
    family_right: bool  # The first cause is of a right family
    inside: bool  # The answer holds a right name for every mechanism
    all_named: bool  # The causes hold a right name for every mechanism, and the verdict claims no more to be missing
    named_right: bool  # The verdict is named, with a right name for every mechanism and no other cause
    apart: float  # d² between the true effect and the best imitation of it, with the plant's own error; 0 if unknown
    apart_in_noise: float  # The same with the sensor's noise alone
    right_unknown: bool  # The verdict is `unknown`, or `disturbance` where the mechanism is random
    resolved: bool  # The advised experiment let the diagnosis name what is right, alone
    heavier: bool  # The advised experiment was diagnosed with a mass added and the tied effects as catalogue
    sparse_right: bool  # The strongest term of the sparse dynamics may stand for what is right
    errors: Mapping[str, float]  # Rms errors on the check record by who made them, SI; of those that could follow
    stated: tuple[tuple[float, bool], ...]  # Probability of each cause, and whether it is right
    covered: tuple[tuple[str, bool], ...]  # Parameters that have a true value, and whether their 95 % interval holds it
    advised: str  # What the advised experiment came to; empty where none was run
    again: bool  # It was diagnosed
    lost: frozenset[str]  # Models of the residual that diverged or failed


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened:
    """A study with its key and all finished cases."""

    cases: tuple[Case, ...]
    failures: Mapping[str, str]  # Messages of the cases that ended in an error
    seconds: tuple[float, ...]  # Processor time of each case
    planned: int  # Cases that the key has
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
    return Opened(
        cases=tuple(_case(spec, result, key["names"]) for spec, result in results),
        failures={spec["name"]: result["message"] for spec, result in results if result["status"] != "done"},
        seconds=tuple(float(result.get("seconds_in_all", 0.0)) for _, result in results),
        planned=len(key["cases"]),
        missing=tuple(missing),
    )


def _case(spec: Mapping[str, Any], result: Mapping[str, Any], names: Mapping[str, Any]) -> Case:
    diagnosis, again = result.get("diagnosis") or {}, result.get("advised") or {}
    stated, verdict = diagnosis.get("causes", ()), str(diagnosis.get("verdict", "error"))
    causes = tuple(cause["effect"] for cause in stated)
    answer = frozenset((*causes, *diagnosis.get("set", ())))
    accepted = [frozenset(names["key"].get(mechanism, ())) for mechanism in spec["effects"]]
    right: frozenset[str] = frozenset().union(*accepted)
    wrong = any(cause not in right for cause in causes)
    all_named = bool(accepted) and all(one & set(causes) for one in accepted) and verdict != "partly"
    apart = result.get("apart") or {}
    random = not set(spec["effects"]).isdisjoint(names["random"])
    later = {cause["effect"] for cause in again.get("causes", ())}
    baselines = result.get("baselines", {})
    errors = {**result.get("check", {}), **{name: made["rms"] for name, made in baselines.items()}}
    return Case(
        name=spec["name"],
        kind=spec["kind"],
        mechanisms=tuple(spec["effects"]),
        truth=tuple(spec["truth"]),
        rich=bool(spec["rich"]),
        ratio=float(result.get("ratio", spec["target_ratio"])),
        verdict=verdict,
        causes=causes,
        answer=answer,
        detected=verdict not in ("error", *CLEAN_VERDICTS),
        wrong_cause=wrong,
        confidently_wrong=verdict in ("named", "partly") and wrong,
        first_right=bool(causes) and causes[0] in right,
        family_right=bool(causes) and effect_named(causes[0]).family in {effect_named(name).family for name in right},
        inside=bool(accepted) and all(one & answer for one in accepted),
        all_named=all_named,
        named_right=verdict == "named" and all_named and not wrong,
        apart=float(apart.get("error", 0.0)),
        apart_in_noise=float(apart.get("noise", 0.0)),
        right_unknown=verdict == "unknown" or (random and verdict == "disturbance"),
        resolved=again.get("verdict") == "named" and bool(later) and later <= right,
        heavier="verdict" in again and (diagnosis.get("next_experiment") or {}).get("added_mass_g") is not None,
        sparse_right=bool(TERM_NAMES.get(baselines.get("pysindy", {}).get("term", ""), frozenset()) & right),
        errors={name: float(rms) for name, rms in errors.items() if rms is not None},
        stated=tuple((float(cause["probability"]), cause["effect"] in right) for cause in stated),
        covered=tuple((row["name"], row["low"] <= row["true"] <= row["high"]) for row in result.get("parameters", ())),
        advised=_advised(again),
        again="verdict" in again,
        lost=frozenset(name for name, made in baselines.items() if made["failure"]),
    )


def _advised(again: Mapping[str, Any]) -> str:
    if not again:
        return ""
    causes = " + ".join(cause["effect"] for cause in again.get("causes", ()))
    return again.get("failure") or ": ".join(filter(None, (again["verdict"], causes)))


WORDS = Words(__package__)
NO_CASE = "not tested (no such cases)"  # Reached by a goal for which nothing was run
STRONG, VERY_STRONG = 0.5, 1.0
"""Structural residual over noise from which on a name, and a prediction as good as the oracle's, can be demanded."""
LEAST_PARAMETERS = 300
DRAWS = 2000  # Perfect forecasters whose calibration errors are drawn
REPORTED = "reported"
Ends = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Goal:
    """A stated goal with the reached value."""

    measure: str
    demanded: str
    reached: str
    value: float | None  # Reached value; None where no case counts, as are the ends of its 95 % interval
    low: float | None
    high: float | None
    count: int  # Cases that count
    met: bool | None  # True if what is demanded is reached; None if nothing is demanded


def score(study: Opened) -> list[Goal]:
    """Compare the study with its goals."""
    clean, pairs, outside = study.of("clean"), study.of("pair"), study.of("outside", ratio=STRONG)
    inside, ties = study.of("effect", ratio=STRONG), study.of("tie", ratio=STRONG)
    far = [case for case in inside if case.apart >= FAR]
    far_in_noise = [case for case in inside if case.apart_in_noise >= FAR]
    detected = [case for case in study.of("effect", "tie", "pair") if case.detected]
    named = [case for case in study.of("effect", "pair") if case.verdict == "named"]
    tied = [case for case in study.of("tie") if case.verdict == "ambiguous"]
    answered = [case for case in study.cases if case.named_right or (case.kind == "clean" and not case.detected)]
    held = [each for case in answered for each in case.covered]
    rate = Rate.of(right for _, right in held)
    covers = rate.count >= LEAST_PARAMETERS and 0.92 <= rate.share <= 0.97
    return [
        _at_most("false_alarm", [bool(c.causes) for c in study.of("clean", "dirt")], 1),
        _at_least("cleared", [c.verdict in CLEAN_VERDICTS for c in clean], 0.95),
        _harm(study),
        _at_most("wrong", [c.confidently_wrong for c in detected], 1),
        _at_least("first_right", [c.first_right for c in far], 0.92),
        _rate("first_right_in_noise", REPORTED, [c.first_right for c in far_in_noise], None),
        _at_least("family_right", [c.family_right for c in far], 0.95),
        _at_least("inside", [c.inside for c in inside], 0.96),
        _mean("answer", [len(c.answer) for c in inside if c.rich and c.answer], 1.3),
        _at_least("outside_unknown", [c.right_unknown for c in outside], 0.88),
        _at_most("outside_named", [bool(c.causes) for c in outside], 1),
        _at_least("both", [c.all_named for c in pairs], 0.75),
        _at_least("no_wrong_of_two", [c.verdict != "error" and not c.wrong_cause for c in pairs], 0.92),
        _at_least("resolved", [c.resolved for c in tied], 0.8),
        _at_least("tie_inside", [c.inside for c in ties], 0.95),
        _median("gap_closed", gaps_closed(study), 0.95),
        _at_least("ahead", [_ahead(c) for c in named], 0.9),
        _points("beyond_sparse", inside, 0.3),
        _rate("covered", f"92 to 97 %, of at least {LEAST_PARAMETERS} intervals", [right for _, right in held], covers),
        _rate("effect_covered", REPORTED, [right for name, right in held if "." in name], None),
        *_calibration(study),
    ]


def sentence(study: Opened, goals: Sequence[Goal]) -> str:
    """Summarise the results in one sentence."""
    clean, concealed = study.of("clean"), study.of("effect", ratio=STRONG)
    demanding = [goal for goal in goals if goal.met is not None]
    return WORDS.text(
        "sentence",
        cases=len(study.cases),
        alarms=sum(bool(c.causes) for c in clean),
        clean=len(clean),
        first=sum(c.first_right for c in concealed),
        concealed=len(concealed),
        wrong=sum(c.confidently_wrong for c in study.of("effect", "tie", "pair")),
        met=sum(bool(goal.met) for goal in demanding),
        goals=len(demanding),
    )


def gaps_closed(study: Opened) -> list[float]:
    """Return how much of the oracle's gain over the base plant the diagnosis' plant reaches on the check record."""
    closed = []
    for case in study.of("effect", ratio=VERY_STRONG):
        base, oracle = case.errors.get("base"), case.errors.get("oracle")
        if case.verdict == "error":
            closed.append(0.0)
        elif base is not None and oracle is not None and oracle < base:
            closed.append((base - case.errors.get("diagnosis", base)) / (base - oracle))
    return closed


def _ahead(case: Case) -> bool:
    others = [case.errors[name] for name in ("pysindy", "gaussian_process", "narx") if name in case.errors]
    return "diagnosis" in case.errors and all(case.errors["diagnosis"] < error for error in others)


def _harm(study: Opened) -> Goal:
    """Return the error of the diagnosis' plant on clean check records, relative to the base plant."""
    errors = [case.errors for case in study.of("clean")]
    ratios = [e["diagnosis"] / e["base"] for e in errors if {"diagnosis", "base"} <= e.keys()]
    low, high = median_interval(ratios)
    middle = float(np.median(ratios)) if ratios else np.nan
    words = f"{middle:.4f} (95 % interval {low:.4f} to {high:.4f}), largest {max(ratios, default=np.nan):.3f}"
    return _goal("harm", "at most 1.005", words, (middle, low, high), len(ratios), middle <= 1.005)


def _calibration(study: Opened) -> tuple[Goal, Goal]:
    """Return the calibration error beside that of a forecaster who states the true probabilities, and Brier's score."""
    stated = [pair for case in study.cases for pair in case.stated]
    error, brier, rng = expected_calibration_error(reliability(stated)), brier_score(stated), np.random.default_rng(0)
    perfect = [
        expected_calibration_error(reliability([(p, bool(rng.random() < p)) for p, _ in stated])) for _ in range(DRAWS)
    ]
    limit = float(np.quantile(perfect, 0.95)) if stated else np.nan
    causes = f"({len(stated)} causes)"
    return (
        _goal(
            "calibration",
            f"at most {limit:.3f}",
            f"{error:.3f} {causes}",
            (error, np.nan, np.nan),
            len(stated),
            error <= limit,
        ),
        _goal("brier", "at most 0.09", f"{brier:.3f} {causes}", (brier, np.nan, np.nan), len(stated), brier <= 0.09),
    )


def _at_most(name: str, flags: Sequence[bool], most: int) -> Goal:
    return _rate(name, f"at most {most}", flags, bool(flags) and sum(flags) <= most, "at most")


def _at_least(name: str, flags: Sequence[bool], limit: float) -> Goal:
    met = bool(flags) and sum(flags) / len(flags) >= limit
    return _rate(name, f"at least {100 * limit:g} %", flags, met, "at least")


def _rate(name: str, demanded: str, flags: Sequence[bool], met: bool | None, side: str = "") -> Goal:
    rate = Rate.of(flags)
    if not rate.count:
        return _goal(name, demanded, "", (np.nan, np.nan, np.nan), 0, met)
    low, high = (0.0, rate.most) if side == "at most" else (rate.least, 1.0) if side else rate.interval
    one_sided = f"upper bound: {100 * high:.1f} %" if side == "at most" else f"lower bound: {100 * low:.1f} %"
    bound = one_sided if side else f"interval: {100 * low:.1f} to {100 * high:.1f} %"
    words = f"{rate.hits} of {rate.count}, {100 * rate.share:.1f} % (95 % {bound})"
    return _goal(name, demanded, words, (rate.share, low, high), rate.count, met)


def _mean(name: str, values: Sequence[float], limit: float) -> Goal:
    mean = float(np.mean(values)) if values else np.nan
    half = 1.96 * float(np.std(values)) / np.sqrt(len(values)) if values else np.nan
    words = f"{mean:.2f} ± {half:.2f} ({len(values)} cases)"
    return _goal(name, f"at most {limit:g}", words, (mean, mean - half, mean + half), len(values), mean <= limit)


def _median(name: str, values: Sequence[float], limit: float) -> Goal:
    middle = float(np.median(values)) if values else np.nan
    low, high = median_interval(values)
    words = f"{100 * middle:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f} %, {len(values)} cases)"
    return _goal(name, f"at least {100 * limit:g} %", words, (middle, low, high), len(values), middle >= limit)


def _points(name: str, cases: Sequence[Case], limit: float) -> Goal:
    """Return the difference of two rates on the same cases, with a conservative bound."""
    ours, theirs = Rate.of(c.first_right for c in cases), Rate.of(c.sparse_right for c in cases)
    demanded = f"at least {100 * limit:g} percentage points"
    if not cases:
        return _goal(name, demanded, "", (np.nan, np.nan, np.nan), 0, False)
    ahead, (our_low, our_high), (low, high) = ours.share - theirs.share, ours.interval, theirs.interval
    bound = f"true difference above {100 * (our_low - high):.1f}"
    words = f"{100 * ahead:.1f} percentage points ({ours.hits} and {theirs.hits} of {ours.count}; {bound})"
    return _goal(name, demanded, words, (ahead, our_low - high, our_high - low), ours.count, ahead >= limit)


def _goal(name: str, demanded: str, words: str, ends: Ends, count: int, met: bool | None) -> Goal:
    """Make a goal from numbers, which are None if no case counts."""
    value, low, high = ends if count else (None, None, None)
    return Goal(
        measure=WORDS.text(f"goal.{name}", strong=STRONG, far=FAR),
        demanded=demanded,
        reached=words if count else NO_CASE,
        value=value,
        low=low,
        high=high,
        count=count,
        met=None if met is None else bool(met) and count > 0,
    )
