"""The stated goals: what is demanded, what was reached, with its bound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.scenarios.concealed_physics.opened import FAR, Case, Opened
from deatwin.scenarios.concealed_physics.rates import (
    bounds,
    brier_score,
    expected_calibration_error,
    least,
    median_interval,
    most,
    reliability,
)
from deatwin.scenarios.svb_benchmark.trials import Rate
from deatwin.studies.report.story import Row

NO_CASE = "no case"
"""What a goal reaches for which nothing was run."""

STRONG, VERY_STRONG = 0.5, 1.0
"""Structural residual over noise from which on a name, and a prediction as good as the oracle's, can be demanded."""
LEAST_PARAMETERS = 300
REPORTED = "reported"


@dataclass(frozen=True, kw_only=True)
class Goal:
    """A stated measure."""

    measure: str
    demanded: str
    reached: str
    value: float | None  # What was reached, and the ends of its 95 % interval; None where no case counts
    low: float | None
    high: float | None
    count: int  # Cases that count
    met: bool | None  # Whether what is demanded is reached; not where no case counts

    @property
    def outcome(self) -> str:
        """In a word: ``yes``, ``no``, or ``reported`` where nothing is demanded."""
        return REPORTED if self.met is None else "yes" if self.met else "no"

    @property
    def row(self) -> Row:
        """For the page; of a goal that demands something."""
        return Row(measure=self.measure, demanded=self.demanded, reached=self.reached, passed=bool(self.met))


def score(study: Opened) -> list[Goal]:
    """Hold the study against its goals."""
    return [*_clean(study), *_names(study), *_others(study), *_predictions(study), *_certainty(study)]


def sentence(study: Opened, goals: Sequence[Goal]) -> str:
    """What came out, in a line."""
    clean, concealed = study.of("clean"), study.of("effect", ratio=STRONG)
    alarms = sum(bool(case.causes) for case in clean)
    wrong = sum(case.confidently_wrong for case in study.of("effect", "tie", "pair"))
    named = sum(case.first_right for case in concealed)
    demanding = [goal for goal in goals if goal.met is not None]
    met = sum(bool(goal.met) for goal in demanding)
    return (
        f"In {len(study.cases)} sealed cases: {alarms} of {len(clean)} clean ones with a cause named; of "
        f"{len(concealed)} with a concealed effect that is at least half the noise, {named} have it as first cause; "
        f"{wrong} confident wrong names; {met} of {len(demanding)} goals are met."
    )


def _clean(study: Opened) -> list[Goal]:
    clean = study.of("clean")
    alarms = Rate.of(bool(case.causes) for case in clean)
    return [
        _at_most("false alarm: a cause named on clean data", alarms, 1 / 150, "0 of 150, at most 1"),
        _at_least("clean data called none or parameters", [c.cleared for c in clean], 0.95),
        _harm(study),
    ]


def _names(study: Opened) -> list[Goal]:
    inside = study.of("effect", ratio=STRONG)
    far = [case for case in inside if case.nearest >= FAR]
    detected = [case for case in study.of("effect", "tie", "pair") if case.detected]
    wrong = Rate.of(case.confidently_wrong for case in detected)
    sizes = [len(case.answer) for case in inside if case.rich and case.answer]
    return [
        _at_most("confident wrong name, in the catalogue, detected", wrong, 0.01, "at most 1 %"),
        _at_least(
            f"first cause right, ratio {STRONG} or more and d² to the nearest rival {FAR:g} or more",
            [c.first_right for c in far],
            0.9,
        ),
        _at_least("the same, its family right", [c.family_right for c in far], 0.95),
        _at_least(f"truth inside the answer, ratio {STRONG} or more", [c.inside for c in inside], 0.95),
        _mean("mean size of the set, rich input", sizes, 1.3),
    ]


