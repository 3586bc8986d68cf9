"""Propagate the uncertainty of a model's parameters to its frequency responses, to first order."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import read_only
from deatwin.ident.frequency.response import Band, FrequencyResponse
from deatwin.ident.frequency.uncertainty.gain_phase import Ellipses, Polar, interval_radius, polar
from deatwin.ident.frequency.uncertainty.regions import Quantity, Uncertain, draw_theta, evaluate, response_of
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Metadata, attribute, variable

# Nonlinearity up to which the linear law is accepted: the covariance is then wrong by 6 %, 0.25², and a standard
# deviation by 3 %; at worst, for a departure along the tangent, by 56 % and 25 %.
LIMIT = 0.25

_PAIRS = 32  # pairs of probes: their root mean square is known to about 1/sqrt(2 * 32), an eighth; less with long tails
_ROUNDING = 64 * np.finfo(float).eps  # share of value and parameters below which a departure is rounding
_OUTLINE = 361  # points of an ellipse, which give its extremes to 4e-5 of its longer axis
_HELD = 1 << 22  # complex numbers that the probes may hold at once, 64 MB
_PROBES = 20190501  # seed of the probes, so that the same model always gives the same index


class UncertaintyWarning(UserWarning):
    """Issued if the first-order covariance of a frequency response is invalid; the text gives reason and advice."""


class UncertaintyStatus(Enum):
    """Validity of the first-order propagation of uncertainty.

    The value of each member is a message for the user.
    """

    OK = "the response is linear in the parameters over their uncertainty"
    LOW_GAIN = (
        "the gain is not large against its uncertainty at some frequencies, where gain and phase are not normal: their "
        "bands are the range of the ellipse there, and the phase is undefined where it contains 0"
    )
    BENT = (
        "at the frequencies with linear_law = False, the response is not linear in the parameters over their uncertainty: "
        "ellipses and bands are wrong there; sample the posterior instead, or identify on more data"
    )
    LOST = (
        "the parameters are so uncertain that for some of their likely values the model has no equilibrium at the operating "
        "point, or its stability differs: no covariance describes the response; sample the posterior, identify on more "
        "data or leave out terms"
    )
    CERTAIN = (
        "the model has no covariance of its parameters, so no uncertainty can be propagated: identify a model with one"
    )

    @property
    def ok(self) -> bool:
        """True if first-order propagation is valid for real part, imaginary part, gain and phase at all frequencies."""
        return self is UncertaintyStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class Propagated(Uncertain):
    """Frequency response with its uncertainty, propagated to first order from the model's parameters.

    Parameters
    ----------
    response : FrequencyResponse
        Frequency response at the estimated parameters.
    level : float
        Default probability of confidence regions and bands.
    dof : float
        Degrees of freedom of the parameters' Student-t distribution; infinite for a normal distribution.
    nonlinearity : ndarray, shape (n,)
        Nonlinearity of the response over the uncertainty of the parameters, at each frequency; dimensionless. It is the
        rms difference between the response and its linearisation, divided by the rms change of the linearisation. Both
        are measured as Mahalanobis distances with respect to the covariance.
    lost : float
        Share of the parameter draws of `propagate` with which the model has no equilibrium, or is unstable although it
        is stable with the estimated parameters (or conversely).
    """

    nonlinearity: Array = field(metadata=variable("point"))
    lost: float = field(metadata=attribute())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "law": attribute(of=attrgetter("status.name")),
        "advice": attribute(),
    }

    @property
    def source(self) -> str:
        """Origin of the uncertainty, for legends."""
        return "by propagation"

    @property
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n, 2, 2), in the square of ``unit``."""
        return self.response.covariance

    @cached_property
    def _polar(self) -> Polar:
        return polar(self.values, self.covariance)

    @property
    def gain_phase_covariance(self) -> Array:
        """First-order covariance of gain (in ``unit``) and phase (rad), shape (n, 2, 2)."""
        return self._polar.covariance

    @property
    def linear_law(self) -> NDArray[np.bool_]:
        """True where `nonlinearity` is at most 0.25, so that the covariance ellipse is valid, shape (n,)."""
        return np.asarray(self.nonlinearity <= LIMIT)

    @property
    def gain_nonlinearity(self) -> Array:
        """Nonlinearity of the gain, shape (n,): `nonlinearity`, plus the nonlinearity of the gain as a function of the
        complex response.
        """
        return np.asarray(self.nonlinearity + self._polar.gain_index)

    @property
    def phase_nonlinearity(self) -> Array:
        """Nonlinearity of the phase, shape (n,): `nonlinearity`, plus the nonlinearity of the phase as a function of the
        complex response.
        """
        return np.asarray(self.nonlinearity + self._polar.phase_index)

    @property
    def status(self) -> UncertaintyStatus:
        """Validity of the first-order propagation."""
        if not np.any(self.response.theta_cov):
            return UncertaintyStatus.CERTAIN
        if self.lost > 0:
            return UncertaintyStatus.LOST
        if not np.all(self.linear_law):
            return UncertaintyStatus.BENT
        if np.any(np.maximum(self.gain_nonlinearity, self.phase_nonlinearity) > LIMIT):
            return UncertaintyStatus.LOW_GAIN
        return UncertaintyStatus.OK

    @property
    def advice(self) -> str:
        """Text of the status, with the largest nonlinearity and the number of frequencies at which it is too large."""
        low_gain = self.status is UncertaintyStatus.LOW_GAIN
        index = np.maximum(self.gain_nonlinearity, self.phase_nonlinearity) if low_gain else self.nonlinearity
        failing = int(np.sum(~(index <= LIMIT)))
        largest = float(np.max(index, initial=0.0))
        lost = f"; {self.lost:.0%} of the probed parameters lost the operating point" if self.lost else ""
        return (
            f"{self.status.value} (nonlinearity up to {largest:.2g}, limit {LIMIT:g}, above it at "
            f"{failing} of {index.size} frequencies{lost})"
        )

    def gain_band(self, level: float | None = None) -> Band:
        """Return a pointwise band of the gain, in ``unit``, of probability `level`, by default ``self.level``.

        Where `gain_nonlinearity` exceeds 0.25, the band is the range of the gain over the confidence ellipse of the
        response.
        """
        level = self.level if level is None else level
        holds = self.gain_nonlinearity <= LIMIT
        half = interval_radius(level, self.dof) * np.sqrt(self._polar.covariance[:, 0, 0])
        low, high = (self.gain - half).clip(min=0.0), self.gain + half
        if not holds.all():
            outline = np.abs(self.ellipse(level, _OUTLINE)[~holds])
            low[~holds] = np.where(self._may_be_zero(level)[~holds], 0.0, outline.min(axis=1))
            high[~holds] = outline.max(axis=1)
        return Band(level=level, low=read_only(low), high=read_only(high), linear_law=holds)

    def _may_be_zero(self, level: float) -> NDArray[np.bool_]:
        return self.contains(0.0, level) & ~self._ellipses.beside_zero(self.values)

    def phase_band(self, level: float | None = None) -> Band:
        """Return a pointwise band of the phase in degrees, of probability `level`, by default ``self.level``.

        Where `phase_nonlinearity` exceeds 0.25, the band is the range of the phase over the confidence ellipse of the
        response. If the ellipse contains 0, the phase is undefined and the limits are NaN.
        """
        level = self.level if level is None else level
        holds = self.phase_nonlinearity <= LIMIT
        half = interval_radius(level, self.dof) * np.sqrt(self._polar.covariance[:, 1, 1])
        ends = np.stack([-half, half], axis=-1)
        ends[~holds] = np.nan
        bent = ~holds & ~self._may_be_zero(level)
        if bent.any():
            turned = np.angle(self.ellipse(level, _OUTLINE)[bent] * np.conj(self.values[bent])[:, None])
            ends[bent] = np.stack([turned.min(axis=1), turned.max(axis=1)], axis=-1)
        low, high = self.phase_deg + np.degrees(ends).T
        return Band(level=level, low=read_only(low), high=read_only(high), linear_law=holds)


