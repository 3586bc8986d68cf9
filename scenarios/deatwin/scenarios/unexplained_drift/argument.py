"""The outcome of the trial of the thesis' argument, in words and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.scenarios.unexplained_drift.repeatability import AGES, CREEP, HELD, RELAXATION, RESTS, SPAN, Group
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.words import Words

WORDS = Words(__package__)


def sentence_of(groups: Sequence[Group]) -> str:
    """Summarise the outcome in one sentence."""
    six, alike, unlike = _sorted(groups)
    before, after = ([sum(g.rules_out(d) for d in six.drifts) for g in several] for several in (alike, unlike))
    return (
        f"With equal histories, repeatability excludes creep of a known size in {before[0]} and relaxation in "
        f"{before[1]} of the six actuators; with different histories, in {after[0]} and {after[1]}."
    )


def rows_of(groups: Sequence[Group]) -> list[Measure]:
    """Run the cases of the argument and summarise each."""
    _, alike, unlike = _sorted(groups)
    rows = []
    for same, other in zip(alike, unlike, strict=True):
        spread, mean = same.spread[0], abs(same.sizes.mean())
        one_sign = bool(np.all(same.sizes > 0) or np.all(same.sizes < 0))
        ratio, limit = (other.spread[0] / spread) ** 2, _limit(same.sizes.size)
        rows += [
            WORDS.measure(
                "repeats",
                one_sign and bool(spread < mean / 2),
                name=same.name.capitalize(),
                shifts=_range(same),
                share=100 * spread / mean,
            ),
            WORDS.measure("differs", ratio > limit, name=same.name, limit=limit, shifts=_range(other), ratio=ratio),
        ]
    return rows


def numbers(groups: Sequence[Group]) -> dict[str, Any]:
    """Return the numbers for the note on the argument."""
    six, (creep, relaxation), (strained, aged) = _sorted(groups)
    return {
        "creep_law": CREEP,
        "relaxation_law": RELAXATION,
        "span": SPAN,
        "error": 1e6 * max(d.shift_error for g in groups for d in g.drifts),
        "creep": _range(creep),
        "relaxation": _range(relaxation),
        "next_creep": _interval(creep),
        "next_relaxation": _interval(relaxation),
        "held": HELD,
        "strained": _range(strained),
        "rested": RESTS[-1] / CREEP.time,
        "back": 100 * strained.sizes[-1] / creep.sizes[-1],
        "aged": _range(aged),
        "kept": _shares(aged.sizes / relaxation.sizes),
        "alone": _shares(np.exp(-np.array(AGES) / RELAXATION.time)),
        "falls": int(np.sum(six.sizes < 0)),
    }


def table_of(groups: Sequence[Group]) -> Table:
    """Make the table of shifts, their spread, and the sizes that they rule out."""

    def spread(group: Group) -> str:
        s, low, high = (1e6 * v for v in group.spread)
        return f"{s:.1f} ({low:.1f} to {high:.1f})"

    def gains(group: Group) -> str:
        several = [100 * d.gain for d in group.drifts]
        return f"{min(several):.1f} to {max(several):.1f}"

    def excluded(group: Group) -> str:
        several = [f"DEA {k}" for k, d in enumerate(groups[0].drifts, start=1) if group.rules_out(d)]
        return "–" if group is groups[0] else ", ".join(several) or "none"

    return Table.of(
        "Shift of the mean between two runs of the same noise",
        groups,
        {
            "mechanism and history": lambda group: f"{group.name}, {group.assumption}",
            "shifts": _range,
            "standard deviation (95 %) (µm)": spread,
            "95 % of further actuators": _interval,
            "change of gain (%)": gains,
            "ruled out for": excluded,
        },
    )


def _sorted(groups: Sequence[Group]) -> tuple[Group, tuple[Group, Group], tuple[Group, Group]]:
    """Return the six as they are; creep and relaxation with histories alike, and unlike."""
    six, creep, strained, relaxation, aged = groups
    return six, (creep, relaxation), (strained, aged)


def _limit(n: int) -> float:
    """Ratio of the variances of two sets of n normal values that chance exceeds in 2.5 % of all cases."""
    from scipy.stats import f

    return float(f.ppf(0.975, n - 1, n - 1))


def _range(group: Group) -> str:
    return f"{1e6 * group.sizes.min():.1f} to {1e6 * group.sizes.max():.1f} µm"


def _interval(group: Group) -> str:
    low, high = (1e6 * v for v in group.next_one)
    return f"{low:.1f} to {high:.1f} µm"


def _shares(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{100 * v:.0f}" for v in values)
