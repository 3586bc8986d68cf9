"""Linear models of a NARX model whose parameters change with time; each takes them as constant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import generator, instance, taking, whole
from deatwin.control.linear.bands import FamilyBands
from deatwin.control.linear.family import LinearFamily, linearise_many
from deatwin.control.progress import Progress
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.frequency.varying.along_time import checked_inputs, checked_times
from deatwin.ident.frequency.varying.following import followed
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Metadata, coordinate


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
