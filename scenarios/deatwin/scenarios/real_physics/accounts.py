"""What a story with a diagnosis says in rows and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deatwin.ident.mismatch import Diagnosis
from deatwin.studies.report.story import Row, Table

if TYPE_CHECKING:
    from deatwin.scenarios.real_physics.case import Case, Trial


def measures(case: Case, diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Row]:
    """Hold a diagnosis and its free runs against what is demanded."""
    causes = [cause.effect for cause in diagnosis.causes]
    right = bool(causes) and set(causes) <= set(case.documented) and diagnosis.verdict.value == "named"
    rows = [
        Row(
            measure="The physics that is documented is named, and no other",
            demanded=f"named: {' or '.join(case.documented)}",
            reached=f"{diagnosis.verdict.value}: {', '.join(causes) or 'no cause'}",
            passed=right,
        )
    ]
    for trial in trials:
        base, amended = trial.base_error / case.scale, trial.amended_error / case.scale
        rows.append(
            Row(
                measure=f"{trial.held_out.name}: free run, rms error, against the base plant's",
                demanded=f"below {base:.4g} {case.unit}",
                reached=f"{amended:.4g} {case.unit}",
                passed=amended < base,
            )
        )
    return rows


def error_table(case: Case, trials: Sequence[Trial]) -> Table:
    """Errors of all free runs over the held-out recordings."""
    rows = []
    for trial in trials:
        name = trial.held_out.name
        rows.append([name, "calibrated base plant", f"{trial.base_error / case.scale:.4g}"])
        rows.append([name, "amended plant", f"{trial.amended_error / case.scale:.4g}"])
        rows += [
            [name, f"{o.method}, {o.terms} parameters", o.failure or f"{o.free_run / case.scale:.4g}"]
            for o in trial.rivals
        ]
    return Table(
        title=f"Free runs in {case.loop} over held-out recordings: root mean square errors",
        columns=["recording", "model", f"error ({case.unit})"],
        rows=rows,
    )


def tried_table(case: Case, diagnosis: Diagnosis) -> Table:
    """Effects that the diagnosis built in, with what each left."""
    tried = diagnosis.candidates
    rows = [
        [
            " and ".join(c.effects).replace("_", " ") or "none",
            f"{c.fitted / case.scale:.4g}",
            f"{c.unseen / case.scale:.4g}",
        ]
        for c in sorted(tried, key=lambda c: c.fitted)
    ]
    return Table(
        title="Effects that were built in",
        rows=rows,
        columns=["effects", f"fitted part ({case.unit})", f"unseen part of the same recordings ({case.unit})"],
    )
