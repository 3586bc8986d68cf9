"""How well frequency responses are known, and where six actuators of one specification differ.

The uncertainty of a model's parameters is propagated to its frequency responses of every order and held against Monte
Carlo, for systems whose equations are known: where the law of propagation holds, and where it fails. Then the thesis'
question: how consistent is fabrication? Six actuators are compared by order and band, beside repeats of one of them,
which must not differ, and drift within a record is told apart from difference between actuators.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import Agreement, Comparison
from deatwin.ident.narx.fleet import DRIFTING
from deatwin.plant.words import listed, spaced
from deatwin.scenarios.frequency_uncertainty.page import (
    FASTER,
    column_of,
    counted,
    fleet_drawings,
    judge,
    known_drawings,
    tables,
)
from deatwin.scenarios.frequency_uncertainty.study import (
    FACTOR,
    REPEATS,
    SLOW,
    STRUCTURE,
    Consistency,
    Plan,
    Study,
    carry_out,
)
from deatwin.studies.report.drawing import SUBSCRIPTS
from deatwin.studies.report.story import StoryPage, finish, reached
from deatwin.studies.report.words import Span, notes
from deatwin.studies.stories import Setting

PLAN = Plan()


def run(setting: Setting) -> Mapping[str, Any]:
    """Record the actuators, propagate uncertainty, compare them, and write the report."""
    record = setting.record()
    study = carry_out(setting.seed, PLAN, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.95, "judging and drawing")
    rows, fleet = judge(study), study.consistency
    page = StoryPage(
        title="frequency-uncertainty",
        sentence=f"{_answer(fleet)} {reached(rows)} stated goals are reached.",
        rows=rows,
        notes=notes(__package__, **_numbers(study)),
        figures=[*known_drawings(study.known), *fleet_drawings(fleet)],
        tables=tables(study),
    )
    groups = ("level", "steady", "fleet")
    return finish(
        setting.folder,
        record,
        page,
        columns=[dict(zip(("order", "from_Hz", "to_Hz"), column, strict=True)) for column in fleet.columns],
        spread={"predicted": fleet.predicted.tolist(), **{group: fleet.spread(group).tolist() for group in groups}},
        tables={group: _plain(fleet.tables[group]) for group in ("fleet", "steady", "shared")},
    )


def _answer(fleet: Consistency) -> str:
    """How consistent fabrication is, in a few sentences."""
    steady, table, as_is = fleet.spread("steady"), fleet.tables["steady"], fleet.tables["fleet"]
    worst = column_of(fleet.columns[int(np.argmax(steady))], " at ")
    return (
        f"Fabrication alone makes the six differ by {_by_order(fleet, steady)} (standard deviation), most in {worst}, "
        f"and significantly in {counted(table, Agreement.DIFFERENT)} of {len(table.differences)} tests. Their "
        f"histories during the recording raise this to {_by_order(fleet, fleet.spread('fleet'))}. Drift can explain "
        f"{counted(as_is, Agreement.DRIFT)} of the {len(as_is.significant)} differences that are then found."
    )


def _by_order(fleet: Consistency, spread: NDArray[np.float64]) -> str:
    """Ranges over the bands, for each order."""
    percent: dict[int, list[float]] = {}
    for value, (order, _, _) in zip(spread, fleet.columns, strict=True):
        percent.setdefault(order, []).append(100 * value)
    return listed([f"{Span(values):.0f} % in H{SUBSCRIPTS[order]}" for order, values in sorted(percent.items())])


def _numbers(study: Study) -> dict[str, Any]:
    """Numbers of the notes."""
    fleet, repeats = study.consistency, study.consistency.tables["repeats"]
    leading = sorted(fleet.shares, key=lambda name: -float(np.sum(fleet.shares[name])))[:3]
    found = np.array([d.p_value < repeats.level for d in repeats.differences])
    drifting = {d.name for d in fleet.tables["fleet"].drifts if d.drifts}
    return {
        "answer": _answer(fleet),
        "predicted": _by_order(fleet, fleet.predicted),
        "steady": _by_order(fleet, fleet.spread("steady")),
        "leading": [spaced(name).replace(".", " ") for name in leading],
        "unseen": [d.size for d in fleet.tables["steady"].differences if not d.differs],
        "structure": STRUCTURE,
        "factor": FACTOR,
        "repeats": REPEATS,
        "single": 100 * found.mean(),
        "by_column": Span(100 * found.reshape(len(repeats.pairs), -1).mean(axis=0)),
        "slow": SLOW,
        "late": [name for name in DRIFTING if name not in drifting],
        "slower": [f"{one.label} ({one.ratio:.0f})" for one in study.known.speeds if one.ratio < FASTER],
        "faster": FASTER,
    }


def _plain(table: Comparison) -> dict[str, Any]:
    """A comparison as plain data."""
    place = ("order", "from_Hz", "to_Hz")
    sizes = ("size", "p_value", "adjusted")
    return {
        "level": table.level,
        "differences": [
            {key: getattr(d, key) for key in ("first", "second", *place, *sizes)}
            | {"agreement": d.agreement.name.lower()}
            for d in table.differences
        ],
        "drifts": [{key: getattr(d, key) for key in ("name", *place, *sizes, "drifts")} for d in table.drifts],
    }
