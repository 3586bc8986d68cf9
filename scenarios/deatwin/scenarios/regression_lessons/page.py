"""The measures, of which each demands a closed form or a theorem, and the figures. Their words stand in ``words.toml``."""

from __future__ import annotations

import numpy as np

from deatwin.plant.drawing import Axes
from deatwin.scenarios.regression_lessons import variance
from deatwin.scenarios.regression_lessons.constraint import Constrained, Plane
from deatwin.scenarios.regression_lessons.occam import TRUE_DEGREE, Occam
from deatwin.scenarios.regression_lessons.variance import Decomposition
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
SURE = 4.0  # Standard errors that the largest of some dozens of Monte Carlo means may lie off


def constraint_rows(plane: Plane) -> list[Measure]:
    """Ridge and LASSO as constrained least squares."""
    circle, diamond = (float(np.abs(c.point - c.penalised).max()) for c in (plane.ridge, plane.lasso))
    zero, kept = (float(np.abs(c.point).min()) for c in (plane.lasso, plane.ridge))
    shrunk = bool(np.all(np.diff(plane.shares) < 0))
    return [
        WORDS.measure("circle", circle < 1e-6, apart=circle),
        WORDS.measure("diamond", diamond < 1e-9, apart=diamond),
        WORDS.measure("corner", zero == 0 and kept > 0, zero=zero, kept=kept),
        WORDS.measure("shrinks", shrunk, told="falls" if shrunk else "does not"),
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


def occam_rows(found: Occam) -> list[Measure]:
    """Occam's razor."""
    worst = float(np.abs((found.evidence - found.expected) / found.evidence_error).max())
    peak, largest = int(found.degrees[np.argmax(found.expected)]), int(found.degrees[-1])
    share = float(np.mean(found.peaks == TRUE_DEGREE))
    fitted = float(np.mean(found.largest_fit == largest))
    return [
        WORDS.measure("density", found.agreement < 1e-8, apart=found.agreement),
        _within("evidence", worst),
        WORDS.measure("peak", peak == TRUE_DEGREE, TRUE_DEGREE=TRUE_DEGREE, peak=peak),
        WORDS.measure("estimated", share >= 0.8, count=found.peaks.size, share=100 * share),
        WORDS.measure("training", found.monotone and fitted == 1, largest=largest, share=100 * fitted),
    ]


def _within(name: str, worst: float, /, **words: str) -> Measure:
    return WORDS.measure(name, worst < SURE, worst=worst, SURE=SURE, **words)


HEIGHTS = (0.15, 0.5, 1.5)  # Heights of further ellipses, as multiples of that of the ellipse that touches


def constraint(plane: Plane) -> Drawing:
    """The constraints against the ellipses of the mean squared error."""
    phase = np.linspace(0, 2 * np.pi, 401)
    circle = plane.ridge.size * np.array([np.cos(phase), np.sin(phase)])
    corners = plane.lasso.size * np.array([(1.0, 0), (0, 1.0), (-1.0, 0), (0, -1.0), (1.0, 0)]).T
    with draw((9.6, 4.6)) as figure:
        for axes, found, edge, path, name in zip(
            figure.subplots(1, 2),
            (plane.ridge, plane.lasso),
            (circle, corners),
            (plane.ridge_path, plane.lasso_path),
            ("ridge", "LASSO"),
            strict=True,
        ):
            _ellipses(axes, plane, found)
            axes.fill(*edge, facecolor=Hue.MEASURED, alpha=0.15)
            axes.plot(*edge, color=Hue.MEASURED, linewidth=1.4, label="constraint")
            axes.plot(*path, ":", color=Hue.BEFORE, linewidth=1.6, label="as the constraint widens")
            axes.plot(*plane.least, "x", color=Hue.INK, markersize=8, label="least squares")
            axes.plot(*found.point, "o", color=Hue.BEFORE, markersize=7, label="on the constraint")
            axes.axhline(0, color=Hue.INK, linewidth=0.7)
            axes.axvline(0, color=Hue.INK, linewidth=0.7)
            axes.set(xlabel="first parameter", ylabel="second parameter", xlim=(-1.1, 2.1), ylim=(-1.2, 1.2))
            axes.set_aspect("equal")
            axes.set_title(name, loc="left", fontsize="medium")
        legend_above(figure, axes, 4)
        return WORDS.drawing(figure, "constraint", ridge=plane.ridge, lasso=plane.lasso)


def _ellipses(axes: Axes, plane: Plane, found: Constrained) -> None:
    away = found.point - plane.least
    touching = float(away @ plane.gram @ away)
    grid = np.meshgrid(np.linspace(-1.1, 2.1, 201), np.linspace(-1.2, 1.2, 201))
    apart = np.array(grid) - plane.least[:, None, None]
    height = np.einsum("iab,ij,jab->ab", apart, plane.gram, apart)
    axes.contour(*grid, height, [touching * share for share in HEIGHTS], colors=[Hue.AFTER], linewidths=0.7)
    axes.contour(*grid, height, [touching], colors=[Hue.AFTER], linewidths=1.6)


def bias_and_variance(degrees: Decomposition, penalties: Decomposition) -> Drawing:
    """The expected error and its parts."""
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        for axes, found in ((left, degrees), (right, penalties)):
            axes.plot(found.complexity, found.bias, color=Hue.AFTER, label="bias²")
            axes.plot(found.complexity, found.variance, color=Hue.MARK, label="variance")
            axes.axhline(found.noise, color=Hue.INK, linestyle=":", linewidth=0.9, label="noise")
            axes.plot(found.complexity, found.expected, color=Hue.BEFORE, linewidth=1.8, label="their sum")
            axes.errorbar(
                found.complexity,
                found.test,
                2 * found.test_error,
                fmt="o",
                color=Hue.BEFORE,
                markersize=4,
                label="error on new readings, drawn",
            )
            axes.plot(
                found.complexity, found.training, "--", color=Hue.MEASURED, label="error on fitted readings, drawn"
            )
        left.set(xlabel="degree", ylabel="mean square", ylim=(0, 1.05))
        right.set(xlabel=f"ridge penalty, degree {variance.RIDGE_DEGREE}", xscale="log")
        legend_above(figure, left, 3)
        best = int(np.argmin(penalties.expected))
        return WORDS.drawing(
            figure,
            "bias_and_variance",
            draws=variance.DRAWS,
            degree=degrees.complexity[np.argmin(degrees.expected)],
            penalty=penalties.complexity[best],
            freedom=penalties.freedom[best],
            count=variance.RIDGE_DEGREE + 1,
        )


def razor(found: Occam) -> Drawing:
    """Evidence, training error and test error by degree."""
    counts = np.array([np.mean(found.peaks == degree) for degree in found.degrees])
    with draw((9.6, 3.8)) as figure:
        left, middle, right = figure.subplots(1, 3)
        left.semilogy(found.degrees, found.training, "--", color=Hue.MEASURED, label="on fitted readings")
        left.semilogy(found.degrees, found.test, color=Hue.BEFORE, label="on new readings")
        left.set(ylabel="mean squared error")
        middle.plot(found.degrees, found.best_fit, "--", color=Hue.MEASURED, label="log likelihood, best fit")
        middle.plot(found.degrees, found.expected, color=Hue.AFTER, label="log evidence, closed form")
        middle.plot(found.degrees, found.evidence, "o", color=Hue.AFTER, markersize=4, label="drawn")
        middle.set(ylabel="nats", ylim=(found.expected[2] - 25, found.best_fit.max() + 15))
        right.bar(found.degrees, counts, color=Hue.AFTER)
        right.set(ylabel="share of largest evidence", ylim=(0, 1))
        for axes in (left, middle, right):
            axes.axvline(TRUE_DEGREE, color=Hue.INK, linestyle=":", linewidth=0.9)
            axes.set_xlabel("degree")
        left.legend(fontsize="small")
        middle.legend(fontsize="small", markerscale=1)
        return WORDS.drawing(figure, "razor", price=np.diff(found.occam_factor)[TRUE_DEGREE:].mean())
