"""The stated measures: each lesson's demand, from a closed form or a theorem, and what is reached."""

from __future__ import annotations

import numpy as np

from deatwin.scenarios.regression_lessons.constraint import Plane, Structure
from deatwin.scenarios.regression_lessons.occam import TRUE_DEGREE, Occam, Spread
from deatwin.scenarios.regression_lessons.shrinkage import Orthogonal, Risks
from deatwin.scenarios.regression_lessons.variance import Decomposition
from deatwin.studies.report.story import Row

SURE = 4.0
"""Standard errors that the largest of some dozens of Monte Carlo means may lie off."""
_WITHIN = f"within {SURE:.0f} standard errors everywhere"


def constraint_rows(plane: Plane, structure: Structure) -> list[Row]:
    """Ridge and LASSO as constrained least squares."""
    apart = [float(np.abs(c.point - c.penalised).max()) for c in (plane.ridge, plane.lasso)]
    zero = float(np.abs(plane.lasso.point).min())
    shrunk = np.all(np.diff(plane.shares) < 0)
    return [
        Row(
            measure="ridge: minimum on the circle, and the estimate for Lagrange's multiplier as penalty",
            demanded="equal to 1e-6",
            reached=f"{apart[0]:.1e}",
            passed=apart[0] < 1e-6,
        ),
        Row(
            measure="LASSO: minimum on the diamond, and the point of the path at the multiplier",
            demanded="equal to 1e-9",
            reached=f"{apart[1]:.1e}",
            passed=apart[1] < 1e-9,
        ),
        Row(
            measure="smaller parameter where the constraint allows 60 % of the norm",
            demanded="zero with the diamond, not with the circle",
            reached=f"{zero:g} and {np.abs(plane.ridge.point).min():.3f}",
            passed=zero == 0 and bool(np.abs(plane.ridge.point).min() > 0),
        ),
        Row(
            measure="norm of the ridge parameters as the penalty grows",
            demanded="falls at every step",
            reached="falls" if shrunk else "does not",
            passed=bool(shrunk),
        ),
        Row(
            measure=f"LASSO among {len(structure.path.terms)} NARX candidates: optimality conditions at "
            f"{structure.path.penalties.size} knots",
            demanded="met to 1e-9 of the first penalty",
            reached=f"{structure.violation:.1e}",
            passed=structure.violation < 1e-9,
        ),
    ]


def shrinkage_rows(orthogonal: Orthogonal, risks: Risks) -> list[Row]:
    """Shrinkage and thresholds on orthogonal regressors."""
    at_zero = {name: float(risk[0]) for name, risk in risks.expected.items()}
    return [
        Row(
            measure="orthogonal regressors: ridge is z / (1 + penalty), the LASSO the soft threshold of z, the best of "
            "all subsets the hard one",
            demanded="equal to 1e-9",
            reached=f"{orthogonal.worst:.1e}",
            passed=orthogonal.worst < 1e-9,
        ),
        Row(
            measure="expected squared error of each, drawn, against its closed form",
            demanded=_WITHIN,
            reached=f"at most {risks.worst:.1f}",
            passed=risks.worst < SURE,
        ),
        Row(
            measure="share of parameters that the LASSO sets to zero, drawn, against its closed form",
            demanded=_WITHIN,
            reached=f"at most {risks.worst_zeros:.1f}",
            passed=risks.worst_zeros < SURE,
        ),
        Row(
            measure="expected squared error where the true parameter is zero, over that of least squares",
            demanded="below 1 for all three",
            reached=", ".join(f"{n} {v:.2f}" for n, v in at_zero.items()),
            passed=max(at_zero.values()) < 1,
        ),
    ]


def bias_rows(degrees: Decomposition, penalties: Decomposition) -> list[Row]:
    """Bias and variance."""
    both = (("degree", degrees), ("ridge penalty", penalties))
    rows = [
        Row(
            measure=f"by {name}: bias² + variance + noise, against the error on new readings in repeated experiments",
            demanded=_WITHIN,
            reached=f"at most {found.worst:.1f}",
            passed=found.worst < SURE,
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
        Row(
            measure="effective number of parameters: trace of the hat matrix, against the covariance of fitted values "
            "and readings",
            demanded=_WITHIN,
            reached=f"at most {freedom:.1f}",
            passed=freedom < SURE,
        ),
        Row(
            measure="bias² as the ridge penalty grows, and variance",
            demanded="one rises, the other falls, at every step",
            reached=f"{penalties.bias[0]:.4f} to {penalties.bias[-1]:.3f}, {penalties.variance[0]:.3f} to "
            f"{penalties.variance[-1]:.3f}",
            passed=bool(np.all(np.diff(penalties.bias) > 0) and np.all(np.diff(penalties.variance) < 0)),
        ),
        Row(
            measure="expected error of ridge at its best, over that with the smallest penalty",
            demanded="below 1: some penalty is always better than none (Hoerl and Kennard 1970)",
            reached=f"{best / least:.3f}",
            passed=best < least,
        ),
        Row(
            measure="by degree: error on fitted readings, and on new ones",
            demanded="the first falls with every degree, the second has its least inside",
            reached=f"{'falls' if falls else 'does not fall'}; least at degree {degrees.complexity[lowest]:.0f}",
            passed=falls and 0 < lowest < degrees.complexity.size - 1,
        ),
    ]


def occam_rows(found: Occam, spread: Spread) -> list[Row]:
    """Occam's razor."""
    worst = float(np.abs((found.evidence - found.expected) / found.evidence_error).max())
    peak = int(found.degrees[np.argmax(found.expected)])
    share = float(np.mean(found.peaks == TRUE_DEGREE))
    area = float(np.trapezoid(spread.line, spread.bends))
    off = abs(spread.drawn - spread.expected) / spread.drawn_error
    largest = int(found.degrees[-1])
    return [
        Row(
            measure="log evidence of the estimator, against the multivariate t density of the readings",
            demanded="equal to 1e-8 nats",
            reached=f"{found.agreement:.1e}",
            passed=found.agreement < 1e-8,
        ),
        Row(
            measure="mean log evidence with known noise, drawn, against its closed form",
            demanded=_WITHIN,
            reached=f"at most {worst:.1f}",
            passed=worst < SURE,
        ),
        Row(
            measure="degree at which its closed form has the peak, for readings of a cubic",
            demanded=str(TRUE_DEGREE),
            reached=str(peak),
            passed=peak == TRUE_DEGREE,
        ),
        Row(
            measure=f"experiments in which the evidence, noise and prior estimated, peaks there ({found.peaks.size})",
            demanded="at least 80 %",
            reached=f"{100 * share:.0f} %",
            passed=share >= 0.8,
        ),
        Row(
            measure="training error: falls with every degree in every experiment, so that it chooses the largest",
            demanded=f"always degree {largest}",
            reached=f"in {100 * np.mean(found.largest_fit == largest):.0f} %",
            passed=found.monotone and bool(np.all(found.largest_fit == largest)),
        ),
        Row(
            measure="share of experiments with a line in which the parabola has the larger evidence",
            demanded=f"{100 * spread.expected:.2f} % ± {SURE:.0f} standard errors",
            reached=f"{100 * spread.drawn:.2f} %, {off:.1f} standard errors off; density of area {area:.4f}",
            passed=off < SURE,
        ),
    ]
