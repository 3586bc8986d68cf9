"""Gain and poles at several operating points, with bands, from which a scheduled controller is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import generator, taking, whole
from deatwin.control.linear.bands import FamilyBands
from deatwin.control.linear.family import linearise_many
from deatwin.control.linear.plant import draw_plants, linearise_plants
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.narx import NarxModel
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.datasets import Metadata, coordinate
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant


@dataclass(frozen=True, kw_only=True, eq=False)
class GainSchedule(FamilyBands):
    """Static gain, modes and stability over operating points, with 95 % bands from samples of the model's parameters.

    `plot` draws the static gain, `plot_time_constants` the modes, and `plot_poles` the poles.

    Parameters
    ----------
    family : LinearFamily
        Linear models at each operating point, for each sample of the parameters; the first sample is the estimate
        itself.
    """

    ALONG: ClassVar[str] = "operating_input"
    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "operating_input": coordinate(
            "operating_input", of=attrgetter("operating_inputs"), unit=attrgetter("family.input_unit")
        )
    }


@singledispatch
def gain_schedule(
    source: Any, /, operating_inputs: ArrayLike, rng: np.random.Generator, samples: int = 200
) -> GainSchedule:
    """Linearise a model or a plant at several operating points, for samples of its uncertain parameters.

    Parameters
    ----------
    source : NarxModel, CalibratedPlant or Plant
        Model or calibrated plant, with the covariance of its parameters; or a plant, whose parameters count as exact.
    operating_inputs : array_like, shape (n_points,)
        Constant inputs, in their unit.
    rng : numpy.random.Generator
        Random generator for the samples.
    samples : int
        Number of samples of the parameters, in addition to the estimate.

    Raises
    ------
    ModelError
        If the source is of another type, or if the operating inputs are not one or more finite numbers.
    """
    raise ModelError(f"a {type(source).__name__} has no gain schedule; give a NarxModel, a CalibratedPlant or a Plant")


@gain_schedule.register(NarxModel)
@taking(rng=generator, samples=whole(0))
def _of_model(
    source: NarxModel, operating_inputs: ArrayLike, rng: np.random.Generator, samples: int = 200
) -> GainSchedule:
    thetas = np.vstack([source.theta, draw_theta(source, rng, samples)])
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
