"""The base plant, given every fair chance: other readings of what the rig file leaves open compete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.fit import Part, calibrate
from deatwin.ident.mismatch.detect import noise_floor
from deatwin.ident.mismatch.name import Candidate, judge
from deatwin.ident.parallel import run_jobs
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant

__all__ = ["Base", "calibrate_base"]


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


def calibrate_base(plant: Plant, fitted: Sequence[Part], unseen: Sequence[Part], *, jobs: int = 1) -> Base:
    """Calibrate the base plant; where a mismatch stays, let rival forms of the rig compete.

    Parameters
    ----------
    plant : Plant
        Nominal, without the physics that may be missing.
    fitted, unseen : sequence of Part
        What is fitted, and what only judges.
    jobs : int
        Worker processes.

    Returns
    -------
    Base
        A rival replaces the nominal form only where it alone leaves no mismatch: a missing effect must not be
        explained away by a wrong rig.

    Raises
    ------
    SimulationError
        If the plant cannot be simulated on these recordings, in any form.
    """
    first = _fit(plant, fitted, unseen, None)
    noise = plant.rig.noise
    if first is not None:
        noise = _noise(first, fitted, plant)
        first = judge(first.calibration, unseen, noise)
        if first is not None and first.adequate:
            return Base(chosen=first, rivals=(), noise=noise)
    forms = [plant.with_rig(rig) for rig in plant.rig.rivals()]
    found = run_jobs(_fit, [(form, fitted, unseen, noise) for form in forms], workers=jobs)
    rivals = sorted((c for c in found if c is not None), key=lambda c: -c.evidence)
    known = [*([] if first is None else [first]), *rivals]
    if not known:
        raise _cannot_simulate(plant, fitted)
    chosen = next((c for c in known if c.adequate), known[0])
    return Base(chosen=chosen, rivals=tuple(c for c in known if c is not chosen), noise=noise)


def _fit(plant: Plant, fitted: Sequence[Part], unseen: Sequence[Part], noise: float | None) -> Candidate | None:
    calibration = calibrate(plant, fitted)
    if not calibration.status.ok:
        return None
    return judge(calibration, unseen, plant.rig.noise if noise is None else noise)


def _noise(candidate: Candidate, parts: Sequence[Part], plant: Plant) -> float:
    sizes = [int(mask.sum()) for part in parts for mask in part.masks if mask.any()]
    pieces = np.split(candidate.calibration.residuals, np.cumsum(sizes)[:-1])
    return noise_floor(pieces, plant.rig.sample_time, plant.rig.noise)


def _cannot_simulate(plant: Plant, parts: Sequence[Part]) -> SimulationError:
    for part in parts:
        try:
            plant.simulate(part.experiment).require()
        except SimulationError as error:
            return SimulationError(f"the plant as described cannot follow these recordings: {error}")
    return SimulationError("the plant as described cannot follow these recordings")
