"""What each further reading taught: how likely the explanations are with it and without it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.naming.decide import Naming, normalised
from deatwin.ident.mismatch.naming.versus import advantage, likeliest
from deatwin.ident.mismatch.naming.whole import fitted_to_all
from deatwin.ident.parallel import run_jobs

COMPARED = 4
"""Explanations of as many effects as the best one that are compared, the best first."""


def taught(bench: Bench, naming: Naming) -> Iterator[str]:
    """One sentence for each further reading: the odds with it, and those after a fit to all others without it."""
    if naming.best is None:
        return
    count = len(naming.best.effects)
    known = sorted((c for c in naming.candidates if len(c.effects) == count), key=lambda c: -c.evidence)
    for reading in bench.nominal.rig.further:
        parts = tuple(part for part in bench.everything if part.reading != reading.name)
        if len(parts) == len(bench.everything):
            continue
        fits = run_jobs(fitted_to_all, [(c, parts) for c in known[:COMPARED]], workers=bench.jobs)
        fitted = [fit for fit in fits if fit is not None]
        if len(fitted) < 2:
            continue
        first = likeliest(fitted)
        before = normalised({c.effects: float(np.exp(advantage(c, first))) for c in fitted})
        after = normalised({c.effects: max(naming.probabilities.get(c.effects, 0.0), 1e-300) for c in fitted})
        yield f"the reading {reading.name}: with it {_said(after)}; without it {_said(before)}"


def _said(odds: dict[tuple[str, ...], float]) -> str:
    ranked = sorted(odds.items(), key=lambda pair: -pair[1])
    return ", ".join(f"{' + '.join(effects)} {probability:.2f}" for effects, probability in ranked)
