"""The stated measures: each lesson's demand, from a closed form or a theorem, and what is reached."""

from __future__ import annotations

import numpy as np

from deatwin.scenarios.regression_lessons.constraint import Plane, Structure
from deatwin.scenarios.regression_lessons.occam import TRUE_DEGREE, Occam, Spread
from deatwin.scenarios.regression_lessons.shrinkage import Orthogonal, Risks
from deatwin.scenarios.regression_lessons.variance import Decomposition
from deatwin.studies.report.story import Measure

SURE = 4.0
"""Standard errors that the largest of some dozens of Monte Carlo means may lie off."""


def constraint_rows(plane: Plane, structure: Structure) -> list[Measure]:
    """Ridge and LASSO as constrained least squares."""
    apart = [float(np.abs(c.point - c.penalised).max()) for c in (plane.ridge, plane.lasso)]
    zero = float(np.abs(plane.lasso.point).min())
    shrunk = np.all(np.diff(plane.shares) < 0)
    return [
        _equal("ridge: minimum on the circle, and the estimate for Lagrange's multiplier as penalty", apart[0], "1e-6"),
        _equal("LASSO: minimum on the diamond, and the point of the path at the multiplier", apart[1], "1e-9"),
        Measure(
            "smaller parameter where the constraint allows 60 % of the norm",
            "zero with the diamond, not with the circle",
            f"{zero:g} and {np.abs(plane.ridge.point).min():.3f}",
            zero == 0 and bool(np.abs(plane.ridge.point).min() > 0),
        ),
        Measure(
            "norm of the ridge parameters as the penalty grows",
            "falls at every step",
            "falls" if shrunk else "does not",
            bool(shrunk),
        ),
        Measure(
            f"LASSO among {len(structure.path.terms)} NARX candidates: optimality conditions at "
            f"{structure.path.penalties.size} knots",
            "met to 1e-9 of the first penalty",
            f"{structure.violation:.1e}",
            structure.violation < 1e-9,
        ),
    ]


def shrinkage_rows(orthogonal: Orthogonal, risks: Risks) -> list[Measure]:
    """Shrinkage and thresholds on orthogonal regressors."""
    at_zero = {name: float(risk[0]) for name, risk in risks.expected.items()}
    return [
        _equal(
            "orthogonal regressors: ridge is z / (1 + penalty), the LASSO the soft threshold of z, the best of "
            "all subsets the hard one",
            orthogonal.worst,
            "1e-9",
        ),
        _within("expected squared error of each, drawn, against its closed form", risks.worst),
        _within("share of parameters that the LASSO sets to zero, drawn, against its closed form", risks.worst_zeros),
        Measure(
            "expected squared error where the true parameter is zero, over that of least squares",
            "below 1 for all three",
            ", ".join(f"{n} {v:.2f}" for n, v in at_zero.items()),
            max(at_zero.values()) < 1,
        ),
    ]


def bias_rows(degrees: Decomposition, penalties: Decomposition) -> list[Measure]:
    """Bias and variance."""
    both = (("degree", degrees), ("ridge penalty", penalties))
    rows = [
        _within(
            f"by {name}: bias² + variance + noise, against the error on new readings in repeated experiments",
            found.worst,
        )
        for name, found in both
    ]
    freedom = max(found.worst_freedom for _, found in both)
    # Least squares is the penalty of zero; it has no bias beyond the degree's own, and the largest variance.
    least, best = float(penalties.expected[0]), float(penalties.expected.min())
    falls = bool(np.all(np.diff(degrees.training) < 0))
    lowest = int(np.argmin(degrees.expected))
    return [
        *rows,
        _within(
            "effective number of parameters: trace of the hat matrix, against the covariance of fitted values "
            "and readings",
            freedom,
        ),
        Measure(
            "bias² as the ridge penalty grows, and variance",
            "one rises, the other falls, at every step",
            f"{penalties.bias[0]:.4f} to {penalties.bias[-1]:.3f}, {penalties.variance[0]:.3f} to "
            f"{penalties.variance[-1]:.3f}",
            bool(np.all(np.diff(penalties.bias) > 0) and np.all(np.diff(penalties.variance) < 0)),
        ),
        Measure(
            "expected error of ridge at its best, over that with the smallest penalty",
            "below 1: some penalty is always better than none (Hoerl and Kennard 1970)",
            f"{best / least:.3f}",
            best < least,
        ),
        Measure(
            "by degree: error on fitted readings, and on new ones",
            "the first falls with every degree, the second has its least inside",
            f"{'falls' if falls else 'does not fall'}; least at degree {degrees.complexity[lowest]:.0f}",
            falls and 0 < lowest < degrees.complexity.size - 1,
        ),
    ]


def occam_rows(found: Occam, spread: Spread) -> list[Measure]:
    """Occam's razor."""
    worst = float(np.abs((found.evidence - found.expected) / found.evidence_error).max())
    peak = int(found.degrees[np.argmax(found.expected)])
    share = float(np.mean(found.peaks == TRUE_DEGREE))
    area = float(np.trapezoid(spread.line, spread.bends))
    off = abs(spread.drawn - spread.expected) / spread.drawn_error
    largest = int(found.degrees[-1])
    return [
        _equal(
            "log evidence of the estimator, against the multivariate t density of the readings",
            found.agreement,
            "1e-8 nats",
        ),
        _within("mean log evidence with known noise, drawn, against its closed form", worst),
        Measure(
            "degree at which its closed form has the peak, for readings of a cubic",
            str(TRUE_DEGREE),
            str(peak),
            peak == TRUE_DEGREE,
        ),
        Measure(
            f"experiments in which the evidence, noise and prior estimated, peaks there ({found.peaks.size})",
            "at least 80 %",
            f"{100 * share:.0f} %",
            share >= 0.8,
        ),
        Measure(
            "training error: falls with every degree in every experiment, so that it chooses the largest",
            f"always degree {largest}",
            f"in {100 * np.mean(found.largest_fit == largest):.0f} %",
            found.monotone and bool(np.all(found.largest_fit == largest)),
        ),
        Measure(
            "share of experiments with a line in which the parabola has the larger evidence",
            f"{100 * spread.expected:.2f} % ± {SURE:.0f} standard errors",
            f"{100 * spread.drawn:.2f} %, {off:.1f} standard errors off; density of area {area:.4f}",
            off < SURE,
        ),
    ]


def _equal(measure: str, apart: float, to: str) -> Measure:
    return Measure(measure, f"equal to {to}", f"{apart:.1e}", apart < float(to.split()[0]))


def _within(measure: str, worst: float) -> Measure:
    return Measure(measure, f"within {SURE:.0f} standard errors everywhere", f"at most {worst:.1f}", worst < SURE)
