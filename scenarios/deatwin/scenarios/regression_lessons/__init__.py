"""Chapter 3's lessons on regression: constraint, bias and variance, Occam's razor, each with a check.

Why ridge shrinks and the LASSO selects is a picture of an ellipse that touches a circle or a diamond; why either helps
is a sum of bias and variance; and why the evidence finds the right complexity is an area that every model has to share
out. Each picture comes with measures whose demanded value is a closed form or a theorem; the estimators are those
that identify NARX models.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.ident import spawn_generators
from deatwin.scenarios.regression_lessons import constraint, occam, page, variance
from deatwin.studies.report.story import StoryPage, finish, reached
from deatwin.studies.report.words import notes
from deatwin.studies.stories import Setting


def run(setting: Setting) -> Mapping[str, Any]:
    """Compute the lessons, compare them with closed forms, and draw them."""
    record = setting.record()
    generators = spawn_generators(setting.seed, 4)
    setting.progress(0.0, "ridge and LASSO under their constraints")
    plane = constraint.plane(generators[0])
    setting.progress(0.2, "bias and variance")
    degrees, penalties = variance.by_degree(generators[1]), variance.by_penalty(generators[2])
    setting.progress(0.5, "Occam's razor")
    found = occam.occam(generators[3])
    setting.progress(0.9, "drawing")
    rows = [
        *page.constraint_rows(plane),
        *page.bias_rows(degrees, penalties),
        *page.occam_rows(found),
    ]
    told = StoryPage(
        title="regression-lessons",
        sentence=f"{reached(rows)} stated measures of ridge, LASSO and the evidence agree with their closed forms.",
        rows=rows,
        notes=notes(__package__),
        figures=[page.constraint(plane), page.bias_and_variance(degrees, penalties), page.razor(found)],
    )
    return finish(setting.folder, record, told)
