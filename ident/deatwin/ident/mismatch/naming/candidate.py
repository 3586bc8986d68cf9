"""An explanation: a plant with a set of effects, fitted to one part of the recordings and judged on the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part, first_only, free_run_residuals, level_of
from deatwin.ident.mismatch.excess import Excess, excess_of
from deatwin.ident.mismatch.losses import block_losses, evidence
from deatwin.ident.mismatch.model_error import with_model_error
from deatwin.ident.mismatch.naming.contribution import contribution
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.noise import noise_level
from deatwin.ident.soundness import resolution
from deatwin.plant.model import Plant

LONG_ENOUGH = 250
"""Smallest number of samples of an experiment that is judged alone: white noise of 2 µm makes a difference of a third
of a model error of 1.2 µm appear as half of it in only 0.6 % of such experiments."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """Plant with a set of effects, calibrated on the fitted data and judged on the held-out data.

    Parameters
    ----------
    effects : tuple of str
        Canonical names of the effects that were added to the plant; empty for the base plant.
    calibration : Calibration
        Calibration on the fitted data.
    unseen : ndarray, shape (n,)
        Residuals on held-out data, SI.
    noise : float
        Standard deviation of the sensor noise with which the residuals are compared, SI.
    contribution : ndarray, shape (m,)
        Simulated readings with the effects minus those without them, at the fitted samples and with all other
        parameters unchanged, SI. May be empty for the base plant.
    sizes : tuple of (int, int)
        Numbers of fitted and of held-out samples, one pair for each experiment and reading. May be empty if there is
        only one pair.
    measured : ndarray, shape (m + n,)
        Recorded readings, first at the fitted and then at the held-out samples, SI; empty if they are not needed.
    level : ndarray, shape (m + n,)
        Relative noise level by which the residuals were divided; empty if it is constant.
    readings : tuple of str
        Name of the reading for each entry of `sizes`; an empty text is the first reading of the rig. Empty if there is
        only one reading.
    log_share : float
        Natural logarithm of the prior probability of the places at which the effects act. All places of an effect are
        equally probable.
    log_size : float
        Natural logarithm of the prior density of the strengths of effects that do not act at their usual place. The
        density is relative to its maximum, so the value is 0 or less.
    """

    effects: tuple[str, ...]
    calibration: Calibration
    unseen: np.ndarray
    noise: float
    contribution: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sizes: tuple[tuple[int, int], ...] = ()
    measured: np.ndarray = field(default_factory=lambda: np.zeros(0))
    level: np.ndarray = field(default_factory=lambda: np.zeros(0))
    readings: tuple[str, ...] = ()
    log_share: float = 0.0
    log_size: float = 0.0

    @cached_property
    def fitted_test(self) -> Excess:
        """Test whether the residual on fitted data exceeds noise and model error."""
        return excess_of(self.calibration.residuals, self.noise, self.calibration.plant.rig.model_error)

    @cached_property
    def unseen_test(self) -> Excess:
        """Test whether the residual on held-out data exceeds noise and model error."""
        return excess_of(self.unseen, self.noise, self.calibration.plant.rig.model_error)

    def with_floor(self, model_error: float) -> Candidate:
        """Return the same candidate, whose residuals are compared with another model error.

        Parameters
        ----------
        model_error : float
            Model error, rms, SI.

        Returns
        -------
        Candidate
        """
        plant = with_model_error(self.calibration.plant, model_error)
        return replace(self, calibration=replace(self.calibration, plant=plant))

    def solved_like(self, other: Plant) -> Candidate:
        """Return the same candidate, integrated with as many stages and steps as another plant.

        Parameters
        ----------
        other : Plant
            Plant with the wanted `Plant.stages` and `Plant.steps`.

        Returns
        -------
        Candidate
        """
        return replace(self, calibration=self.calibration.solved_like(other))

    @property
    def mismatch(self) -> bool:
        """True if the residuals significantly exceed noise and model error, on fitted or on held-out data."""
        return self.fitted_test.mismatch or self.unseen_test.mismatch

    @property
    def adequate(self) -> bool:
        """True if the candidate explains the recordings.

        On fitted data, the residuals must not exceed noise and model error at all. On held-out data, they must not
        exceed these significantly.
        """
        return self.fitted_test.within_error and not self.unseen_test.mismatch

    @property
    def residuals(self) -> np.ndarray:
        """Residuals on fitted and then on held-out data, shape (m + n,), SI."""
        return np.concatenate([self.calibration.residuals, self.unseen])

    @property
    def fitted_part(self) -> Candidate:
        """Return the same candidate without held-out data."""
        size = self.calibration.residuals.size
        return replace(
            self,
            unseen=np.zeros(0),
            sizes=tuple((fitted, 0) for fitted, _ in self.sizes),
            measured=self.measured[:size],
            level=self.level[:size],
        )

    @property
    def pieces(self) -> tuple[int, ...]:
        """Numbers of samples of the pieces of ``residuals``: first all fitted pieces, then all held-out pieces."""
        sizes = self.sizes or ((self.calibration.residuals.size, self.unseen.size),)
        return tuple(size for part in zip(*sizes, strict=True) for size in part if size)

    @property
    def readings_of_pieces(self) -> tuple[str, ...]:
        """Name of the reading in each of the ``pieces``; empty if there is only one reading."""
        pairs = (zip(self.readings, part, strict=True) for part in zip(*self.sizes, strict=True) if self.readings)
        return tuple(name for part in pairs for name, size in part if size)

    @property
    def losses(self) -> np.ndarray:
        """Mean square residual of each block of at most 50 successive samples, on fitted and then on held-out data."""
        return np.concatenate([block_losses(self.calibration.residuals), block_losses(self.unseen)])

    @property
    def mean_squares(self) -> np.ndarray:
        """Mean square of all residuals, then that of each experiment with at least 250 samples, SI."""
        parts = [
            np.split(residuals**2, np.cumsum([pair[part] for pair in self.sizes])[:-1])
            for part, residuals in enumerate((self.calibration.residuals, self.unseen))
        ]
        each = [np.concatenate(squares) for squares in zip(*parts, strict=True)]
        return np.array([np.mean(np.concatenate(each)), *(e.mean() for e in each if e.size >= LONG_ENOUGH)])

    @property
    def log_prior(self) -> float:
        """Sum of ``log_share`` and ``log_size``: logarithm of the prior of the effects' places and strengths."""
        return self.log_share + self.log_size

    @property
    def evidence(self) -> float:
        """Logarithm of the evidence from all data (Schwarz' approximation), plus ``log_prior``, nats."""
        return evidence(self.losses, len(self.calibration.names)) + self.log_prior


