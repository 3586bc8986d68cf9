"""Calibrated plants: a plant with the uncertainty of its parameters and its errors, and its file ``model.json``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from numbers import Real
from operator import attrgetter
from typing import Any, ClassVar, Self

import numpy as np

from deatwin.plant.arguments import each, instance
from deatwin.plant.arrays import read_only, real_numbers
from deatwin.plant.checks import experiment_for
from deatwin.plant.copies import Frozen
from deatwin.plant.datasets import (
    Described,
    Metadata,
    attribute,
    coordinate,
    dataset,
    document,
    simulated_clock,
    variable,
)
from deatwin.plant.documents import Saved
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.stated import LARGEST
from deatwin.plant.safe_read import clipped
from deatwin.plant.simulate import RunStatus

SCHEMA = "deatwin/plant/1"
TWO_SIDED_95 = 1.959964


@dataclass(frozen=True, kw_only=True, eq=False)
class Band(Frozen):
    """Prediction of a further reading: mean and standard deviation in each recording, (n,) each, SI."""

    mean: tuple[np.ndarray, ...]
    deviation: tuple[np.ndarray, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Frozen):
    """Readings that a calibrated plant expects, with their predictive band."""

    mean: tuple[np.ndarray, ...]  # shape (n,): Mean of each recording, SI
    deviation: tuple[np.ndarray, ...]
    status: RunStatus  # End of the simulation; readings after a failure are NaN
    failed_at: float | None  # Clock time of a failure, s
    failed_command: float | None  # Command at that time, in its unit
    advice: str  # Text of the status; for a plant without a state of rest, the equation at fault
    readings: tuple[Reading, ...]  # The first one, and then the further ones
    further: Mapping[str, Band] = field(default_factory=dict)  # Band of each further reading, by name

    def to_xarray(self, experiment: Experiment | Recording) -> Any:
        """Return readings and standard deviation along ``sample``, with coordinates ``time`` in s and ``record``."""
        unit, *units = [one.unit for one in self.readings]
        further = list(zip(self.further.items(), units, strict=False))  # none after a failure
        return dataset(
            {
                "mean": ("sample", np.concatenate(self.mean), unit),
                "deviation": ("sample", np.concatenate(self.deviation), unit),
                **{f"{name}_mean": ("sample", np.concatenate(b.mean), unit) for (name, b), unit in further},
                **{f"{name}_deviation": ("sample", np.concatenate(b.deviation), unit) for (name, b), unit in further},
            },
            simulated_clock(experiment, self.mean),
            {
                "status": self.status.name,
                "advice": self.advice,
                "failed_at_s": self.failed_at,
                "failed_command": self.failed_command,
                "reading_name": self.readings[0].name,
            },
        )


def _known(name: str) -> Callable[[CalibratedPlant], list[Any]]:
    """Return a function that lists one attribute of all parameters of a plant."""
    return lambda known: [getattr(parameter, name) for parameter in known.plant.parameters.values()]


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedPlant(
    Described, Saved, schema=SCHEMA, document=lambda known: known.to_dict(), fields=lambda data: fields_of(data)
):
    """Plant with fitted parameters, the covariance of these parameters, and the rms of noise and model error.

    Parameters
    ----------
    plant : Plant
        Plant with the fitted values.
    noise : float
        Standard deviation of the sensor noise, SI.
    model_error : float
        Rms of the part of the held-out residual that noise does not explain, SI.
    names : tuple of str
        Names of the n fitted parameters.
    covariance : ndarray, shape (n, n)
        Covariance of the fitted parameters. Each parameter is transformed according to its `Scale`: the SI value, its
        logarithm or its reciprocal.
    provenance : mapping of str to str
        Origin of the model, such as files and dates.

    Raises
    ------
    ModelError
        If `plant` is not a `Plant`, `noise` or `model_error` is not a number of at least 0, or a name is not text; or if
        `covariance` does not have one row and one column for each name.
    DataError
        If `covariance` is not an array of real numbers.
    """

    plant: Plant
    noise: float = field(metadata=attribute())
    model_error: float = field(metadata=attribute())
    names: tuple[str, ...] = ()
    covariance: np.ndarray = field(
        default_factory=lambda: np.empty((0, 0)), metadata=variable("fitted", "other_fitted")
    )
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        instance(Plant)(self.plant, "plant")
        for name in ("noise", "model_error"):
            if not isinstance(value := getattr(self, name), Real) or value < 0.0:
                raise ModelError(f"{name} is {clipped(repr(value))}; it must be a number of at least 0")
        each(instance(str))(self.names, "names")
        object.__setattr__(self, "covariance", read_only(real_numbers(self.covariance, "covariance")))
        if np.shape(self.covariance) != (len(self.names), len(self.names)):
            raise ModelError(f"covariance has the shape {np.shape(self.covariance)}, for {len(self.names)} names")

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "parameter": coordinate("parameter", of=_known("name")),
        "value": variable("parameter", of=_known("value")),
        "lower": variable("parameter", of=_known("lower")),
        "upper": variable("parameter", of=_known("upper")),
        "unit": variable("parameter", of=_known("unit")),
        "fitted": coordinate("fitted", of=lambda known: np.array(known.names, dtype=str)),
        "other_fitted": coordinate("other_fitted", of=lambda known: np.array(known.names, dtype=str)),
        "scale": variable(
            "fitted", of=lambda known: [known.plant.parameters[name].scale.value for name in known.names]
        ),
        "units": attribute(of=attrgetter("plant.rig.output_unit")),
        "effects": attribute(of=lambda known: list(known.plant.effect_names)),
        "document": document(lambda known: known.to_dict()),
    }

    @classmethod
    def nominal(cls, plant: Plant) -> Self:
        """Return a `plant` with its nominal values, for functions that need a calibrated plant.

        The values count as exact. Noise and model error are those of the rig.
        """
        return cls(plant=plant, noise=plant.rig.noise, model_error=plant.rig.model_error)

    def predict(self, experiment: Experiment | Recording) -> Prediction:
        """Simulate an experiment from rest, and predict mean and standard deviation of each reading.

        Parameters
        ----------
        experiment : Experiment or Recording
            Experiment to simulate; only its commands are used.

        Raises
        ------
        DataError
            In the same cases as `Plant.simulate`.
        """
        plant = self.plant
        timeline = plant.timeline(experiment_for(plant.rig, experiment))
        run = plant.runner.run_with_sensitivities(**plant.given(timeline))
        rows = [r + 1 for r in timeline.readings]

        def band(values: np.ndarray, slopes: np.ndarray | None, noise: float, model_error: float) -> Band:
            """Return the band of one reading, which is NaN after a failure of the simulation."""
            whole = np.full((2, timeline.commands.size + 1), np.nan)
            whole[0, : values.size] = values
            if slopes is not None:
                whole[1, : values.size] = np.sqrt(self._spread(slopes) + noise**2 + model_error**2)
            return Band(mean=tuple(whole[0, r] for r in rows), deviation=tuple(whole[1, r] for r in rows))

        failed, first = run.failed_at, band(run.outputs, run.sensitivities, self.noise, self.model_error)
        return Prediction(
            mean=first.mean,
            deviation=first.deviation,
            further={
                one.name: band(run.further[:, k], run.further_slopes[:, k], one.noise, one.model_error)
                for k, one in enumerate(plant.rig.further)
                if run.sensitivities is not None
            },
            readings=plant.rig.readings,
            status=run.status,
            advice=run.advice,
            failed_at=None if failed is None else timeline.start + failed * timeline.sample_time,
            failed_command=None if failed is None else float(timeline.commands[failed]),
        )

    def _spread(self, sensitivities: np.ndarray) -> np.ndarray:
        """Return the variance of a reading due to the parameters; `sensitivities` (n, p), returns (n,)."""
        parameters = self.plant.parameters
        columns = [parameters.free.index(n) for n in self.names]
        slopes = np.array([parameters[n].scale.slope(parameters[n].value) for n in self.names])
        jacobian = sensitivities[:, columns] * slopes
        spread = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return np.maximum(spread, 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``model.json``, which carries no code."""
        return {
            "schema": SCHEMA,
            "deatwin": version("deatwin"),
            **self.plant.to_dict(),
            "noise": self.noise,
            "model_error": self.model_error,
            "calibration": {"names": list(self.names), "covariance": self.covariance.tolist()},
            "provenance": dict(self.provenance),
        }