def propagate(model: NarxModel, quantity: Quantity, *, level: float = 0.95) -> Propagated:
    """Propagate the uncertainty of a model's parameters to a frequency response.

    The covariance of real and imaginary part is J theta_cov J', where J is the exact derivative of both parts with
    respect to the parameters, including the shift of the equilibrium. This covariance is exact if the response is
    linear in the parameters.

    The result's ``nonlinearity`` v is measured over 32 draws of the parameters and their mirror images about the mean.
    The relative error of the covariance is at most about 2v + v²; it is accepted up to v = 0.25.


    Parameters
    ----------
    model : NarxModel
        Model with the covariance ``theta_cov`` of its parameters.
    quantity : callable
        Function that takes a model and returns a FrequencyResponse, for example ``partial(gfrf, order=2, omega=omega)``
        or ``lambda m: output_orders(m, excitation, 3)[1]``.
    level : float
        Default probability of the confidence regions and bands of the result.

    Returns
    -------
    Propagated
        Response with its covariance, nonlinearity, status and advice.

    Warns
    -----
    UncertaintyWarning
        If the first-order covariance is invalid (status ``BENT`` or ``LOST``).

    Raises
    ------
    ModelError
        If the level is not between 0 and 1, if the covariance of the parameters is invalid, or if `quantity` does not
        return a FrequencyResponse.

    References
    ----------
    Jacobs, Dodd, Anderson, "Frequency-domain analysis for nonlinear systems with time-domain model parameter
    uncertainty", IEEE Trans. Automatic Control 64 (2019) 1905-1915, doi:10.1109/TAC.2018.2866474.
    Hall, "On the propagation of uncertainty in complex-valued quantities", Metrologia 41 (2004) 173-177,
    doi:10.1088/0026-1394/41/3/010.
    """
    response = response_of(model, quantity, level)
    nonlinearity, lost = _probe(model, quantity, response)
    found = Propagated(
        response=response, level=level, dof=model.theta_dof, nonlinearity=read_only(nonlinearity), lost=lost
    )
    if found.status in (UncertaintyStatus.BENT, UncertaintyStatus.LOST):
        warnings.warn(f"{found.label}: {found.advice}", UncertaintyWarning, stacklevel=2)
    return found