def _others(study: Opened) -> list[Goal]:
    outside, pairs = study.of("outside", ratio=STRONG), study.of("pair")
    misnamed = Rate.of(bool(case.causes) for case in outside)
    visible = study.of("tie", ratio=STRONG)
    advised = [case for case in study.of("tie") if case.verdict == "ambiguous"]
    return [
        _at_least(
            f"outside the catalogue, ratio {STRONG} or more: unknown", [c.verdict == "unknown" for c in outside], 0.9
        ),
        _at_most("the same: a cause named", misnamed, 0.05, "at most 5 %"),
        _at_least("two effects: both named", [c.all_named for c in pairs], 0.7),
        _at_least("two effects: no cause is wrong", [not c.failed and not c.wrong_cause for c in pairs], 0.9),
        _at_least(
            "ties that were called ambiguous, resolved by the advised experiment", [c.resolved for c in advised], 0.9
        ),
        _at_least(
            f"all ties, ratio {STRONG} or more: resolved so, or named rightly at once",
            [c.resolved or c.named_right for c in visible],
            0.9,
        ),
        _at_least(f"ties, ratio {STRONG} or more: truth inside the answer", [c.inside for c in visible], 0.95),
    ]


def gaps_closed(study: Opened) -> list[float]:
    """Share of the way from the base plant to the oracle that the diagnosis' plant goes on the check record."""
    closed = []
    for case in study.of("effect", ratio=VERY_STRONG):
        base, oracle = case.errors.get("base"), case.errors.get("oracle")
        if case.failed:
            closed.append(0.0)
        elif base is not None and oracle is not None and oracle < base:
            closed.append((base - case.errors.get("diagnosis", base)) / (base - oracle))
    return closed


def harm(study: Opened) -> list[float]:
    """Error on the check record with the diagnosis' plant over that with the base plant, of each clean case."""
    clean = [case.errors for case in study.of("clean")]
    return [errors["diagnosis"] / errors["base"] for errors in clean if {"diagnosis", "base"} <= errors.keys()]


def _predictions(study: Opened) -> list[Goal]:
    closed = gaps_closed(study)
    named = [case for case in study.of("effect", "pair") if case.verdict == "named"]
    ahead = [_ahead(case) for case in named]
    inside = study.of("effect", ratio=STRONG)
    ours, theirs = (Rate.of(flags) for flags in ([c.first_right for c in inside], [c.sparse_right for c in inside]))
    return [
        _median("gap to the oracle closed on unseen data, ratio 1 or more, median", closed, 0.95),
        _at_least("error on unseen data ahead of every baseline, named cases", ahead, 0.9),
        _points("naming ahead of the sparse dynamics (pysindy)", ours, theirs, 0.3),
    ]


def _ahead(case: Case) -> bool:
    others = [case.errors[name] for name in ("pysindy", "gaussian_process", "narx") if name in case.errors]
    return "diagnosis" in case.errors and all(case.errors["diagnosis"] < error for error in others)


def _certainty(study: Opened) -> list[Goal]:
    rows = study.intervals
    held = Rate.of(row["low"] <= row["true"] <= row["high"] for row in rows)
    fine = Rate.of(
        row["low"] <= row["true"] <= row["high"] for case in study.cases for row in case.result.get("parameters", ())
    )
    stated = [pair for case in study.cases for pair in case.stated]
    bins = reliability([p for p, _ in stated], [t for _, t in stated])
    error, brier = expected_calibration_error(bins), brier_score([p for p, _ in stated], [t for _, t in stated])
    return [
        _within(
            "95 % intervals of added parameters cover, data of the reduced plant", held, (0.92, 0.98), LEAST_PARAMETERS
        ),
        _reported("95 % intervals cover, fine plant, where both have the parameter", fine),
        _number(
            "stated probabilities: expected calibration error",
            "at most 0.05",
            f"{error:.3f}, Brier score {brier:.3f}, {len(stated)} causes",
            (error, np.nan, np.nan),
            len(stated),
            error <= 0.05,
        ),
    ]