def judge(problem: DiagnosisProblem, calibration: Calibration, noise: float) -> Candidate | None:
    """Simulate a fitted plant on the held-out part; return it with its residuals, or None if it cannot be simulated."""
    residuals = free_run_residuals(calibration.plant, problem.unseen)
    if residuals is None:
        return None
    added = tuple(e for e in calibration.plant.effect_names if e not in problem.nominal.effect_names)
    return Candidate(
        effects=added,
        calibration=calibration,
        unseen=residuals,
        noise=noise,
        contribution=contribution(problem, calibration, added),
        sizes=tuple((one.size, other.size) for one, other in zip(problem.fitted, problem.unseen, strict=True)),
        measured=np.concatenate([part.measured for part in (*problem.fitted, *problem.unseen)]),
        level=level_of((*problem.fitted, *problem.unseen)),
        readings=tuple(part.reading for part in problem.fitted),
        log_share=problem.log_share(added),
        log_size=problem.log_size(added, calibration.plant),
    )


def noise_seen(fit: Calibration, parts: Sequence[Part]) -> float:
    """Return the noise of the first reading as a fit shows it, SI; at least that of its data sheet and of its steps."""
    parts = first_only(parts)
    sizes = [int(mask.sum()) for part in parts for mask in part.masks if mask.any()]
    residuals, commands = (
        np.split(whole[: sum(sizes)], np.cumsum(sizes)[:-1])
        for whole in (fit.residuals, np.concatenate([part.commands for part in parts]))
    )
    level = noise_level(residuals, fit.plant.rig.sample_time, fit.plant.rig.noise, commands).level
    steps = max(resolution(part.measured) for part in parts)
    return max(level, steps / float(np.sqrt(12.0)))


@dataclass(frozen=True, kw_only=True)
class Distance:
    """Squared distance d² between the readings that two explanations predict for the recorded commands.

    One explanation is first refitted to the readings that the other predicts. Two explanations are distinguished if d²
    is at least 16.

    Parameters
    ----------
    effects : tuple of str
        Names of the two explanations; several effects are joined by ``+``.
    d2 : float
        Sum over all samples of the squared difference of the predicted readings, divided by the variance of noise and
        model error; dimensionless. The value is only a first-order approximation if the residuals of the two
        explanations already differ by more than the model error.
    """

    effects: tuple[str, str]
    d2: float
