"""What is compared, with the same settings on all systems: ways to choose a structure, and to estimate a known one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from deatwin.ident.narx import Frols, NarxModel, SvbNarx
from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.prediction_error import prediction_error_fit
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.systems import BenchmarkSystem
from deatwin.ident.narx.terms import TermTable
from deatwin.plant.recording import Recording

VARIATIONAL = "variational Bayes"


@dataclass(frozen=True, kw_only=True)
class Method:
    """A way to choose the structure."""

    label: str
    line: str
    make: Callable[..., NarxIdentifier]  # Takes the arguments of an identifier
    effort: tuple[float, float]  # Seconds for a draw of a small and of a large system, about
    told: bool = False  # True if it knows the number of terms

    def for_system(self, system: BenchmarkSystem) -> NarxIdentifier:
        """Make the identifier for a system: it knows lags and degree."""
        given: dict[str, Any] = {"max_terms": len(system.terms)} if self.told else {}
        lags = {"output_lags": system.output_lags, "input_lags": system.input_lags}
        return self.make(**lags, degree=system.degree, **given)


def _told(**given: Any) -> NarxIdentifier:
    return Frols(**given, criterion="none")


def _published(**given: Any) -> NarxIdentifier:
    return SvbNarx(**given, clean_up="none")


def _cleaned(**given: Any) -> NarxIdentifier:
    return SvbNarx(**given, clean_up="evidence")


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "fro": Method(
            label="FRO",
            line="forward regression by error reduction, number of terms by extended BIC",
            make=Frols,
            effort=(0.004, 0.013),
        ),
        "fro-told": Method(
            label="FRO, told the number",
            line="the same, told how many terms are true, so that only its order is judged",
            make=_told,
            effort=(0.004, 0.013),
            told=True,
        ),
        "lasso": Method(
            label="LASSO",
            line="the LASSO's path, refitted, chosen by free-run error on held-out data",
            make=Lasso,
            effort=(0.12, 0.13),
        ),
        "semp": Method(
            label="SEMP",
            line="least free-run error with pruning, and tests of the package beside the published rules",
            make=Semp,
            effort=(0.015, 0.05),
        ),
        "svb": Method(
            label="SVB",
            line="variational Bayes with automatic relevance determination, as published",
            make=_published,
            effort=(0.06, 0.85),
        ),
        "svb-clean": Method(
            label="SVB with clean-up",
            line="the same, its last steps set right by exact evidence",
            make=_cleaned,
            effort=(0.06, 0.85),
        ),
    }
)


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
"""How the parameters of a known structure are estimated."""
