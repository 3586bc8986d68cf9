"""What the trial of the thesis' argument comes to, in words and numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.scenarios.unexplained_drift.repeatability import AGES, CREEP, HELD, RELAXATION, RESTS, SPAN, Group
from deatwin.studies.report.story import Note, Row, Table


def sentence_of(groups: Sequence[Group]) -> str:
    """The outcome in a sentence."""
    six, alike, unlike = _sorted(groups)
    before, after = (_excluded(six, several) for several in (alike, unlike))
    return (
        f"Repeatability excludes creep of a known size in {before[0]} and relaxation in {before[1]} of the six while "
        f"all histories are the same; once histories differ it is {after[0]} and {after[1]}."
    )


def rows_of(groups: Sequence[Group]) -> list[Row]:
    """The claim, taken apart."""
    _, alike, unlike = _sorted(groups)
    rows = []
    for same, other in zip(alike, unlike, strict=True):
        before, after = same.spread[0], other.spread[0]
        rows.append(
            Row(
                measure=f"{same.name.capitalize()} repeats over six fabrications while histories are the same",
                demanded="all shifts of one sign, spread below half their mean",
                reached=f"{_range(same)}, spread {100 * before / abs(same.sizes.mean()):.0f} % of the mean",
                passed=_one_sign(same) and bool(before < abs(same.sizes.mean()) / 2),
            )
        )
        ratio = (after / before) ** 2
        rows.append(
            Row(
                measure=f"Once histories differ, {same.name} of the same size no longer repeats",
                demanded=f"variance up by more than {_limit(same):.1f} (F test, 2.5 %)",
                reached=f"{_range(other)}, variance up by {ratio:.3g}",
                passed=ratio > _limit(same),
            )
        )
    return rows


def notes(groups: Sequence[Group]) -> list[Note]:
    """What the argument is, how it was tried out, and when it holds."""
    six, (creep, relaxation), (strained, aged) = _sorted(groups)
    falls = int(np.sum(six.sizes < 0))
    return [
        Note(
            title="“Stress relaxation and creep are repeatable”",
            paragraphs=[
                "The thesis argues so, and that hence neither makes six actuators drift in six ways. Two things are "
                "in this: that a drift of the material repeats from actuator to actuator, and that the drifts seen do "
                f"not. Six fabrications of the specification were given creep ({CREEP.modulus / 1e3:g} kPa, "
                f"{CREEP.time:g} s), or relaxation of the prestretch ({100 * RELAXATION.relative_loss:g} % in "
                f"{RELAXATION.time:g} s), and driven twice with the same noise, {SPAN:g} s apart. The mean is compared "
                "at the same input, so its shift is the drift; its standard error is at most "
                f"{1e6 * max(d.shift_error for g in groups for d in g.drifts):.2f} µm.",
                f"With one history the premise holds: creep of rested films moves the mean by {_range(creep)}, "
                f"relaxation of freshly mounted ones by {_range(relaxation)}; a further actuator would lie within "
                f"{_interval(creep)} and {_interval(relaxation)}. Tolerances of fabrication alone do not make "
                "drifts of both signs.",
                f"Without it, it fails. Held at {HELD:g} V before and given 5 s to 27 min of rest, films of the very "
                f"same creep move by {_range(strained)}: one that comes from a higher voltage recovers, and its mean "
                f"falls. After {RESTS[-1] / CREEP.time:g} time constants of rest creep is back at "
                f"{100 * strained.sizes[-1] / creep.sizes[-1]:.0f} % of what the same actuator shows rested. Mounted "
                f"0 s to 100 min before, films of the same relaxation move by {_range(aged)}, which is "
                f"{_shares(aged.sizes / relaxation.sizes)} % of what the same actuator shows fresh; the exponential "
                f"alone says {_shares(np.exp(-np.array(AGES) / RELAXATION.time))} %. What has decayed decays no more: "
                "relaxation does not repeat on one film, unless it is over.",
                "So repeatability rules out creep or relaxation of a known size only where times since mounting and "
                "since the last drive are kept the same, or are known. What the recordings do show without them is "
                f"the sign: of the six means {falls} fall, and tension that relaxes lets the mean rise whatever the "
                "film's age. A mean that falls is not relaxation alone; creep it may be.",
            ],
        )
    ]


def table_of(groups: Sequence[Group]) -> Table:
    """Shifts, their spread and what is ruled out."""
    rows = []
    for group in groups:
        s, low, high = (1e6 * v for v in group.spread)
        gains = [100 * d.gain for d in group.drifts]
        excluded = [f"DEA {k}" for k, d in enumerate(groups[0].drifts, start=1) if group.rules_out(d)]
        rows.append(
            [
                f"{group.name}, {group.assumption}",
                _range(group),
                f"{s:.1f} ({low:.1f} to {high:.1f})",
                _interval(group),
                f"{min(gains):.1f} to {max(gains):.1f}",
                "–" if group is groups[0] else ", ".join(excluded) or "none",
            ]
        )
    return Table(
        title="Shift of the mean between two runs of the same noise",
        rows=rows,
        columns=[
            "mechanism and history",
            "shifts",
            "standard deviation (95 %) (µm)",
            "95 % of further actuators",
            "change of gain (%)",
            "ruled out for",
        ],
    )


def _sorted(groups: Sequence[Group]) -> tuple[Group, tuple[Group, Group], tuple[Group, Group]]:
    """The six as they are; creep and relaxation with histories alike, and unlike."""
    six, creep, strained, relaxation, aged = groups
    return six, (creep, relaxation), (strained, aged)


def _excluded(six: Group, groups: Sequence[Group]) -> list[int]:
    return [sum(group.rules_out(d) for d in six.drifts) for group in groups]


def _one_sign(group: Group) -> bool:
    return bool(np.all(group.sizes > 0) or np.all(group.sizes < 0))


def _limit(group: Group) -> float:
    """Ratio of two variances of as many normal values that chance exceeds in 2.5 % of all cases."""
    from scipy.stats import f

    n = group.sizes.size
    return float(f.ppf(0.975, n - 1, n - 1))


def _range(group: Group) -> str:
    return f"{1e6 * group.sizes.min():.1f} to {1e6 * group.sizes.max():.1f} µm"


def _interval(group: Group) -> str:
    low, high = (1e6 * v for v in group.next_one)
    return f"{low:.1f} to {high:.1f} µm"


def _shares(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{100 * v:.0f}" for v in values)
