"""The base plant, given every fair chance: other readings of what the rig file leaves open compete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.fit import Part
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.name import Candidate, judge, noise_seen
from deatwin.ident.mismatch.search import approach, settle
from deatwin.ident.parallel import run_jobs
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant

__all__ = ["Base", "calibrate_base"]

OPENS_AS_WELL = 1.2
"""Largest ratio of rms residuals on the openings of the experiments for a form to be fitted to all of them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Base:
    """The calibrated base plant, and the rival forms that fit no better.

    Parameters
    ----------
    chosen : Candidate
        The form that the diagnosis goes on with.
    rivals : tuple of Candidate
        The other forms, the best first.
    noise : float
        Standard deviation of the sensor's noise, SI.
    """

    chosen: Candidate
    rivals: tuple[Candidate, ...]
    noise: float


def calibrate_base(bench: Bench) -> Base:
    """Calibrate the base plant in every form that the rig file leaves open.

    Parameters
    ----------
    bench : Bench
        Plant and recordings.

    Returns
    -------
    Base
        The nominal form, or the first rival that leaves no mismatch where the nominal one does. A rival that
        merely fits better does not replace it: a missing effect must not be explained away by a wrong rig.

    Raises
    ------
    SimulationError
        If the plant cannot be simulated on these recordings, in any form.
    """
    plant, fitted, jobs = bench.nominal, bench.fitted, bench.jobs
    forms = [plant, *(plant.with_rig(rig) for rig in plant.rig.rivals())]
    near = run_jobs(approach, [(form, fitted) for form in forms], workers=jobs)
    best = min((c.rms for c in near if c.status.ok), default=np.inf)
    # The first form is the rig file's own; another one stays in the race if it opens nearly as well.
    running = [c.plant for k, c in enumerate(near) if k == 0 or (c.status.ok and c.rms < OPENS_AS_WELL * best)]
    fits = run_jobs(settle, [(form, fitted, plant.rig.noise) for form in running], workers=jobs)
    usable = [fit for fit in fits if fit.status.ok]
    if not usable:
        raise _cannot_simulate(plant, fitted)
    noise = min(noise_seen(fit, fitted) for fit in usable)
    known = [c for c in (judge(bench, fit, noise) for fit in usable) if c is not None]
    if not known:
        raise _cannot_simulate(usable[0].plant, bench.unseen)
    sound = [c for c in known if c.adequate] or [c for c in known if not c.mismatch]
    chosen = sound[0] if sound else known[0]
    rivals = sorted((c for c in known if c is not chosen), key=lambda c: -c.evidence)
    return Base(chosen=chosen, rivals=tuple(rivals), noise=noise)


def _cannot_simulate(plant: Plant, parts: Sequence[Part]) -> SimulationError:
    for part in parts:
        try:
            plant.simulate(part.experiment).require()
        except SimulationError as error:
            return SimulationError(f"the plant as described cannot follow these recordings: {error}")
    return SimulationError("the plant as described cannot follow these recordings")
