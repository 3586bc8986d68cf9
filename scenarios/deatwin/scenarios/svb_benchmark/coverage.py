"""Do the 95 % intervals cover the true parameters, when the structure is right?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import NarxModel, SvbNarx
from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.prediction_error import prediction_error_fit
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import BenchmarkSystem
from deatwin.ident.narx.terms import TermTable
from deatwin.plant.recording import Recording
from deatwin.scenarios.svb_benchmark.trials import draw_of, intervals, system_of

Flags = NDArray[np.bool_]
VARIATIONAL = "variational Bayes"


def least_squares(system: BenchmarkSystem, recording: Recording) -> NarxModel:
    """Fit the true terms by least squares."""
    return Fixed(terms=system.terms).fit(recording).model_


def variational(system: BenchmarkSystem, recording: Recording) -> NarxModel:
    """Fit the true terms by variational Bayes, as `SvbNarx` does each of its steps."""
    usual = SvbNarx()
    data = Regression.on(recording, TermTable(system.terms))
    gram, moment, power = data.gram()
    statistics = Statistics(gram=gram, moment=moment, power=power, n_samples=data.n_samples)
    sizes, output_size = statistics.root_mean_squares, statistics.output_size
    priors = Priors(a0=usual.a0, b0=usual.b0, c0=usual.c0, d0=usual.d0)
    found = fit_relevance(
        statistics.divided(sizes, output_size),
        priors,
        np.full(sizes.size, priors.c0 / priors.d0),
        tolerance=usual.tolerance,
        max_iterations=usual.max_iterations,
    ).posterior
    scales = sizes / output_size
    return data.model(
        found.mean / scales,
        found.covariance / np.outer(scales, scales),
        found.noise_variance * output_size**2,
        identifier=usual,
        theta_dof=2 * found.a,
    )


def with_true_noise(system: BenchmarkSystem, recording: Recording) -> NarxModel:
    """Fit the true terms and the true noise terms by the least prediction error."""
    process = Regression.on(recording, TermTable(system.terms))
    found = prediction_error_fit(process, system.noise_terms).estimate
    whole = replace(process, table=TermTable(system.terms + system.noise_terms))
    return whole.model(found.theta, found.theta_cov, found.noise_variance, identifier=Fixed(terms=system.terms))


def with_chosen_noise(system: BenchmarkSystem, recording: Recording) -> NarxModel:
    """Fit the true terms by the least prediction error, with noise terms that are chosen."""
    return Narmax(Fixed(terms=system.terms)).fit(recording).model_


ESTIMATORS: Mapping[str, Callable[[BenchmarkSystem, Recording], NarxModel]] = MappingProxyType(
    {
        "least squares": least_squares,
        VARIATIONAL: variational,
        "least prediction error, true noise terms": with_true_noise,
        "least prediction error, chosen noise terms": with_chosen_noise,
    }
)
"""How the parameters of a known structure are estimated, by name."""


def covered(name: str, estimator: str, seed: int, number: int, noise_variance: float | None = None) -> Flags:
    """Say which intervals hold the true parameter. Shapes: returns (n_terms,)."""
    system = system_of(name, noise_variance)
    model = ESTIMATORS[estimator](system, draw_of(system, seed, number).recording)
    low, high = intervals(model)
    places = [model.terms.index(term) for term in system.terms]
    return (low[places] <= system.theta) & (system.theta <= high[places])
