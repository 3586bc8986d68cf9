"""Gain and poles at several operating points, with bands, from which a scheduled controller is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import singledispatch
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import generator, instance, taking, whole
from deatwin.control.linear.bands import FamilyBands
from deatwin.control.linear.family import LinearFamily, linearise_many
from deatwin.control.linear.plant import draw_plants, linearise_plants
from deatwin.control.progress import Progress
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.frequency.varying.along_time import checked_inputs, checked_times
from deatwin.ident.frequency.varying.following import followed
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.plant.arrays import Array
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


@dataclass(frozen=True, kw_only=True, eq=False)
class VaryingLinear(FamilyBands):
    """Static gain, modes and stability over time, with 95 % bands from samples of the model's parameters.

    `plot` draws the static gain, `plot_time_constants` the modes, and `plot_poles` the poles.

    Parameters
    ----------
    family : LinearFamily
        Linear models at each time, for each sample of the parameters. The first sample is the estimate itself. The
        others are drawn from the covariance at each time; a sample uses the same standard normal numbers at all times.
    timepts : ndarray, shape (n_times,)
        Increasing times on the experiment's clock, s.
    """

    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))

    ALONG: ClassVar[str] = "time"
    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "operating_input": coordinate("time", of=attrgetter("operating_inputs"), unit=attrgetter("family.input_unit"))
    }

    @property
    def _along(self) -> tuple[Array, str]:
        return self.timepts, "time (s)"


@taking(trajectory=instance(ThetaTrajectory), rng=generator, samples=whole(0))
def linearise_along(
    trajectory: ThetaTrajectory,
    operating_input: ArrayLike | None = None,
    times: ArrayLike | None = None,
    *,
    rng: np.random.Generator,
    samples: int = 200,
    progress: Progress | None = None,
) -> VaryingLinear:
    """Linearise a model whose parameters change with time, along its trajectory.

    At each time the parameters are frozen, and the model is linearised about its equilibrium with these parameters. The
    equilibrium is followed from one time to the next. To see the change of the dynamics alone, first fix the
    equilibrium with `deatwin.ident.frequency.hold_equilibrium`.

    Parameters
    ----------
    trajectory : ThetaTrajectory
        Parameters theta(t), with their covariance, of a model of one input and one output.
    operating_input : array_like, shape () or (n_times,), optional
        Constant input, or one for each time, in its unit; the mean of the training inputs by default.
    times : array_like, shape (n_times,), optional
        Increasing times, s; by default the times of the trajectory, evenly thinned to at most 200.
    rng : numpy.random.Generator
        Random generator for the samples.
    samples : int
        Number of parameter samples at each time, in addition to the estimate.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1.

    Raises
    ------
    ModelError
        If the model has several inputs or outputs, if the times do not increase or lie outside the trajectory, or if
        the inputs are not finite numbers of the stated shape.
    """
    timepts = checked_times(trajectory, times)
    inputs = checked_inputs(trajectory, operating_input, timepts.size)
    seed = int(rng.integers(2**63))
    families: list[LinearFamily] = []
    models = followed(trajectory, timepts, inputs)
    for model, time, level in zip(models, timepts.tolist(), inputs.tolist(), strict=True):
        # The same standard draws at all times keep each sample equally far from the model, so that bands are smooth.
        same = np.random.default_rng(seed)
        one = trajectory.at(time) if model is None else model
        family = linearise_many(one, [level], np.vstack([one.theta, draw_theta(one, same, samples)]))
        families.append(family if model is not None else _emptied(family))
        if progress is not None:
            progress(len(families) / timepts.size)
    return VaryingLinear(family=_joined(families), timepts=timepts)


def _emptied(family: LinearFamily) -> LinearFamily:
    """Mark the family as without equilibrium, because the branch that was followed has ended."""
    nowhere = np.zeros_like(family.exists)
    denominators = np.zeros_like(family.denominators)
    denominators[:, :, 0] = 1.0
    return replace(
        family,
        operating_outputs=np.full(nowhere.shape, np.nan),
        numerators=np.zeros_like(family.numerators),
        denominators=denominators,
        exists=nowhere,
        stable=nowhere,
        has_gain=nowhere,
    )


def _joined(families: list[LinearFamily]) -> LinearFamily:
    """Join families of one point each into one."""
    names = ("operating_inputs", "operating_outputs", "numerators", "denominators", "exists", "stable", "has_gain")
    joined: dict[str, Any] = {name: np.concatenate([getattr(f, name) for f in families]) for name in names}
    return replace(families[0], **joined)
