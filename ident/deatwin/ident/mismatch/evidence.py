"""What a diagnosis saw, kept for figures and reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.recording import Experiment

if TYPE_CHECKING:
    from deatwin.ident.mismatch.advise.advice import Advice
    from deatwin.ident.mismatch.detect import Detection
    from deatwin.ident.mismatch.discover.discovery import Discovery
    from deatwin.ident.mismatch.gate.gate import Gate
    from deatwin.ident.mismatch.locate import Location
    from deatwin.ident.mismatch.verify import Verification


Readings = tuple[tuple[np.ndarray, ...], ...]


@dataclass(frozen=True, kw_only=True)
class CandidateSummary:
    """An explanation that was tried.

    Parameters
    ----------
    effects : tuple of str
        Empty for the base plant.
    fitted, unseen : float
        Rms residuals on the fitted and on the unseen part, SI.
    d2 : float or None
        Squared distance d² from the chosen explanation on these recordings, where it was computed.
    """

    effects: tuple[str, ...]
    fitted: float
    unseen: float
    d2: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Recordings beside simulations; all in SI.

    Parameters
    ----------
    experiments : tuple of Experiment
        The recordings.
    base : tuple of tuple of ndarray, each of shape (n,)
        The calibrated base plant's readings, for each experiment and record.
    amended : same shape, or None
        The amended plant's, where there are causes.
    unseen : tuple of tuple of ndarray of bool
        Samples that no fit saw before the verdict.
    candidates : tuple of CandidateSummary
        All explanations that were tried, the base plant first.
    noise, model_error : float
        Rms.
    base_model : CalibratedPlant
        The calibrated base plant.
    at_bound : tuple of str
        Its parameters that ended on a bound.
    noise_source : str
        Where the noise is known from.
    checked : Gate or None
        State of the recordings.
    detection : Detection or None
        Whether anything is missing.
    location : Location or None
        Where it is.
    discovery : Discovery or None
        The free form of it.
    advice : Advice or None
        The next experiment.
    verification : Verification or None
        The explanation on unseen data, where there is one.
    rivals : mapping of str to CalibratedPlant
        Plants that the recordings cannot tell from the answer, as they were fitted to the fitted part, by their
        effects joined with ``+`` (``none`` for a plant without any); empty where there are no rivals.
    """

    experiments: tuple[Experiment, ...]
    base: Readings
    amended: Readings | None
    unseen: tuple[tuple[np.ndarray, ...], ...]
    candidates: tuple[CandidateSummary, ...]
    noise: float
    model_error: float
    base_model: CalibratedPlant
    at_bound: tuple[str, ...] = ()
    noise_source: str = ""
    checked: Gate | None = None
    detection: Detection | None = None
    location: Location | None = None
    discovery: Discovery | None = None
    advice: Advice | None = None
    verification: Verification | None = None
    rivals: Mapping[str, CalibratedPlant] = field(default_factory=dict)
