"""Removal of the DC component from a model, and what comes of leaving out a constant instead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.narx import NarxModel, Term
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Removal:
    """A model before and after its DC component is removed."""

    model: NarxModel
    shifted: Deviations  # From the equilibrium at the mean of the training commands
    section: Recording  # Held out; what the free runs are of
    run: Array
    shifted_run: Array
    deleted_run: Array

    @property
    def error(self) -> float:
        """Largest difference that the removal makes, over the stroke."""
        return float(np.abs(self.shifted_run - self.run).max() / np.ptp(self.run))

    @property
    def deleted_error(self) -> float:
        """Root mean square of the difference that deleting makes, over that of the run about its mean; at most 100."""
        difference = np.nan_to_num(self.deleted_run - self.run, nan=np.inf)
        return min(float(np.sqrt(np.mean(np.clip(difference, -1, 1) ** 2)) / self.run.std()), 100.0)

    @property
    def new_terms(self) -> int:
        """How many terms the deviations have that the model has not."""
        return len(set(self.shifted.model.terms) - set(self.model.terms))


def remove(model: NarxModel, section: Recording) -> Removal:
    """Remove the DC component in the right way and in the wrong one, and run all three models free."""
    shifted = deviations(model)
    point = shifted.point
    moved = replace(
        section, inputs=section.inputs - point.operating_input[:, None], outputs=section.outputs - point.output
    )
    kept = [place for place, term in enumerate(model.terms) if term != Term(())]
    deleted = replace(
        model,
        terms=tuple(model.terms[i] for i in kept),
        theta=model.theta[kept],
        theta_cov=model.theta_cov[np.ix_(kept, kept)],
        equations=(),
        operating=None,
    )
    return Removal(
        model=model,
        shifted=shifted,
        section=section,
        run=model.simulate(section).outputs[0],
        shifted_run=shifted.model.simulate(moved).outputs[0] + point.output,
        deleted_run=deleted.simulate(moved).outputs[0] + point.output,
    )
