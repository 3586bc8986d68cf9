"""Gain and poles over operating points, with bands: what a scheduled controller is made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.linear.bands import FamilyBands
from deatwin.control.linear.family import draw, linearise_many
from deatwin.control.linear.plant import draw_plants, linearise_plants
from deatwin.ident.narx import NarxModel
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.datasets import Metadata, coordinate
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class GainSchedule(FamilyBands):
    """Static gain, modes and stability over operating points, each with its 95 % band over samples.

    Parameters
    ----------
    family : LinearFamily
        Over the operating points; its first sample is the model itself.
    """

    ALONG: ClassVar[str] = "operating_input"
    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "operating_input": coordinate(
            "operating_input", of=attrgetter("operating_inputs"), unit=attrgetter("family.input_unit")
        ),
    }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the static gain over the operating input, with its band.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        self._draw_gain(axes, self.operating_inputs)
        axes.set_xlabel(self._input_label)
        return axes

    def plot_time_constants(self, ax: Axes | None = None) -> Axes:
        """Draw the time constant of each mode over the operating input, with its band.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        self._draw_time_constants(axes, self.operating_inputs)
        axes.set_xlabel(self._input_label)
        return axes

    def plot_poles(self, ax: Axes | None = None) -> Axes:
        """Draw the poles in the z plane, coloured by the operating input; those of samples as a cloud.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        self._draw_poles(axes, self.operating_inputs, self._input_label)
        return axes

    @property
    def _input_label(self) -> str:
        unit = self.family.input_unit
        return f"operating {self.family.input_name}" + (f" ({unit})" if unit else "")


@singledispatch
def gain_schedule(
    source: Any, operating_inputs: ArrayLike, rng: np.random.Generator, samples: int = 200
) -> GainSchedule:
    """Linearise a model over operating points, with samples of what is uncertain in it.

    Parameters
    ----------
    source : NarxModel, CalibratedPlant or Plant
        A model with the covariance of its parameters, or a calibrated plant with that of its own; a plant alone is
        taken as exact.
    operating_inputs : array_like, shape (n_points,)
        Constant inputs in their unit.
    rng : numpy.random.Generator
        Source of the samples.
    samples : int
        How many.

    Returns
    -------
    GainSchedule

    Raises
    ------
    ModelError
        If the source is something else, an operating input is not finite, or there are none.
    """
    raise ModelError(f"a {type(source).__name__} has no gain schedule; give a NarxModel, a CalibratedPlant or a Plant")


@gain_schedule.register
def _of_model(
    source: NarxModel, operating_inputs: ArrayLike, rng: np.random.Generator, samples: int = 200
) -> GainSchedule:
    thetas = np.vstack([source.theta, draw(source, rng, samples)])
    return GainSchedule(family=linearise_many(source, operating_inputs, thetas))


@gain_schedule.register
def _of_calibrated(
    source: CalibratedPlant, operating_inputs: ArrayLike, rng: np.random.Generator, samples: int = 200
) -> GainSchedule:
    plants = (source.plant, *draw_plants(source, rng, samples))
    return GainSchedule(family=linearise_plants(plants, operating_inputs))


@gain_schedule.register
def _of_plant(source: Plant, operating_inputs: ArrayLike, rng: np.random.Generator, samples: int = 200) -> GainSchedule:
    return GainSchedule(family=linearise_plants((source,), operating_inputs))
