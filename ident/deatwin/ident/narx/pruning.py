"""Steps of a variational inference that prunes terms, with drawings of its bounds and relevances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new

_NAMED = 10  # most paths with a label of their own, as many as there are colours


@dataclass(frozen=True, kw_only=True, eq=False)
class PruningStep(Described):
    """One step of the pruning by `SvbNarx`.

    Parameters
    ----------
    terms : tuple of Term
        The terms fitted in this step.
    indices : ndarray of int, shape (n_terms,)
        Positions of these terms among the candidates, from 0.
    relevance : ndarray, shape (n_terms,)
        Relevance of each term: 1 / E[alpha], where alpha is the prior precision of the term's parameter. All regressors
        are scaled to a root mean square of about 1.
    threshold : float
        Terms whose relevance does not exceed this threshold are pruned next.
    bounds : tuple of float
        Variational lower bound of the log evidence after each update, in nats.
    """

    terms: tuple[Term, ...]
    indices: NDArray[np.intp] = field(metadata=variable("term", name="index", about="position among the candidates"))
    relevance: Array = field(
        metadata=variable("term", about="1 / E[alpha], for regressors of root mean square about 1")
    )
    threshold: float = field(metadata=attribute())
    bounds: tuple[float, ...] = field(
        metadata=variable("update", name="bound", unit="nat", about="lower bound of the log evidence")
    )

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "term": coordinate("term", of=lambda step: np.array([str(term) for term in step.terms], dtype=str)),
    }

    @property
    def lower_bound(self) -> float:
        """Lower bound of the log evidence after the last update, in nats."""
        return self.bounds[-1]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw on `ax` or new axes the relevance of each term, the threshold, and the terms that are pruned."""
        axes = axes_or_new(ax)
        kept = self.relevance > self.threshold
        for chosen, style, label in ((kept, "o", "kept"), (~kept, "x", "pruned")):
            axes.plot(self.indices[chosen], self.relevance[chosen], style, markersize=4, label=label)
        axes.axhline(self.threshold, color="0.4", linestyle="--", label="threshold")
        axes.set(yscale="log", xlabel="candidate", ylabel="relevance 1/E[α]", title=f"{len(self.terms)} terms")
        axes.legend()
        return axes


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
    axes.set(xlabel="pruning step", ylabel="lower bound (nats)")
    axes.legend()
    return axes


def draw_relevance_paths(path: Sequence[PruningStep], ax: Axes | None = None) -> Axes:
    """Draw the relevance of each candidate over the pruning steps, until it is pruned."""
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
    axes.set(yscale="log", xlabel="pruning step", ylabel="relevance 1/E[α]")
    axes.set_xlim(0, 1.6 * len(path))  # room for the names beside the paths
    axes.legend(fontsize="small", loc="upper right")
    return axes
