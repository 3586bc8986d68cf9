"""Linear models and families of them as xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from deatwin.plant.datasets import Variables, dataset

if TYPE_CHECKING:
    from deatwin.control.linear.bands import Banded, FamilyBands
    from deatwin.control.linear.family import LinearFamily
    from deatwin.control.linear.model import LinearModel


def family_dataset(bands: FamilyBands, dimension: str, coords: Variables) -> Any:
    """Gain, modes and stability along operating points or times. `bands` with or without samples."""
    family, modes, each = bands.family, bands.modes, (dimension, "mode")
    quantities = (
        ("operating_output", dimension, bands.operating_output, family.output_unit, "output at rest"),
        ("static_gain", dimension, bands.static_gain, gain_unit(family), "G(1)"),
        ("slowest", dimension, bands.slowest, "s", "time constant of the slowest mode"),
        ("time_constant", each, modes.time_constant, "s", "in which a mode decays to 1/e"),
        ("frequency", each, modes.frequency, "Hz", "natural frequency of a mode"),
        ("damping", each, modes.damping, "", "damping ratio of a mode"),
    )
    variables: dict[str, Any] = {
        "stable": (dimension, bands.stable, "", "whether the model has a stable equilibrium"),
        "stable_share": (dimension, bands.stable_share, "", "share of the samples with a stable equilibrium"),
        "pole": (each, modes.poles, "", "pole in the z plane"),
    }
    for name, dims, banded, unit, meaning in quantities:
        variables |= _banded(name, dims, banded, unit, meaning)
    return dataset(
        variables,
        coords,
        {
            "sample_time": family.sample_time,
            "n_samples": family.n_samples - 1,
            "level": 0.95,
            "input_name": family.input_name,
            "output_name": family.output_name,
            "input_unit": family.input_unit,
            "output_unit": family.output_unit,
        },
    )


def linear_dataset(model: LinearModel) -> Any:
    """Coefficients and covariance of a linear model."""
    names = [f"b_{k}" for k in range(model.numerator.size)] + [f"a_{k}" for k in range(1, model.denominator.size)]
    pair = ("coefficient", "other_coefficient")
    return dataset(
        {
            "numerator": ("b", model.numerator, gain_unit(model), "coefficients of z^0, z^-1, ..."),
            "denominator": ("a", model.denominator, "", "coefficients of z^0, z^-1, ..."),
            "covariance": (pair, model.covariance),
        },
        {name: (name, names) for name in pair},
        {
            "sample_time": model.sample_time,
            "operating_input": model.operating_input,
            "operating_output": model.operating_output,
            "status": model.status.name,
            "advice": model.status.value,
            "detail": model.detail,
            "input_name": model.input_name,
            "output_name": model.output_name,
            "input_unit": model.input_unit,
            "output_unit": model.output_unit,
        },
    )


def gain_unit(signals: LinearFamily | LinearModel) -> str:
    """The unit of a gain."""
    divided = signals.output_unit and signals.input_unit
    return f"{signals.output_unit}/{signals.input_unit}" if divided else signals.output_unit


def _banded(name: str, dimensions: Any, banded: Banded, unit: str, meaning: str) -> dict[str, Any]:
    return {
        name: (dimensions, banded.value, unit, meaning),
        f"{name}_low": (dimensions, banded.low, unit, "2.5 % quantile over the samples"),
        f"{name}_high": (dimensions, banded.high, unit, "97.5 % quantile over the samples"),
    }
