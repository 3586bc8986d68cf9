"""The tables of the page, and the CSV files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from deatwin.scenarios.concealed_physics.confusion import by_effect, by_family
from deatwin.scenarios.concealed_physics.key import canonical
from deatwin.scenarios.concealed_physics.opened import Case, Opened
from deatwin.scenarios.concealed_physics.reach import REACH, VISIBLE
from deatwin.scenarios.concealed_physics.score import Goal
from deatwin.scenarios.concealed_physics.seal import Seal
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.story import Table

KINDS = {
    "clean": "clean",
    "effect": "one effect",
    "pair": "two effects",
    "outside": "outside the catalogue",
    "tie": "tie under poor input",
}
"""Kinds of cases in words, in the order of tables."""
VERDICTS = ("none", "parameters", "named", "ambiguous", "unknown", "disturbance", "data_fault", "not_testable", "error")
MADE_BY = {
    "base": "calibrated base plant",
    "diagnosis": "diagnosis",
    "oracle": "oracle",
    "pysindy": "sparse dynamics (pysindy)",
    "gaussian_process": "Gaussian process",
    "narx": "NARX",
}
"""Who makes a prediction of the check record, in the order of tables and figures."""


def tables(study: Opened, seal: Seal) -> list[Table]:
    """Make all tables."""
    made = [
        _verdicts(study),
        _effects(study),
        _outside(study),
        _pairs(study),
        _ties(study),
        _predictions(study),
        _reach(),
    ]
    if study.failures:
        made.append(
            Table(
                title="Cases that ended in an error",
                columns=["case", "message"],
                rows=[[name, text] for name, text in study.failures.items()],
            )
        )
    return [*(table for table in made if table.rows), _sealed(seal)]


def reported(goals: Sequence[Goal]) -> Table:
    """What is measured without anything being demanded."""
    rows = [[goal.measure, goal.reached] for goal in goals if goal.met is None]
    return Table(title="Reported, nothing is demanded", columns=["measure", "reached"], rows=rows)


def _verdicts(study: Opened) -> Table:
    rows = []
    for kind, words in KINDS.items():
        found = Counter(case.verdict for case in study.of(kind))
        rows.append([words, str(found.total()), *(str(found[verdict]) for verdict in VERDICTS)])
    return Table(title="Verdicts", columns=["cases", "number", *VERDICTS], rows=rows)


def _effects(study: Opened) -> Table:
    singles = study.of("effect")
    rows = []
    for name in dict.fromkeys(case.truth[0] for case in singles):
        cases = sorted((c for c in singles if c.truth[0] == name), key=lambda c: c.ratio)
        rows.append(
            [
                name.replace("_", " "),
                ", ".join(dict.fromkeys(m.replace("_", " ") for c in cases for m in c.mechanisms)),
                *_counts(cases),
                " ".join(f"{c.ratio:.2g}:{_mark(c)}" for c in cases),
            ]
        )
    columns = [
        "effect",
        "concealed as",
        "cases",
        "detected",
        "truth in answer",
        "first cause right",
        "confident wrong",
        "each: ratio and verdict",
    ]
    return Table(title=f"Effect by effect ({_LEGEND})", columns=columns, rows=rows)


_LEGEND = "✓ named, (✓) ambiguous with the truth inside, ✗ wrong, ? unknown, – none, · other"


def _mark(case: Case) -> str:
    if case.verdict == "named":
        return "✓" if case.named_right else "✗"
    if case.verdict == "ambiguous":
        return "(✓)" if case.inside else "(✗)"
    return {"unknown": "?", "none": "–", "parameters": "–"}.get(case.verdict, "·")


def _counts(cases: Sequence[Case]) -> list[str]:
    return [
        str(len(cases)),
        *(
            str(sum(flags))
            for flags in (
                [c.detected for c in cases],
                [c.inside for c in cases],
                [c.first_right for c in cases],
                [c.confidently_wrong for c in cases],
            )
        ),
    ]


def _outside(study: Opened) -> Table:
    cases = study.of("outside")
    rows = []
    for name in dict.fromkeys(case.mechanisms[0] for case in cases):
        same = sorted((c for c in cases if c.mechanisms[0] == name), key=lambda c: c.ratio)
        said = Counter("+".join(c.causes) for c in same if c.causes)
        rows.append(
            [
                name.replace("_", " "),
                str(len(same)),
                str(sum(c.detected for c in same)),
                str(sum(c.verdict == "unknown" for c in same)),
                str(sum(bool(c.causes) for c in same)),
                ", ".join(f"{k} {v}" for k, v in said.most_common()),
                " ".join(f"{c.ratio:.2g}:{_outside_mark(c)}" for c in same),
            ]
        )
    columns = ["mechanism", "cases", "detected", "unknown", "a cause named", "which", "each: ratio and verdict"]
    return Table(title="Outside the catalogue", columns=columns, rows=rows)


def _outside_mark(case: Case) -> str:
    return "✗" if case.causes else {"unknown": "✓", "none": "–", "parameters": "–"}.get(case.verdict, "·")


def _pairs(study: Opened) -> Table:
    rows = [
        [
            case.name,
            " + ".join(case.truth),
            three_digits(case.ratio),
            case.verdict,
            " + ".join(case.causes),
            ", ".join(sorted(case.answer - set(case.causes))),
        ]
        for case in study.of("pair")
    ]
    columns = ["case", "truth", "ratio", "verdict", "causes", "also in the set"]
    return Table(title="Two effects", columns=columns, rows=rows)


def _ties(study: Opened) -> Table:
    rows = []
    for case in study.of("tie"):
        again = case.result.get("advised")
        after = "–"
        if again:
            causes = " + ".join(cause["effect"] for cause in again.get("causes", ()))
            after = again.get("failure") or f"{again['verdict']}: {causes}{'†' if case.heavier else ''}"
        rows.append(
            [
                case.name,
                case.truth[0],
                three_digits(case.ratio),
                case.verdict,
                ", ".join(sorted(case.answer)),
                after,
                "yes" if case.resolved else "at once" if case.named_right else "no",
            ]
        )
    columns = ["case", "truth", "ratio", "verdict", "answer", "with the advised experiment", "resolved"]
    return Table(title=f"Ties ({_HEAVIER})", columns=columns, rows=rows)


_HEAVIER = "† a mass was added: the further record was diagnosed alone, with the tied effects as the whole catalogue"


def _predictions(study: Opened) -> Table:
    """Errors on unseen data over the oracle's, of single effects that are at least as large as the noise."""
    cases = [case for case in study.of("effect", ratio=1.0) if "oracle" in case.errors]
    rows = []
    for name, words in MADE_BY.items():
        ratios = [c.errors[name] / c.errors["oracle"] for c in cases if name in c.errors]
        if ratios:
            low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
            lost = sum(bool(c.result.get("baselines", {}).get(name, {}).get("failure")) for c in cases)
            rows.append([words, str(len(ratios)), *(f"{r:.3f}" for r in (middle, low, high)), str(lost)])
    columns = ["plant", "cases", "median", "5 %", "95 %", "runs that diverged or failed"]
    return Table(title="Error on the check record over the oracle's, ratio 1 or more", columns=columns, rows=rows)


