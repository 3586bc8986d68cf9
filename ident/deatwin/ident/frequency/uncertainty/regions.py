"""Common base of propagated and sampled uncertainties of a frequency response."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.checks import whole_number
from deatwin.ident.frequency.frozen import Frozen
from deatwin.ident.frequency.response import Band, FrequencyResponse
from deatwin.ident.frequency.uncertainty.gain_phase import Ellipses, region_radius
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertain(Frozen, ABC):
    """A frequency response and its uncertainty.

    Parameters
    ----------
    response : FrequencyResponse
        At the model's own parameters.
    level : float
        Probability of regions and bands where no other is given.
    dof : float
        Degrees of freedom of the parameters' Student-t law; infinite for a normal law.
    """

    response: FrequencyResponse
    level: float
    dof: float

    linearised: ClassVar[bool]

    @property
    @abstractmethod
    def source(self) -> str:
        """Origin of the uncertainty, for legends."""

    @property
    def values(self) -> Complex:
        """The response at the model's own parameters, complex, shape (n,), in ``unit``."""
        return self.response.values

    @property
    def omega(self) -> Array:
        """Angular frequency in rad/s, shape (n,) or (n, order)."""
        return self.response.omega

    @property
    def frequency_Hz(self) -> Array:
        """Frequency in Hz, of the shape of ``omega``."""
        return self.response.frequency_Hz

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self.response.unit

    @property
    def label(self) -> str:
        """Symbol and order, for axes and legends."""
        return self.response.label

    @property
    def gain(self) -> Array:
        """Magnitude of the values, shape (n,), in ``unit``."""
        return self.response.gain

    @property
    def phase_deg(self) -> Array:
        """Phase of the values in degrees, shape (n,), unwrapped where there is one frequency to a value."""
        return self.response.phase_deg

    @property
    @abstractmethod
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n, 2, 2), in the square of ``unit``."""

    @property
    @abstractmethod
    def linear_law(self) -> NDArray[np.bool_]:
        """True where the ellipses describe real and imaginary part, shape (n,)."""

    @abstractmethod
    def joint_covariance(self) -> Array:
        """Return the covariance of all real parts and then all imaginary parts, shape (2n, 2n).

        Raises
        ------
        ModelError
            If it needs more than 2 GiB.
        """

    @abstractmethod
    def gain_band(self, level: float | None = None) -> Band:
        """Return a pointwise band of the gain, in ``unit``.

        Parameters
        ----------
        level : float, optional
            Its probability; ``self.level`` by default.
        """

    @abstractmethod
    def phase_band(self, level: float | None = None) -> Band:
        """Return a pointwise band of the phase in degrees, NaN where the phase is not defined.

        Parameters
        ----------
        level : float, optional
            Its probability; ``self.level`` by default.
        """

    def ellipse(self, level: float | None = None, n_points: int = 73) -> Complex:
        """Return outlines of the regions of a probability in the complex plane, pointwise over frequency.

        Parameters
        ----------
        level : float, optional
            Probability at each frequency, ``self.level`` by default: of both parts jointly (5.99 is the squared radius
            of a normal law at 95 %).
        n_points : int
            Points of each outline, at least 3; the last is the first.

        Returns
        -------
        ndarray of complex, shape (n, n_points)

        Raises
        ------
        ModelError
            If level or number of points are not as described.
        """
        n_points = whole_number(n_points, "n_points", 3)
        angle = np.linspace(0.0, 2 * np.pi, n_points)
        outline = self._ellipses.roots @ np.stack([np.cos(angle), np.sin(angle)])
        real, imaginary = np.moveaxis(outline * self._radius(level)[:, None, None], 1, 0)
        return np.asarray(self.values[:, None] + real + 1j * imaginary)

    def contains(self, other: ArrayLike, level: float | None = None) -> NDArray[np.bool_]:
        """Return whether each ellipse contains a value.

        Parameters
        ----------
        other : array_like of complex, shape (..., n) or ()
            For instance a true response, draws, or 0.
        level : float, optional
            Probability of the ellipses; ``self.level`` by default.

        Returns
        -------
        ndarray of bool, shape (..., n)

        Raises
        ------
        ModelError
            If there are not as many values as frequencies, or the level is not between 0 and 1.
        """
        given = np.asarray(other)
        if given.dtype.kind not in "iufc" or given.shape[-1:] not in ((), self.values.shape):
            raise ModelError(
                f"other holds {given.dtype.name} of shape {given.shape}; it must be one number, or one for each of the "
                f"{self.values.size} frequencies"
            )
        away = given - self.values
        return np.asarray(self._ellipses.squared_distance(away) <= self._radius(level) ** 2)

    @cached_property
    def _ellipses(self) -> Ellipses:
        return Ellipses.of(self.covariance)

    def _radius(self, level: float | None) -> Array:
        return region_radius(self.level if level is None else level, self.dof, self._ellipses.rank)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the response in the complex plane with its regions.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.
        """
        from deatwin.ident.frequency.uncertainty.drawing import plot_plane

        return plot_plane(self, ax)

    def plot_gain(self, ax: Axes | None = None) -> Axes:
        """Draw the gain with its band over frequency.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Raises
        ------
        ModelError
            If there are several frequencies for each value, and their sums do not go one way.
        """
        from deatwin.ident.frequency.uncertainty.drawing import plot_gain

        return plot_gain(self, ax)

    def plot_phase(self, ax: Axes | None = None) -> Axes:
        """Draw the phase with its band over frequency.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Raises
        ------
        ModelError
            If there are several frequencies for each value, and their sums do not go one way.
        """
        from deatwin.ident.frequency.uncertainty.drawing import plot_phase

        return plot_phase(self, ax)

    def to_xarray(self) -> Any:
        """Return values, covariance and bands as an `xarray.Dataset`."""
        dataset = self.response.to_xarray()
        dataset["covariance"] = (("point", "part", "other_part"), self.covariance)
        bands = (("gain", self.gain_band(), self.unit), ("phase", self.phase_band(), "deg"))
        for name, band, unit in bands:
            dataset[f"{name}_low"] = (("point",), band.low, {"units": unit})
            dataset[f"{name}_high"] = (("point",), band.high, {"units": unit})
            dataset[f"{name}_linear_law"] = (("point",), band.linear_law)
        dataset.attrs |= {"level": self.level, "dof": self.dof}
        return dataset
