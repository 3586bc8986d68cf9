"""Pictures of the variational inference: bounds, relevances and their paths, posterior densities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.panels import panels_or_new
from deatwin.ident.narx.posterior import ThetaPosterior, quantile
from deatwin.ident.narx.terms import Term
from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.narx.svb import PruningStep


Array = NDArray[np.float64]

_NAMED = 10  # paths with a label of their own, as many as there are colours


def draw_bounds(path: Sequence[PruningStep], ax: Axes | None = None) -> Axes:
    """Draw the lower bound over the pruning steps, with the largest marked."""
    axes = axes_or_new(ax)
    bounds = np.array([step.lower_bound for step in path])
    best = int(np.argmax(bounds))
    steps = np.arange(1, bounds.size + 1)
    axes.plot(steps, bounds, marker=".")
    count = len(path[best].terms)
    axes.plot(
        steps[best],
        bounds[best],
        "o",
        color="C3",
        markersize=9,
        fillstyle="none",
        label=f"largest: step {steps[best]}, {count} term{'s' if count > 1 else ''}",
    )
    axes.set_xlabel("pruning step")
    axes.set_ylabel("lower bound (nats)")
    axes.legend()
    return axes


def draw_iterations(step: PruningStep, ax: Axes | None = None) -> Axes:
    """Draw the lower bound over the updates of one step."""
    axes = axes_or_new(ax)
    axes.plot(np.arange(1, len(step.bounds) + 1), step.bounds, marker=".")
    axes.set_xlabel("update")
    axes.set_ylabel("lower bound (nats)")
    axes.set_title(f"{len(step.terms)} terms")
    return axes


def draw_relevance(step: PruningStep, ax: Axes | None = None, *, truth: Sequence[Term] = ()) -> Axes:
    """Draw the relevance of each term of a step, with the threshold and those that it prunes."""
    axes = axes_or_new(ax)
    kept = step.relevance > step.threshold
    for chosen, style, label in ((kept, "o", "kept"), (~kept, "x", "pruned")):
        axes.plot(step.indices[chosen], step.relevance[chosen], style, markersize=4, label=label)
    true = np.array([term in set(truth) for term in step.terms])
    if true.any():
        axes.plot(
            step.indices[true], step.relevance[true], "s", markersize=10, fillstyle="none", color="C2", label="true"
        )
    axes.axhline(step.threshold, color="0.4", linestyle="--", label="threshold")
    axes.set_yscale("log")
    axes.set_xlabel("candidate")
    axes.set_ylabel("relevance 1/E[α]")
    axes.set_title(f"{len(step.terms)} terms")
    axes.legend()
    return axes


def draw_relevance_paths(path: Sequence[PruningStep], ax: Axes | None = None) -> Axes:
    """Draw the relevance of every candidate over the pruning steps, up to the one that prunes it."""
    axes = axes_or_new(ax)
    relevance = np.full((len(path), len(path[0].terms)), np.nan)
    for row, step in zip(relevance, path, strict=True):
        row[np.searchsorted(path[0].indices, step.indices)] = step.relevance
    lasting = np.argsort(np.isnan(relevance).sum(axis=0), kind="stable")
    steps = np.arange(1, len(path) + 1)
    axes.plot(steps, relevance[:, lasting[_NAMED:]], color="0.75", linewidth=0.6)
    for j in lasting[:_NAMED]:
        axes.plot(steps, relevance[:, j], label=str(path[0].terms[j]))
    bounds = [step.lower_bound for step in path]
    axes.axvline(int(np.argmax(bounds)) + 1, color="0.4", linestyle="--", label="largest bound")
    axes.set_yscale("log")
    axes.set_xlabel("pruning step")
    axes.set_ylabel("relevance 1/E[α]")
    axes.set_xlim(0, 1.6 * len(path))  # room for the names beside the paths
    axes.legend(fontsize="small", loc="upper right")
    return axes


def draw_densities(
    posterior: ThetaPosterior, axes: Sequence[Axes] | None, truth: Array | None, level: float
) -> list[Axes]:
    """Draw the marginal density of each parameter, its central interval shaded. Shapes: `truth` (n_terms,)."""
    model = posterior.model
    panels = panels_or_new(axes, len(model.terms), height=1.3)
    intervals = posterior.interval(level)
    reach = quantile(0.9999, model.theta_dof)
    for m, panel in enumerate(panels):
        middle, scale = model.theta[m], posterior.scale[m]
        ends = [middle - reach * scale, middle + reach * scale]
        if truth is not None:
            ends = [min(ends[0], truth[m]), max(ends[1], truth[m])]
        values = np.linspace(ends[0], ends[1], 401)
        density = posterior.density(m, values)
        panel.plot(values, density, color="C0")
        inside = (values >= intervals[m, 0]) & (values <= intervals[m, 1])
        panel.fill_between(
            values[inside], density[inside], color="C0", alpha=0.3, linewidth=0, label=f"{100 * level:g} %"
        )
        if truth is not None:
            panel.axvline(truth[m], color="C3", linestyle="--", label="true")
        panel.set_yticks([])
        panel.set_ylabel(str(model.terms[m]), rotation=0, horizontalalignment="right", verticalalignment="center")
    if panels:
        panels[0].legend(fontsize="small")
        panels[-1].set_xlabel("parameter")
    return panels