def fields_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the plant in a file, after checks of parameters and sizes."""
    plant, names = Plant.from_dict(data), tuple(data["calibration"]["names"])
    covariance = np.array(data["calibration"]["covariance"], dtype=float).reshape(len(names), len(names))
    _require_parameters(plant, data["parameters"])
    _require_calibration(plant, names, covariance)
    for name in ("noise", "model_error"):
        if not 0.0 <= float(data[name]) <= LARGEST:
            raise ModelError(f"{name} is {float(data[name]):g}; it must be from 0 to {LARGEST:g}")
    return {
        "plant": plant,
        "noise": float(data["noise"]),
        "model_error": float(data["model_error"]),
        "names": names,
        "covariance": covariance,
        "provenance": data["provenance"],
    }


def _require_parameters(plant: Plant, written: Mapping[str, Any]) -> None:
    """Require every parameter with its unit, because a missing one would silently get its published value."""
    for parameter in plant.parameters.values():
        if parameter.name not in written:
            raise ModelError(f"the parameter {parameter.name} is missing")
        if (unit := written[parameter.name].get("unit")) != parameter.unit:
            raise ModelError(f"the parameter {parameter.name} is in {unit!r}; it must be in {parameter.unit!r}")


def _require_calibration(plant: Plant, names: tuple[str, ...], covariance: np.ndarray) -> None:
    free = plant.parameters.free
    for name in names:
        if name not in free:
            raise ModelError(
                f"calibration.names: {clipped(name)} is not a free parameter (free parameters: {', '.join(free)})"
            )
    if len(set(names)) < len(names):
        raise ModelError("calibration.names: a parameter is listed twice")
    if (np.abs(covariance) > LARGEST**2).any():
        raise ModelError(f"calibration.covariance: no variance is larger than {LARGEST**2:g}")
    variances = np.diag(covariance)
    # Correlations, because the sizes of parameters differ widely; a fit leaves rounding errors of about 1e-12 in them.
    scaled = covariance / np.sqrt(np.outer(variances, variances)) if (variances > 0.0).all() else covariance
    if not np.allclose(scaled, scaled.T, atol=1e-6) or (variances < 0.0).any() or _least(scaled) < -1e-6:
        raise ModelError(
            "calibration.covariance is not a covariance: it must be symmetric, without a negative eigenvalue"
        )


def _least(matrix: np.ndarray) -> float:
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2).min(initial=0.0))
