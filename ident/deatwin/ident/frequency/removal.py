"""Compare the correct removal of a model's DC component with deleting its constant term."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class Removal:
    """A model before and after its DC component is removed, with free runs over held-out data."""

    model: NarxModel
    shifted: Deviations  # Model about the equilibrium at the mean of the training commands
    section: Recording
    run: Array
    shifted_run: Array
    deleted_run: Array  # Free run with the constant term deleted, all others unchanged

    @property
    def error(self) -> float:
        """Largest change of the free run due to the correct removal, relative to its stroke."""
        return float(np.abs(self.shifted_run - self.run).max() / np.ptp(self.run))

    @property
    def deleted_error(self) -> float:
        """Rms change due to deleting the constant, in standard deviations of the run; at most 100."""
        difference = np.nan_to_num(self.deleted_run - self.run, nan=np.inf)
        return min(float(np.sqrt(np.mean(np.clip(difference, -1, 1) ** 2)) / self.run.std()), 100.0)


def remove(model: NarxModel, section: Recording) -> Removal:
    """Remove the DC component correctly and by deletion, and simulate all three models."""
    shifted = deviations(model)
    moved, level = shifted.seen(section), shifted.point.output
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
        shifted_run=shifted.model.simulate(moved).outputs[0] + level,
        deleted_run=deleted.simulate(moved).outputs[0] + level,
    )
