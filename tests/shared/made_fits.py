"""Fits and explanations whose residuals are given."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.greybox import Calibration, FitStatus, Part
from deatwin.ident.mismatch import Candidate, DiagnosisProblem
from deatwin.plant import Experiment, Plant, Rig


def made_fit(plant: Any, residuals: NDArray[np.float64], *names: str, **changed: Any) -> Calibration:
    """A settled fit of some parameters, which all move every reading alike and are known to 1."""
    plain = {"covariance": np.eye(len(names)), "jacobian": np.ones((len(residuals), len(names)))}
    ended = {"status": FitStatus.SETTLED, "at_bound": (), "evaluations": 1}
    return Calibration(**{"plant": plant, "names": names, "residuals": residuals, **plain, **ended, **changed})


def made_problem(**given: Any) -> DiagnosisProblem:
    """A diagnosis problem of which a test states only what it needs."""
    parts = {"fitted": (), "unseen": (), "everything": ()}
    plain = {"nominal": None, "effects": (), "jobs": 1, "stated_error": 1e-6, "expected_error": 1e-6}
    return DiagnosisProblem(**{**parts, **plain, **given})


def benched(nominal: Plant, experiment: Experiment, **given: Any) -> DiagnosisProblem:
    """A diagnosis problem in which seven tenths of each record are fitted, and the rest judges."""
    early = tuple(np.arange(record.n_samples) < 0.7 * record.n_samples for record in experiment.recordings)
    fitted, unseen = (Part(experiment=experiment, masks=masks) for masks in (early, tuple(~mask for mask in early)))
    errors = dict.fromkeys(("stated_error", "expected_error"), nominal.rig.model_error)
    parts = {"fitted": (fitted,), "unseen": (unseen,), "everything": (Part.whole(experiment),)}
    return made_problem(nominal=nominal, **{**parts, **errors, **given})


def leaving(fitted: float, unseen: float, *effects: str, rig: Rig, noise: float) -> Candidate:
    """An explanation that leaves residuals of exactly these sizes."""
    left, late = np.tile([fitted, -fitted], 350), np.tile([unseen, -unseen], 150)
    return Candidate(effects=effects, calibration=made_fit(Plant(rig=rig), left, "damping"), unseen=late, noise=noise)
