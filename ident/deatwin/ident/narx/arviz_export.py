"""Draws of a NARX model's posterior as ArviZ knows them; needs the extra ``bayes``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.posterior import ThetaPosterior
from deatwin.ident.narx.predictive import regressors
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]


def to_arviz(
    model: NarxModel,
    rng: np.random.Generator,
    *,
    recording: Recording | None = None,
    n_chains: int = 4,
    n_draws: int = 500,
) -> Any:
    """Return independent draws of the posterior in ArviZ's format; a recording adds one-step predictions and
    likelihoods.
    """
    try:
        import arviz
    except ImportError as error:
        raise ModelError('export to ArviZ needs ArviZ: pip install "arviz>=0.18"') from error
    draws = ThetaPosterior(model=model).sample(rng, n_chains * n_draws)
    groups = {"posterior": {"theta": draws.theta, "noise_variance": draws.noise_variance}}
    coords: dict[str, Any] = {"term": _labels(model), "output": list(model.output_names)}
    dims = {"theta": ["term"], "noise_variance": ["output"]}
    if recording is not None:
        groups |= _one_step(model, recording, draws.theta, draws.noise_variance, rng)
        coords["time_s"] = recording.timepts[model.table.max_lag :]
        dims["y"] = ["output", "time_s"]
    shaped = {
        group: {
            name: values if group == "observed_data" else values.reshape(n_chains, n_draws, *values.shape[1:])
            for name, values in variables.items()
        }
        for group, variables in groups.items()
    }
    if int(arviz.__version__.split(".")[0]) >= 1:
        return arviz.from_dict(shaped, coords=coords, dims=dims)
    return arviz.from_dict(**shaped, coords=coords, dims=dims)


def _labels(model: NarxModel) -> list[str]:
    """Return the terms as they print, with the output whose equation they stand in where there are several."""
    if model.n_outputs == 1:
        return [str(term) for term in model.terms]
    names = model.output_names
    return [f"{names[row]}: {term}" for row, term in zip(model.equations, model.terms, strict=True)]


def _one_step(
    model: NarxModel, recording: Recording, theta: Array, variance: Array, rng: np.random.Generator
) -> dict[str, dict[str, Array]]:
    """Return new outputs and the log-likelihood of the measured ones, (n_draws, n_outputs, n), and these."""
    origin = model.output_origin[:, None]
    rows, measured = regressors(model, recording), recording.outputs[:, model.table.max_lag :]
    belongs = np.array(model.equations)
    mean = origin + np.stack(
        [theta[:, belongs == row] @ rows[belongs == row] for row in range(model.n_outputs)], axis=1
    )
    spread = variance[:, :, None]
    if not np.all(spread > 0):
        raise ModelError("the model has no noise variance, so that the recording has no likelihood")
    error = measured - mean
    return {
        "posterior_predictive": {"y": mean + np.sqrt(spread) * rng.standard_normal(mean.shape)},
        "log_likelihood": {"y": -0.5 * (error**2 / spread + np.log(2 * math.pi * spread))},
        "observed_data": {"y": measured},
    }
