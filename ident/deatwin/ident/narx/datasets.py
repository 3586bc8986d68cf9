"""Models and validations as xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.narx.document import to_document
from deatwin.plant.datasets import dataset, squared

if TYPE_CHECKING:
    from deatwin.ident.narx.model import NarxModel
    from deatwin.ident.narx.validate import Validation


def model_dataset(model: NarxModel) -> Any:
    """Terms, parameters and covariance of a model."""
    names = [str(term) for term in model.terms]
    pair, units = ("term", "other_term"), {squared(unit) for unit in model.output_units}
    return dataset(
        {
            "theta": ("term", model.theta),
            "theta_cov": (pair, model.theta_cov),
            "equation": ("term", list(model.equations)),
            "noise_variance": ("output", np.atleast_1d(model.noise_variance), *(units if len(units) == 1 else ())),
        },
        {**{name: (name, names) for name in pair}, "output": ("output", list(model.output_names))},
        {
            "sample_time": model.sample_time,
            "theta_dof": model.theta_dof,
            "input_units": list(model.input_units),
            "input_names": list(model.input_names),
            "output_units": list(model.output_units),
        },
        to_document(model),
    )


def validation_dataset(validation: Validation) -> Any:
    """Fits, correlation tests and whiteness of a validation."""
    lags = np.unique(np.concatenate([test.lags for test in validation.tests] or [np.zeros(0, dtype=np.int64)]))
    values = np.full((len(validation.tests), lags.size), np.nan)
    for row, test in zip(values, validation.tests, strict=True):
        row[np.searchsorted(lags, test.lags)] = test.values
    fits = {
        f"{run}_{name}": ("output", getattr(getattr(validation, run), name))
        for run in ("one_step", "free_run")
        for name in ("mean_square", "nrmse", "percent")
    }
    return dataset(
        {
            **fits,
            "correlation": (("test", "lag"), values),
            "band": ("test", [test.band for test in validation.tests]),
            "p_value": ("test", [test.p_value for test in validation.tests]),
            "whiteness_p_value": ("whiteness", [found.p_value for found in validation.whiteness]),
        },
        {
            "output": ("output", list(validation.output_names)),
            "unit": ("output", list(validation.output_units)),
            "test": ("test", np.array([validation._label(test) for test in validation.tests], dtype=str)),
            "lag": ("lag", lags),
        },
        {
            "n_samples": validation.n_samples,
            "level": validation.level,
            "exact": validation.exact,
            "status": validation.status.name,
            "advice": validation.status.value,
            "diverged_at_s": [time for _, time in validation.diverged],
        },
    )
