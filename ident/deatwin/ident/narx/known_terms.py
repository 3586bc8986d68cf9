"""Further estimators for the parameters of a known structure, besides `Fixed` and `Narmax`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.prediction_error import prediction_error_fit
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.svb import SvbNarx
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.recording import Recording


def fit_variational(terms: tuple[Term, ...], recording: Recording) -> NarxModel:
    """Fit known terms by variational Bayes, as `SvbNarx` does each of its steps."""
    usual = SvbNarx()
    data = Regression.on(recording, TermTable(terms))
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


def fit_with_noise(terms: tuple[Term, ...], noise_terms: tuple[Term, ...], recording: Recording) -> NarxModel:
    """Fit known process and noise terms by the smallest prediction error."""
    process = Regression.on(recording, TermTable(terms))
    found = prediction_error_fit(process, noise_terms).estimate
    whole = replace(process, table=TermTable(terms + noise_terms))
    return whole.model(found.theta, found.theta_cov, found.noise_variance, identifier=Fixed(terms=terms))
