"""The tables of the page, and the cases as CSV."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.mismatch import Verdict
from deatwin.plant import Family, catalogue, effect_named
from deatwin.scenarios.concealed_physics.key import KEY, OUTSIDE, REACH, VISIBLE
from deatwin.scenarios.concealed_physics.results import Case, Opened
from deatwin.scenarios.concealed_physics.score import Goal
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.story import Table
from deatwin.studies.report.tables import csv_text
from deatwin.studies.sweep import SweepSeal

KINDS = {
    "clean": "nothing concealed",
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

    def csv(self) -> str:
        """Write a line for each truth: its name and its counts."""
        lines = ((truth, *map(int, line)) for truth, line in zip(self.truths, self.counts, strict=True))
        return csv_text(("truth", *self.answers), lines)


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
        _outside(study),
        _pairs(study),
        _ties(study),
        _predictions(study),
        _reach(),
        Table(
            title="Cases that ended in an error",
            columns=["case", "message"],
            rows=[[name, text] for name, text in study.failures.items()],
        ),
    ]
    return [table for table in made if table.rows]


def reported(goals: Sequence[Goal]) -> Table:
    """List results without a goal."""
    columns: dict[str, Callable[[Goal], str]] = {"measure": lambda g: g.measure, "reached": lambda g: g.reached}
    return Table.of("Results without a goal", [goal for goal in goals if goal.met is None], columns)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _verdicts(study: Opened) -> Table:
    found = {words: Counter(case.verdict for case in study.of(kind)) for kind, words in KINDS.items()}
    rows = [[words, str(f.total()), *(str(f[verdict]) for verdict in VERDICTS)] for words, f in found.items()]
    return Table(title="Verdicts", columns=["cases", "number", *VERDICTS], rows=rows)


def _grouped(cases: Iterable[Case], key: Callable[[Case], str]) -> dict[str, list[Case]]:
    """Group cases by name, each group by increasing ratio."""
    groups: dict[str, list[Case]] = {}
    for case in cases:
        groups.setdefault(key(case), []).append(case)
    return {name: sorted(group, key=lambda case: case.ratio) for name, group in groups.items()}


def _each(cases: Sequence[Case], mark: Callable[[Case], str]) -> str:
    return " ".join(f"{case.ratio:.2g}:{mark(case)}" for case in cases)


def _effects(study: Opened) -> Table:
    legend = "✓ named, ½ partly, (✓) ambiguous with the true effect included, ✗ wrong, ? unknown, – none, · other"
    return Table.of(
        f"Results for each effect ({legend})",
        _grouped(study.of("effect"), lambda case: case.truth[0]).items(),
        {
            "effect": lambda group: _words(group[0]),
            "concealed as": lambda group: ", ".join(dict.fromkeys(_words(m) for c in group[1] for m in c.mechanisms)),
            "cases": lambda group: len(group[1]),
            "detected": lambda group: sum(c.detected for c in group[1]),
            "true effect among causes or alternatives": lambda group: sum(c.inside for c in group[1]),
            "first cause right": lambda group: sum(c.first_right for c in group[1]),
            "wrong name": lambda group: sum(c.confidently_wrong for c in group[1]),
            "mismatch divided by noise, and verdict, of each case": lambda group: _each(group[1], _mark),
        },
    )


def _mark(case: Case) -> str:
    if case.verdict == "named":
        return "✓" if case.named_right else "✗"
    if case.verdict == "partly":
        return "✗" if case.wrong_cause else "½"
    if case.verdict == "ambiguous":
        return "(✓)" if case.inside else "(✗)"
    return {"unknown": "?", "none": "–", "parameters": "–"}.get(case.verdict, "·")


def _outside(study: Opened) -> Table:
    def which(cases: Sequence[Case]) -> str:
        return ", ".join(f"{k} {v}" for k, v in Counter("+".join(c.causes) for c in cases if c.causes).most_common())

    def mark(case: Case) -> str:
        return "✗" if case.causes else {"unknown": "✓", "none": "–", "parameters": "–"}.get(case.verdict, "·")

    return Table.of(
        "Effects that the catalogue lacks (✓ unknown, ✗ a cause stated, – nothing detected, · other)",
        _grouped(study.of("outside"), lambda case: case.mechanisms[0]).items(),
        {
            "mechanism": lambda group: _words(group[0]),
            "cases": lambda group: len(group[1]),
            "detected": lambda group: sum(c.detected for c in group[1]),
            "unknown": lambda group: sum(c.verdict == "unknown" for c in group[1]),
            "a cause stated": lambda group: sum(bool(c.causes) for c in group[1]),
            "causes stated, with the number of cases": lambda group: which(group[1]),
            "mismatch divided by noise, and verdict, of each case": lambda group: _each(group[1], mark),
        },
    )


def _pairs(study: Opened) -> Table:
    return Table.of(
        "Two effects",
        study.of("pair"),
        {
            "case": lambda case: case.name,
            "concealed effects": lambda case: " + ".join(case.truth),
            "mismatch divided by noise": lambda case: three_digits(case.ratio),
            "verdict": lambda case: case.verdict,
            "causes": lambda case: " + ".join(case.causes),
            "alternatives": lambda case: ", ".join(sorted(case.answer - set(case.causes))),
        },
    )


def _ties(study: Opened) -> Table:
    mass = "† a mass was added, so the new recording was diagnosed alone, with only the tied effects as candidates"
    return Table.of(
        f"Ties: commands that cannot distinguish the effect ({mass})",
        study.of("tie"),
        {
            "case": lambda case: case.name,
            "concealed effect": lambda case: case.truth[0],
            "mismatch divided by noise": lambda case: three_digits(case.ratio),
            "verdict": lambda case: case.verdict,
            "causes and alternatives": lambda case: ", ".join(sorted(case.answer)),
            "verdict after the advised experiment": lambda case: (case.advised or "–") + "†" * case.heavier,
            "true effect named": lambda case: "yes" if case.resolved else "at once" if case.named_right else "no",
        },
    )


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
    columns = ["model", "cases", "median", "5 % quantile", "95 % quantile", "diverged or failed runs"]
    return Table(
        title="One concealed effect, mismatch at least as large as the noise: "
        "error on the check recording, divided by that of the oracle",
        columns=columns,
        rows=rows,
    )


def _reach() -> Table:
    """Show how much of each mechanism the displacement at a given voltage can reveal at all."""
    return Table.of(
        "Largest mismatch of each mechanism at a plausible size, divided by the noise "
        "(measured before the study, on one rig whose noise is 1 % of the motion)",
        sorted(REACH, key=lambda name: (REACH[name], name in OUTSIDE, name)),
        {
            "mechanism": _words,
            "effect": lambda name: KEY[name][0] if name in KEY else "outside the catalogue",
            "largest mismatch divided by noise": lambda name: three_digits(REACH[name]),
            "visible": lambda name: "no" if REACH[name] < VISIBLE else "yes",
        },
    )


def sealed(seal: SweepSeal) -> Table:
    """List what was sealed before the first case."""
    parts = seal.to_dict()["parts"]
    rows = [
        ["seal (hash of all below)", seal.hash],
        ["labels", parts["key"]],
        ["code that runs the cases", parts["code"]],
        ["thresholds", f"{len(parts['thresholds'])} numbers, listed in seal.json"],
        ["version", parts["version"]],
        ["size and seed", f"{parts['size']}, {parts['seed']}"],
    ]
    return Table(title="What was sealed before the first case", columns=["what", "SHA-256 or value"], rows=rows)


def cases_csv(study: Opened) -> str:
    """Write a line for each case."""
    return csv_text(tuple(_COLUMNS), [[cell(case) for cell in _COLUMNS.values()] for case in study.cases])


def _rms(name: str) -> Callable[[Case], str]:
    return lambda case: f"{case.errors[name]:.5g}" if name in case.errors else ""


_COLUMNS: dict[str, Callable[[Case], object]] = {
    "case": lambda case: case.name,
    "kind": lambda case: case.kind,
    "truth": lambda case: "+".join(case.truth),
    "concealed": lambda case: "+".join(case.mechanisms),
    "rich": lambda case: int(case.rich),
    "ratio": lambda case: f"{case.ratio:.4g}",
    "verdict": lambda case: case.verdict,
    "causes": lambda case: "+".join(case.causes),
    "set": lambda case: "+".join(sorted(case.answer)),
    "nearest_d2": lambda case: f"{case.nearest:.4g}",
    "probability": lambda case: f"{case.stated[0][0]:.4g}" if case.stated else "",
    **{f"{name}_rms": _rms(name) for name in ("nominal", *MADE_BY)},
    "sparse_term": lambda case: case.sparse_term,
    "true effect named": lambda case: int(case.resolved),
    "processor_s": lambda case: "" if case.seconds is None else case.seconds,
}
"""Columns of ``cases.csv``."""
