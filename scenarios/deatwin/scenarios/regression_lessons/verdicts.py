"""The measures: each lesson's goal is a closed form or a theorem. Their words stand in ``words.toml``."""

from __future__ import annotations

import numpy as np

from deatwin.scenarios.regression_lessons.constraint import Plane, Structure
from deatwin.scenarios.regression_lessons.occam import TRUE_DEGREE, Occam, Spread
from deatwin.scenarios.regression_lessons.shrinkage import Orthogonal, Risks
from deatwin.scenarios.regression_lessons.variance import Decomposition
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
SURE = 4.0
"""Standard errors that the largest of some dozens of Monte Carlo means may lie off."""


def constraint_rows(plane: Plane, structure: Structure) -> list[Measure]:
    """Ridge and LASSO as constrained least squares."""
    circle, diamond = (float(np.abs(c.point - c.penalised).max()) for c in (plane.ridge, plane.lasso))
    zero, kept = (float(np.abs(c.point).min()) for c in (plane.lasso, plane.ridge))
    shrunk, path = bool(np.all(np.diff(plane.shares) < 0)), structure.path
    violation = structure.violation
    return [
        WORDS.measure("circle", circle < 1e-6, apart=circle),
        WORDS.measure("diamond", diamond < 1e-9, apart=diamond),
        WORDS.measure("corner", zero == 0 and kept > 0, zero=zero, kept=kept),
        WORDS.measure("shrinks", shrunk, told="falls" if shrunk else "does not"),
        WORDS.measure("knots", violation < 1e-9, violation=violation, count=len(path.terms), knots=path.penalties.size),
    ]


def shrinkage_rows(orthogonal: Orthogonal, risks: Risks) -> list[Measure]:
    """Shrinkage and thresholds on orthogonal regressors."""
    at_zero = {name: float(risk[0]) for name, risk in risks.expected.items()}
    return [
        WORDS.measure("orthogonal", orthogonal.worst < 1e-9, apart=orthogonal.worst),
        _within("risk", risks.worst),
        _within("zeros", risks.worst_zeros),
        WORDS.measure(
            "gain", max(at_zero.values()) < 1, told=", ".join(f"{name} {risk:.2f}" for name, risk in at_zero.items())
        ),
    ]


def bias_rows(degrees: Decomposition, penalties: Decomposition) -> list[Measure]:
    """Bias and variance."""
    both = (("degree", degrees), ("ridge penalty", penalties))
    # Least squares is the penalty of zero; it has no bias beyond the degree's own, and the largest variance.
    least, best = float(penalties.expected[0]), float(penalties.expected.min())
    exchanged = np.all(np.diff(penalties.bias) > 0) and np.all(np.diff(penalties.variance) < 0)
    falls = bool(np.all(np.diff(degrees.training) < 0))
    lowest = int(np.argmin(degrees.expected))
    return [
        *(_within("parts", found.worst, name=name) for name, found in both),
        _within("freedom", max(found.worst_freedom for _, found in both)),
        WORDS.measure(
            "exchange",
            bool(exchanged),
            p=penalties,
            last_bias=penalties.bias[-1],
            last_variance=penalties.variance[-1],
        ),
        WORDS.measure("penalty", best < least, share=best / least),
        WORDS.measure(
            "degree",
            falls and 0 < lowest < degrees.complexity.size - 1,
            told="falls" if falls else "does not fall",
            least=degrees.complexity[lowest],
        ),
    ]


def occam_rows(found: Occam, spread: Spread) -> list[Measure]:
    """Occam's razor."""
    worst = float(np.abs((found.evidence - found.expected) / found.evidence_error).max())
    peak, largest = int(found.degrees[np.argmax(found.expected)]), int(found.degrees[-1])
    share = float(np.mean(found.peaks == TRUE_DEGREE))
    fitted = float(np.mean(found.largest_fit == largest))
    off = abs(spread.drawn - spread.expected) / spread.drawn_error
    return [
        WORDS.measure("density", found.agreement < 1e-8, apart=found.agreement),
        _within("evidence", worst),
        WORDS.measure("peak", peak == TRUE_DEGREE, TRUE_DEGREE=TRUE_DEGREE, peak=peak),
        WORDS.measure("estimated", share >= 0.8, count=found.peaks.size, share=100 * share),
        WORDS.measure("training", found.monotone and fitted == 1, largest=largest, share=100 * fitted),
        WORDS.measure(
            "parabola",
            off < SURE,
            expected=100 * spread.expected,
            drawn=100 * spread.drawn,
            off=off,
            SURE=SURE,
        ),
    ]


def _within(name: str, worst: float, /, **words: str) -> Measure:
    return WORDS.measure(name, worst < SURE, worst=worst, SURE=SURE, **words)