def _probe(model: NarxModel, quantity: Quantity, response: FrequencyResponse) -> tuple[Array, float]:
    """Return the nonlinearity at each frequency, and the share of test points without the operating point."""
    if not np.any(response.theta_cov):
        return np.zeros(response.values.size), 0.0
    steps = draw_theta(model, np.random.default_rng(_PROBES), _PAIRS) - model.theta
    steps = np.concatenate([steps, -steps])
    ellipses = Ellipses.of(response.covariance)
    least = _ROUNDING * (np.abs(response.values) + np.abs(response.gradient) @ np.abs(model.theta))
    departed, moved, kept = np.zeros(response.values.size), np.zeros(response.values.size), 0
    for some in np.array_split(steps, max(1, len(steps) * response.values.size // _HELD)):
        found = evaluate(model, quantity, response, model.theta + some)
        usable = found.exists & (found.stable == response.status.ok)
        tangent = some[usable] @ response.gradient.T
        departure = found.values[usable] - response.values - tangent
        departure[np.abs(departure) <= least] = 0.0
        departed += ellipses.squared_distance(departure).sum(axis=0)
        moved += ellipses.squared_distance(tangent).sum(axis=0)
        kept += int(usable.sum())
    if not kept:
        return np.full(response.values.size, np.inf), 1.0
    ratio = np.divide(departed, moved, out=np.zeros_like(moved), where=moved > 0)
    return np.sqrt(ratio), 1.0 - kept / len(steps)
