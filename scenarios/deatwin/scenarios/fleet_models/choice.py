"""How many terms: the lower bound of SVB beside the error reduction ratio of FRO (thesis figure 6.12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Frols, SvbNarx
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.terms import Term
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]
THRESHOLDS = (1e-2, 1e-3, 1e-4, 1e-5)
"""Error reduction ratios below which a term is no longer added."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Structures of all sizes along the two paths."""

    terms: Array  # shape (n_steps,): number of terms of each step of SVB
    bounds: Array  # shape (n_steps,): lower bound, nats
    bound_errors: Array  # shape (n_steps,): free-run error over the held-out section, m
    err: Array  # shape (n_path,): error reduction ratio of the 1st, 2nd, ... term of FRO
    err_errors: Array  # shape (n_path,): free-run error of the first 1, 2, ... terms, m

    @property
    def by_bound(self) -> int:
        """Number of terms that the largest bound takes."""
        return int(self.terms[np.argmax(self.bounds)])

    def by_threshold(self, threshold: float) -> int:
        """Number of terms that a threshold of the error reduction ratio takes."""
        below = np.flatnonzero(self.err < threshold)
        return max(int(below[0]) if below.size else self.err.size, 1)


def compare(svb: SvbNarx, fro: Frols, training: Recording, held_out: Recording) -> Choice:
    """Follow both paths."""
    return Choice(
        terms=np.array([len(step.terms) for step in svb.path_], dtype=np.float64),
        bounds=np.array([step.lower_bound for step in svb.path_]),
        bound_errors=np.array([_error(step.terms, training, held_out) for step in svb.path_]),
        err=fro.path_err_,
        err_errors=np.array([_error(fro.path_[:k], training, held_out) for k in range(1, len(fro.path_) + 1)]),
    )


def _error(terms: tuple[Term, ...], training: Recording, held_out: Recording) -> float:
    run = Fixed(terms=terms).fit(training).model_.simulate(held_out)
    return run.rms_error if run.status.ok else np.inf
