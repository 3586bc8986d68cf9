"""The tables and figures of the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from deatwin.ident.mismatch import Verdict
from deatwin.plant import Family, catalogue, effect_named
from deatwin.plant.drawing import Axes, Figure, numbers_of_decades, plain_numbers
from deatwin.plant.effects.titles import effects_in_words
from deatwin.plant.words import spaced
from deatwin.scenarios.concealed_physics.cases import KEY, OUTSIDE, REACH, VISIBLE
from deatwin.scenarios.concealed_physics.results import Case, Goal, Opened
from deatwin.studies.rates import Rate, brier_score, expected_calibration_error, reliability
from deatwin.studies.report.drawing import Drawing, Hue, draw, standalone, titled
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.story import Table
from deatwin.studies.report.tables import csv_text
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
KINDS = {
    "clean": "nothing concealed",
    "dirt": "nothing concealed, imperfect laboratory",
    "effect": "one effect",
    "pair": "two effects",
    "outside": "outside the catalogue",
    "tie": "tie",
}
"""Kinds of cases in words, in the order of tables."""
VERDICTS = (*(verdict.value for verdict in Verdict), "error")
MADE_BY = {
    "base": "calibrated base plant",
    "diagnosis": "diagnosis",
    "oracle": "oracle",
    "pysindy": "sparse dynamics (pysindy)",
    "gaussian_process": "Gaussian process",
    "narx": "NARX",
}
"""Who makes a prediction of the check record, in the order of tables and figures."""
OTHER = "other"  # Verdicts that find fault with recording or input, and errors
NOTHING = {"none": "none", "parameters": "none", "unknown": "unknown"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Confusion:
    """Counts of each answer to each truth."""

    truths: tuple[str, ...]  # Rows
    answers: tuple[str, ...]  # Columns
    counts: np.ndarray  # shape (truths, answers): Cases
    right: np.ndarray  # shape (truths, answers): True where the answer is right


def by_effect(study: Opened) -> Confusion:
    """Count first causes by canonical name, for clean data, single effects and what is outside the catalogue."""
    return _confusion(study, [effect.name for effect in catalogue()], lambda name: name)


def by_family(study: Opened) -> Confusion:
    """Count first causes by family."""
    return _confusion(study, [family.value for family in Family], lambda name: effect_named(name).family.value)


def _confusion(study: Opened, groups: Sequence[str], group: Callable[[str], str]) -> Confusion:
    truths, answers = (*groups, "outside", "clean"), (*groups, "unknown", "none", OTHER)
    counts = np.zeros((len(truths), len(answers)), dtype=int)
    for case in study.of("clean", "effect", "outside"):
        answer = group(case.causes[0]) if case.causes else NOTHING.get(case.verdict, OTHER)
        truth = case.kind if case.kind != "effect" else group(case.truth[0])
        counts[truths.index(truth), answers.index(answer)] += 1
    expected = {"outside": "unknown", "clean": "none"}
    right = np.array([[answer == expected.get(truth, truth) for answer in answers] for truth in truths])
    return Confusion(truths=truths, answers=answers, counts=counts, right=right)


def tables(study: Opened) -> list[Table]:
    """Make the tables of what was found; those without a row are left out."""
    made = [
        _verdicts(study),
        _effects(study),
        _half(study),
        _outside(study),
        _pairs(study),
        _ties(study),
        _predictions(study),
        _reach(),
        WORDS.table("failures", [[name, text] for name, text in study.failures.items()]),
    ]
    return [table for table in made if table.rows]


def reported(goals: Sequence[Goal]) -> Table:
    """List results without a goal."""
    return WORDS.table("reported", [[goal.measure, goal.reached] for goal in goals if goal.met is None])


def _verdicts(study: Opened) -> Table:
    found = {words: Counter(case.verdict for case in study.of(kind)) for kind, words in KINDS.items()}
    rows = [[words, str(f.total()), *(str(f[verdict]) for verdict in VERDICTS)] for words, f in found.items()]
    return WORDS.table("verdicts", rows, *VERDICTS)


def _grouped(cases: Iterable[Case], key: Callable[[Case], str]) -> dict[str, list[Case]]:
    """Group cases by name, each group by increasing ratio."""
    groups: dict[str, list[Case]] = {}
    for case in cases:
        groups.setdefault(key(case), []).append(case)
    return {name: sorted(group, key=lambda case: case.ratio) for name, group in groups.items()}


def _each(cases: Sequence[Case], mark: Callable[[Case], str]) -> str:
    return " ".join(f"{case.ratio:#.2g}:{mark(case)}" for case in cases)


def _effects(study: Opened) -> Table:
    rows = []
    for name, cases in _grouped(study.of("effect"), lambda case: case.truth[0]).items():
        concealed = ", ".join(dict.fromkeys(effects_in_words(m) for case in cases for m in case.mechanisms))
        flags = ("detected", "inside", "first_right", "confidently_wrong")
        counts = [str(sum(getattr(case, flag) for case in cases)) for flag in flags]
        rows.append([effects_in_words(name), concealed, str(len(cases)), *counts, _each(cases, _mark)])
    return WORDS.table("effects", rows)


def _half(study: Opened) -> Table:
    rows = []
    for family in Family:
        cases = [case for case in study.of("effect") if effect_named(case.truth[0]).family is family]
        at = half_named([case.ratio for case in cases], [case.first_right for case in cases])
        rows.append([family.value, str(len(cases)), "–" if at is None else three_digits(at)])
    return WORDS.table("half", rows)


def half_named(ratios: Sequence[float], right: Sequence[bool]) -> float | None:
    """Return the ratio at which a logistic curve in its logarithm passes one half; None if undetermined."""
    from scipy.optimize import minimize

    seen = np.array(ratios) > 0.0
    places, signs = np.log(np.array(ratios)[seen]), np.where(np.array(right, dtype=bool)[seen], 1.0, -1.0)
    if not (signs > 0).any() or not (signs < 0).any():
        return None
    found = minimize(lambda b: np.logaddexp(0.0, -signs * (b[0] + b[1] * places)).sum() + 1e-3 * b[1] ** 2, [0.0, 1.0])
    return float(np.exp(-found.x[0] / found.x[1])) if found.x[1] > 0.0 else None


def _mark(case: Case) -> str:
    if case.verdict == "named":
        return "✓" if case.named_right else "✗"
    if case.verdict == "partly":
        return "✗" if case.wrong_cause else "½"
    if case.verdict == "ambiguous":
        return "(✓)" if case.inside else "(✗)"
    return {"unknown": "?", "none": "–", "parameters": "–"}.get(case.verdict, "·")


def _outside(study: Opened) -> Table:
    def mark(case: Case) -> str:
        return "✗" if case.causes else "✓" if case.right_unknown else "–" if not case.detected else "·"

    rows = []
    for name, cases in _grouped(study.of("outside"), lambda case: case.mechanisms[0]).items():
        stated = Counter(" + ".join(case.causes) for case in cases if case.causes)
        unknown = sum(case.right_unknown for case in cases)
        counts = map(str, (len(cases), sum(case.detected for case in cases), unknown, stated.total()))
        which = ", ".join(f"{effects_in_words(causes)}: {count}" for causes, count in stated.most_common())
        rows.append([effects_in_words(name), *counts, which, _each(cases, mark)])
    return WORDS.table("outside", rows)


def _pairs(study: Opened) -> Table:
    rows = []
    for case in study.of("pair"):
        others = effects_in_words(", ".join(sorted(case.answer - set(case.causes))))
        found = [three_digits(case.ratio), case.verdict, effects_in_words(" + ".join(case.causes)), others]
        rows.append([case.name, effects_in_words(" + ".join(case.truth)), *found])
    return WORDS.table("pairs", rows)


def _ties(study: Opened) -> Table:
    rows = []
    for case in study.of("tie"):
        found = [three_digits(case.ratio), case.verdict, effects_in_words(", ".join(sorted(case.answer)))]
        named = "yes" if case.resolved else "at once" if case.named_right else "no"
        advised = effects_in_words(case.advised or "–") + "†" * case.heavier
        rows.append([case.name, effects_in_words(case.truth[0]), *found, advised, named])
    return WORDS.table("ties", rows)


def over_oracle(study: Opened) -> dict[str, np.ndarray]:
    """Return errors on held-out data relative to the oracle, (n,), for single effects at least as large as the noise."""
    errors = [case.errors for case in study.of("effect", ratio=1.0) if "oracle" in case.errors]
    found = {name: [e[name] / e["oracle"] for e in errors if name in e] for name in MADE_BY}
    return {name: np.array(ratios) for name, ratios in found.items() if ratios}


def _predictions(study: Opened) -> Table:
    rows = []
    for name, ratios in over_oracle(study).items():
        low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
        lost = sum(name in c.lost for c in study.of("effect", ratio=1.0) if "oracle" in c.errors)
        rows.append([MADE_BY[name], str(ratios.size), *(f"{r:.3f}" for r in (middle, low, high)), str(lost)])
    return WORDS.table("predictions", rows)


def _reach() -> Table:
    """Show how much of each mechanism the displacement at a given voltage can reveal at all."""
    rows = []
    for name in sorted(REACH, key=lambda name: (REACH[name], name in OUTSIDE, name)):
        effect = effects_in_words(KEY[name][0]) if name in KEY else "outside the catalogue"
        visible = "yes" if REACH[name] >= VISIBLE else "no"
        rows.append([effects_in_words(name), effect, three_digits(REACH[name]), visible])
    return WORDS.table("reach", rows)


RUNGS = (0.0, 0.12, 0.17, 0.24, 0.39, 0.67, 1.2, 2.1, 3.7, np.inf)
"""Ends of the classes of the mismatch divided by the noise, halfway between the strengths of the cases."""
ANSWERS: dict[str, tuple[Callable[[Case], bool], str, str]] = {
    "detected": (lambda c: c.detected, Hue.MEASURED, "s"),
    "true effect among causes or alternatives": (lambda c: c.inside, Hue.MARK, "D"),
    "first cause right": (lambda c: c.first_right, Hue.AFTER, "o"),
    "wrong name": (lambda c: c.confidently_wrong, Hue.BEFORE, "X"),
}


SIZE = (7.6, 7.8)


def drawings(study: Opened) -> list[Drawing]:
    """Draw the figures of the page."""
    with draw(SIZE) as figure:
        _whole(figure, study)
        whole = WORDS.drawing(figure, "summary")
    table = by_effect(study)
    with draw((9.0, 9.0)) as figure:
        _draw_confusion(figure.add_subplot(), table)
        lines = ((truth, *map(int, line)) for truth, line in zip(table.truths, table.counts, strict=True))
        return [whole, WORDS.drawing(figure, "confusion_effect", csv_text(("truth", *table.answers), lines))]


def summary(study: Opened) -> str:
    """Draw the study in one self-contained figure."""
    with draw(SIZE) as figure:
        _whole(figure, study)
        return standalone(figure)


def _whole(figure: Figure, study: Opened) -> None:
    """Draw confusion of families, power, reliability, and errors on held-out data."""
    (first, second), (third, fourth) = figure.subplots(2, 2)
    _draw_confusion(first, by_family(study))
    _draw_power(second, study)
    _draw_reliability(third, study)
    _draw_errors(fourth, study)
    titles = {
        first: "concealed (rows), found (columns)",
        second: "one effect, by its mismatch",
        third: "stated probability of a cause",
        fourth: "free run on held-out data",
    }
    for axes, title in titles.items():
        titled(axes, title)


def _draw_confusion(axes: Axes, table: Confusion) -> None:
    """Write counts into cells whose shade is the share of their row."""
    from matplotlib.patches import Rectangle

    causes, crowded = len(table.answers) - 3, len(table.answers) > 12
    for (row, column), count in np.ndenumerate(table.counts):
        if count:
            colour = Hue.AFTER if table.right[row, column] else Hue.BEFORE if column < causes else Hue.MEASURED
            depth = 0.15 + 0.6 * (count / table.counts[row].sum())
            axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, color=colour, alpha=depth, linewidth=0))
            axes.text(column, row, str(count), ha="center", va="center", fontsize="small")
    axes.axvline(causes - 0.5, color=Hue.INK, linewidth=0.8)
    axes.axhline(len(table.truths) - 2.5, color=Hue.INK, linewidth=0.8)
    axes.set_xticks(range(len(table.answers)), [spaced(a) for a in table.answers])
    _tilt(axes, 90 if crowded else 40)
    axes.set_yticks(range(len(table.truths)), [spaced(t) for t in table.truths], fontsize="small")
    axes.set(xlim=(-0.5, len(table.answers) - 0.5), ylim=(len(table.truths) - 0.5, -0.5))
    axes.set_axisbelow(True)
    axes.grid(alpha=0.5)


def _tilt(axes: Axes, degrees: int) -> None:
    """Write long names below the horizontal axis at an angle."""
    axes.tick_params(axis="x", labelsize="small", labelrotation=degrees)
    for label in axes.get_xticklabels():
        label.set_horizontalalignment("center" if degrees == 90 else "right")


def _draw_power(axes: Axes, study: Opened) -> None:
    for place, (words, (flag, colour, marker)) in enumerate(ANSWERS.items()):
        points = _classes(study.of("effect"), flag)
        shares = np.array([100 * r.share for _, r in points])
        ends = np.array([[100 * end for end in r.interval] for _, r in points]).reshape(-1, 2).T
        axes.errorbar(
            [x * 1.03**place for x, _ in points],
            shares,
            np.abs(ends - shares) if points else None,
            color=colour,
            label=words,
            fmt=f"{marker}-",
            markersize=4.5,
            capsize=2,
            elinewidth=0.8,
        )
    axes.set(xscale="log", xlabel="mismatch divided by noise", ylabel="cases (%)", ylim=(-4, 104))
    plain_numbers(axes.xaxis, 1.0, 3.0)
    axes.legend(loc="upper left", bbox_to_anchor=(-0.02, -0.16), markerscale=1, fontsize="small")


def _classes(cases: Sequence[Case], flag: Callable[[Case], bool]) -> list[tuple[float, Rate]]:
    """Return the geometric mean of the ratios, and the rate, of each class with any case."""
    made = []
    for low, high in pairwise(RUNGS):
        inside = [case for case in cases if low <= case.ratio < high]
        if inside:
            middle = float(np.exp(np.mean(np.log([max(c.ratio, 0.02) for c in inside]))))
            made.append((middle, Rate.of(flag(case) for case in inside)))
    return made


def _draw_reliability(axes: Axes, study: Opened) -> None:
    stated = [pair for case in study.cases for pair in case.stated]
    bins = reliability(stated)
    axes.plot([0, 100], [0, 100], ":", color=Hue.INK, linewidth=0.9)
    for b in bins:
        place, share, (low, high) = 100 * b.stated, 100 * b.came_true.share, b.came_true.interval
        axes.errorbar(place, share, [[share - 100 * low], [100 * high - share]], fmt="o", color=Hue.AFTER, markersize=5)
        axes.annotate(str(b.came_true.count), (place, share), (-6, -3), textcoords="offset points", ha="right")
    label = "stated (%)"
    if stated:
        error, brier = expected_calibration_error(bins), brier_score(stated)
        label += f"\ncalibration error {error:.3f}, Brier score {brier:.3f}"
    axes.set(xlabel=label, ylabel="right (%)", xlim=(-3, 103), ylim=(-3, 103))


def _draw_errors(axes: Axes, study: Opened) -> None:
    found = over_oracle(study)
    shown = [name for name in MADE_BY if name != "oracle" and name in found]
    labels = [MADE_BY[name].replace(" (", "\n(") for name in shown]
    axes.boxplot([found[name] for name in shown], whis=(5, 95), tick_labels=labels, sym="_", widths=0.5)
    axes.axhline(1.0, color=Hue.INK, linestyle=":", linewidth=0.9)
    axes.set(yscale="log", ylabel="error divided by that of the oracle")
    _tilt(axes, 40)
    numbers_of_decades(axes.yaxis, 100.0)
    axes.grid(axis="x", visible=False)
