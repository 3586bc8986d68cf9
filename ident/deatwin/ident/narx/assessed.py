"""Attach to a model what its recordings excited and how reliable it is, for the command line and Python users alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.arguments import probability
from deatwin.ident.narx.excited import Excitation, excitation
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.ident.narx.reliance import Reliance, assess_reliance
from deatwin.ident.narx.residual import DIVERGED, DivergedError, free_run_residual
from deatwin.plant.checks import require_samples
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

HELD_OUT = 0.3  # Share at the end of each recording that is not fitted but judges the model
_FEWEST = 500  # Samples of a held-out part: fewer show too little of a slow residual to give its size and memory


def hold_out(recordings: Recordings, share: float = HELD_OUT) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Split each recording into a beginning to which a model is fitted, and an end on which the model is tested.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings of at least 10 samples each.
    share : float
        Share of each recording that is held out, between 0 and 1.

    Returns
    -------
    training, held_out : tuple of Recording
        Beginnings and ends of the recordings, in the order given.

    Raises
    ------
    ModelError
        If a recording has fewer than 10 samples, or `share` is not between 0 and 1.
    """
    probability(share, "share")
    whole = flatten(recordings)
    for record in whole:
        require_samples([record], 10, "identification with a held-out part")
    cuts = [min(max(round(record.n_samples * (1.0 - share)), 1), record.n_samples - 1) for record in whole]
    pairs = [
        (record.section(0, cut), record.section(cut, record.n_samples)) for record, cut in zip(whole, cuts, strict=True)
    ]
    return tuple(first for first, _ in pairs), tuple(last for _, last in pairs)


def assessed(
    model: NarxModel, recordings: Recordings, held_out: Recordings, *, reliance: Reliance | None = None
) -> NarxModel:
    """Return a copy of a model with an assessment of its reliability, as `deatwin identify` saves it.

    The assessment contains the frequency bands that the input excited, and the rms and correlation time of the free-run
    residual. For held-out data, it contains the results of the residual tests and the gain error. The gain error is the
    slope of a regression of the free-run residual on the simulated output. All of these are stored as entries of
    ``provenance``, which the commands `frequency` and `check` read.

    Parameters
    ----------
    model : NarxModel
        Fitted model with one output.
    recordings : Recording, Experiment, or several
        All recordings of the plant, including their held-out parts.
    held_out : Recording, Experiment, or several
        The parts to which the model was not fitted; see `hold_out`.
    reliance : Reliance, optional
        Results of the tests on the held-out parts; computed if omitted.

    Returns
    -------
    NarxModel
        Copy of the model with the assessment added to its provenance. The excited bands are missing if the first input
        of every recording is constant, a ramp, or shorter than 64 samples.
    """
    require_model(model)
    whole, unseen = flatten(recordings), flatten(held_out)
    excited, _ = band_excited(whole)
    told = (assess_reliance(model, unseen) if reliance is None else reliance).provenance
    left = _largest_residual(model, [part for part in unseen if part.n_samples >= _FEWEST] or whole)
    return replace(model, provenance={**model.provenance, **excited, **left, **told})


def band_excited(recordings: Sequence[Recording]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the bands that the inputs excited, as a model stores them, or the reasons why there are none."""
    found, faults = [], []
    for record in recordings:
        if np.ptp(record.inputs[0]) > 0:
            try:
                found.append(excitation(record))
            except DataError as error:
                faults.append(f"{error}; the model does not state up to which frequency it is reliable")
    return (Excitation.joined(found).provenance, ()) if found else ({}, tuple(faults))


def _largest_residual(model: NarxModel, judged: Sequence[Recording]) -> dict[str, str]:
    """Return the free-run residual as a model stores it; if a free run diverges, that fact."""
    try:
        found = [free_run_residual(model, record) for record in judged]
    except DivergedError:
        return dict(DIVERGED)
    except ModelError:
        return {}
    return max(found, key=lambda residual: residual.rms).provenance
