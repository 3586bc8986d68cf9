"""Linear models of a NARX model whose parameters change with time: at each time as if they stayed so."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import generator, instance, taking, whole
from deatwin.control.linear.bands import FamilyBands
from deatwin.control.linear.family import LinearFamily, draw, linearise_many
from deatwin.ident.frequency.varying.along_time import checked_inputs, checked_times
from deatwin.ident.frequency.varying.following import followed
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.plant.datasets import Metadata, coordinate
from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Progress = Callable[[float], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class VaryingLinear(FamilyBands):
    """Static gain, modes and stability over time, each with its 95 % band over samples.

    Parameters
    ----------
    family : LinearFamily
        Its points are the times; its first sample is the model itself; those after it are drawn from the covariance of
        each time, with the same standard draws at all times.
    timepts : ndarray, shape (n_times,)
        Increasing times on the experiment's clock, s.
    """

    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))

    ALONG: ClassVar[str] = "time"
    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "operating_input": coordinate("time", of=attrgetter("operating_inputs"), unit=attrgetter("family.input_unit")),
    }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the static gain over time, with its band.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        self._draw_gain(axes, self.timepts)
        axes.set_xlabel("time (s)")
        return axes

    def plot_time_constants(self, ax: Axes | None = None) -> Axes:
        """Draw the time constant of each mode over time, with its band.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        self._draw_time_constants(axes, self.timepts)
        axes.set_xlabel("time (s)")
        return axes

    def plot_poles(self, ax: Axes | None = None) -> Axes:
        """Draw the poles in the z plane, coloured by time; those of samples as a cloud.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        self._draw_poles(axes, self.timepts, "time (s)")
        return axes


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
    """Linearise a model whose parameters change with time.

    At each time it is the linear model of the parameters of this time (frozen), about the equilibrium of this time,
    which is followed from one time to the next. With `deatwin.ident.frequency.hold_equilibrium` the equilibrium
    stays, so that what is left is the change of the dynamics.

    Parameters
    ----------
    trajectory : ThetaTrajectory
        theta(t) of a model of one input and one output, with its covariance.
    operating_input : array_like, shape () or (n_times,), optional
        Constant input, or that of each time, in its unit; the centre of the training data by default.
    times : array_like, shape (n_times,), optional
        Increasing times, s; by default all of the trajectory's, at most 200 of them evenly spread.
    rng : numpy.random.Generator
        Source of the samples.
    samples : int
        Samples at each time.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    VaryingLinear

    Raises
    ------
    ModelError
        If the model has several inputs or outputs, or times or inputs are not as described.
    """
    timepts = checked_times(trajectory, times)
    inputs = checked_inputs(trajectory, operating_input, timepts.size)
    seed = int(rng.integers(2**63))
    families: list[LinearFamily] = []
    models = followed(trajectory, timepts, inputs)
    for model, time, level in zip(models, timepts.tolist(), inputs.tolist(), strict=True):
        # The same standard draws at each time: a sample lies as far from the model at all times, and bands are smooth.
        same = np.random.default_rng(seed)
        family = _of_one_time(trajectory.at(time) if model is None else model, level, same, samples)
        families.append(family if model is not None else _emptied(family))
        if progress is not None:
            progress(len(families) / timepts.size)
    return VaryingLinear(family=_joined(families), timepts=timepts)


def _of_one_time(model: NarxModel, level: float, rng: np.random.Generator, samples: int) -> LinearFamily:
    return linearise_many(model, [level], np.vstack([model.theta, draw(model, rng, samples)]))


def _emptied(family: LinearFamily) -> LinearFamily:
    """The same without any equilibrium: the one that was followed has ended."""
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
    """Families of one point each, as one."""
    names = ("operating_inputs", "operating_outputs", "numerators", "denominators", "exists", "stable", "has_gain")
    joined: dict[str, Any] = {name: np.concatenate([getattr(f, name) for f in families]) for name in names}
    return replace(families[0], **joined)