def _harm(study: Opened) -> Goal:
    ratios = harm(study)
    low, high = median_interval(ratios)
    middle = float(np.median(ratios)) if ratios else np.nan
    words = f"{middle:.4f} ({low:.4f} to {high:.4f}), at worst {max(ratios, default=np.nan):.3f}"
    measure = "harm: error on unseen clean data, with over without the diagnosis, median"
    return _number(measure, "at most 1.005", words, (middle, low, high), len(ratios), middle <= 1.005)


def _at_most(measure: str, rate: Rate, limit: float, demanded: str) -> Goal:
    return _goal(measure, demanded, rate, (0.0, most(rate)), bool(rate.count) and rate.share <= limit, "at most")


def _at_least(measure: str, flags: Iterable[bool], limit: float) -> Goal:
    rate = Rate.of(flags)
    met = bool(rate.count) and rate.share >= limit
    return _goal(measure, f"at least {100 * limit:g} %", rate, (least(rate), 1.0), met, "at least")


def _within(measure: str, rate: Rate, ends: tuple[float, float], count: int) -> Goal:
    met = rate.count >= count and ends[0] <= rate.share <= ends[1]
    demanded = f"{100 * ends[0]:g} to {100 * ends[1]:g} % of at least {count}"
    return _goal(measure, demanded, rate, bounds(rate), met, "")


def _reported(measure: str, rate: Rate) -> Goal:
    return _goal(measure, REPORTED, rate, bounds(rate), None, "")


def _goal(measure: str, demanded: str, rate: Rate, ends: tuple[float, float], met: bool | None, side: str) -> Goal:
    if not rate.count:
        return _number(measure, demanded, "", (np.nan, np.nan, np.nan), 0, met)
    low, high = ends
    bound = {
        "at most": f"bound {100 * high:.1f} %",
        "at least": f"bound {100 * low:.1f} %",
        "": f"{100 * low:.1f} to {100 * high:.1f} %",
    }[side]
    words = f"{rate.hits} of {rate.count}, {100 * rate.share:.1f} % ({bound})"
    return _number(measure, demanded, words, (rate.share, low, high), rate.count, met)


def _number(
    measure: str, demanded: str, words: str, ends: tuple[float, float, float], count: int, met: bool | None
) -> Goal:
    """A goal whose value and interval are numbers; they are absent where no case counts."""
    value, low, high = ends if count else (None, None, None)
    return Goal(
        measure=measure,
        demanded=demanded,
        reached=words if count else NO_CASE,
        value=value,
        low=low,
        high=high,
        count=count,
        met=None if met is None else bool(met) and count > 0,
    )


def _mean(measure: str, values: Sequence[float], limit: float) -> Goal:
    mean = float(np.mean(values)) if values else np.nan
    half = 1.96 * float(np.std(values)) / np.sqrt(len(values)) if values else np.nan
    words = f"{mean:.2f} (± {half:.2f}), {len(values)} cases"
    return _number(measure, f"at most {limit:g}", words, (mean, mean - half, mean + half), len(values), mean <= limit)


def _median(measure: str, values: Sequence[float], limit: float) -> Goal:
    middle = float(np.median(values)) if values else np.nan
    low, high = median_interval(values)
    words = f"{100 * middle:.1f} % ({100 * low:.1f} to {100 * high:.1f}), {len(values)} cases"
    return _number(measure, f"at least {100 * limit:g} %", words, (middle, low, high), len(values), middle >= limit)


def _points(measure: str, ours: Rate, theirs: Rate, limit: float) -> Goal:
    """A difference of rates on the same cases; its bound takes each rate's own, which is on the safe side."""
    if not ours.count:
        return _number(measure, f"by {100 * limit:g} points", "", (np.nan, np.nan, np.nan), 0, False)
    ahead, low, high = (
        ours.share - theirs.share,
        bounds(ours)[0] - bounds(theirs)[1],
        bounds(ours)[1] - bounds(theirs)[0],
    )
    words = f"{100 * ahead:.1f} points ({ours.hits} against {theirs.hits} of {ours.count}; bound {100 * low:.1f})"
    return _number(measure, f"by {100 * limit:g} points", words, (ahead, low, high), ours.count, ahead >= limit)