def _reach() -> Table:
    """What the displacement under a voltage can show of each mechanism at all."""
    rows = [
        [
            mechanism.replace("_", " "),
            canonical(mechanism) or "outside the catalogue",
            three_digits(largest),
            "no" if largest < VISIBLE else "yes",
        ]
        for mechanism, largest in sorted(REACH.items(), key=lambda item: item[1])
    ]
    columns = ["mechanism", "effect", "largest ratio", "visible"]
    title = "Largest ratio at physical size, measured beforehand on one rig with noise of 1 % of the motion"
    return Table(title=title, columns=columns, rows=rows)


def _sealed(seal: Seal) -> Table:
    rows = [
        ["seal (hash of all below but the last)", seal.hash],
        ["labels", seal.key],
        ["code that runs the cases", seal.code],
        ["thresholds", f"{len(seal.thresholds)} numbers, listed in seal.json"],
        ["version", seal.version],
        ["size and seed", f"{seal.size}, {seal.seed}"],
        ["code that counts, when it was sealed", seal.scoring],
    ]
    return Table(title="What was sealed before the first case", columns=["what", "SHA-256 or value"], rows=rows)


def csv_files(study: Opened, goals: Sequence[Goal]) -> dict[str, str]:
    """Every count as CSV."""
    numbers = [(g.measure, g.demanded, g.reached, g.value, g.low, g.high, g.count, g.outcome) for g in goals]
    header = ("goal", "demanded", "reached", "value", "low_95", "high_95", "cases", "met")
    files = {"goals.csv": _csv(header, numbers), "cases.csv": _csv(_COLUMNS, map(_line, study.cases))}
    for name, table in (("effect", by_effect(study)), ("family", by_family(study))):
        files[f"confusion_{name}.csv"] = _csv(("truth", *table.answers), table.rows())
    held = [
        (r["name"], r["true"], r["low"], r["high"], int(r["low"] <= r["true"] <= r["high"])) for r in study.intervals
    ]
    files["intervals.csv"] = _csv(("parameter", "true", "low", "high", "covered"), held)
    return files


_COLUMNS = (
    "case",
    "kind",
    "truth",
    "concealed",
    "rich",
    "ratio",
    "verdict",
    "causes",
    "set",
    "nearest_d2",
    "probability",
    *(f"{name}_rms" for name in ("nominal", *MADE_BY)),
    "sparse_term",
    "resolved",
    "processor_s",
)


def _line(case: Case) -> tuple[object, ...]:
    causes = case.diagnosis.get("causes", ())
    return (
        case.name,
        case.kind,
        "+".join(case.truth),
        "+".join(case.mechanisms),
        int(case.rich),
        f"{case.ratio:.4g}",
        case.verdict,
        "+".join(case.causes),
        "+".join(sorted(case.answer)),
        f"{case.nearest:.4g}",
        f"{causes[0]['probability']:.4g}" if causes else "",
        *(f"{case.errors[n]:.5g}" if n in case.errors else "" for n in ("nominal", *MADE_BY)),
        case.result.get("baselines", {}).get("pysindy", {}).get("term", ""),
        int(case.resolved),
        case.result.get("seconds_in_all", ""),
    )


def _csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    import csv
    import io

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(["" if cell is None else cell for cell in row] for row in rows)
    return buffer.getvalue()
