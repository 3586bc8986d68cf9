"""Chapter 3's lessons on regression: constraint, bias and variance, Occam's razor, each with a check.

Why ridge shrinks and the LASSO selects is a picture of an ellipse that touches a circle or a diamond; why either helps
is a sum of bias and variance; and why the evidence finds the right complexity is an area that every model has to share
out. Each picture comes with measures whose demanded value is a closed form or a theorem; the estimators are those
that identify NARX models.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deatwin.ident.parallel import spawn_generators
from deatwin.scenarios.regression_lessons import constraint, figures, occam, shrinkage, variance, verdicts
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import Note, StoryPage, write_story
from deatwin.studies.stories import Setting

__all__ = ["run"]


def run(setting: Setting) -> Mapping[str, Any]:
    """Work out the lessons, judge and draw them."""
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    generators = spawn_generators(setting.seed, 7)
    setting.progress(0.0, "ridge and LASSO under their constraints")
    plane, structure = constraint.plane(generators[0]), constraint.structure(generators[1])
    orthogonal, risks = shrinkage.orthogonal(generators[2]), shrinkage.risks(generators[3])
    setting.progress(0.2, "bias and variance")
    degrees, penalties = variance.by_degree(generators[4]), variance.by_penalty(generators[5])
    setting.progress(0.5, "Occam's razor")
    found = occam.occam(generators[6])
    spread = occam.spread(generators[6])
    setting.progress(0.9, "drawing")
    rows = [
        *verdicts.constraint_rows(plane, structure),
        *verdicts.shrinkage_rows(orthogonal, risks),
        *verdicts.bias_rows(degrees, penalties),
        *verdicts.occam_rows(found, spread),
    ]
    made = [
        figures.constraint(plane),
        figures.paths(plane, structure),
        figures.shrinking(orthogonal, risks),
        figures.overfitting(degrees),
        figures.bias_and_variance(degrees, penalties),
        figures.razor(found),
        figures.two_models(spread),
    ]
    for drawing, columns in made:
        setting.folder.csv(drawing.data, columns)
    sentence = (
        f"What ridge, LASSO and the evidence do, and why: {sum(row.passed for row in rows)} of {len(rows)} stated "
        "measures agree with their closed forms."
    )
    page = StoryPage(
        title="regression-lessons",
        sentence=sentence,
        rows=rows,
        notes=_notes(),
        figures=[drawing for drawing, _ in made],
    )
    write_story(setting.folder, page, record)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows]}
    setting.folder.text("regression-lessons.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _notes() -> list[Note]:
    return [
        Note(
            title="What to take along",
            paragraphs=[
                "A penalty is a constraint: for every penalty there is a size of the circle or of the diamond that "
                "gives the same parameters. The diamond has corners, and an ellipse often touches one first: the LASSO "
                "selects. The circle has none: ridge only shrinks.",
                "Shrinking helps because the error on new readings is bias squared plus variance plus noise, and a "
                "little bias buys a large cut of the variance. How much is best depends on what is not known: the "
                "error on the fitted readings says nothing about it, for it falls with every freedom that is added.",
                "The evidence asks how probable the readings were before the parameters were fitted. A flexible model "
                "has spread its probability over many readings and is outdone by a simpler one that allows them as "
                "well. That is an average over experiments: in some of them one term too many has the largest one.",
            ],
        )
    ]
