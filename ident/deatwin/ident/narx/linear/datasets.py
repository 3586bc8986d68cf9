"""A linear model as an xarray dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.linear.document import to_document
from deatwin.plant.datasets import dataset, squared

if TYPE_CHECKING:
    from deatwin.ident.narx.linear.model import LinearModel


Array = NDArray[np.float64]


def model_dataset(model: LinearModel) -> Any:
    """Return polynomials and covariance; ``document`` is the file that `LinearModel.save` writes."""
    length = max(p.size for p in (model.a, model.c, model.d, *model.b, *model.f))

    def whole(polynomial: Array) -> Array:
        return np.pad(polynomial, (0, length - polynomial.size))

    by_input = {name: np.array([whole(p) for p in getattr(model, name)]) for name in ("b", "f")}
    return dataset(
        {
            **{name: ("power", whole(getattr(model, name))) for name in ("a", "c", "d")},
            **{name: (("input", "power"), values) for name, values in by_input.items()},
            "theta": ("coefficient", model.theta),
            "theta_cov": (("coefficient", "other_coefficient"), model.theta_cov),
            "noise_variance": ((), model.noise_variance, squared(model.output_units[0])),
            "offset": ((), model.offset, model.output_units[0]),
        },
        {
            "power": ("power", np.arange(length)),
            "input": ("input", list(model.input_names)),
            "input_unit": ("input", list(model.input_units)),
        },
        {"sample_time": model.sample_time, "output_name": model.output_names[0], "output_unit": model.output_units[0]},
        to_document(model),
    )
