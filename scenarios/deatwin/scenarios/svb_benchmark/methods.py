"""The methods that are compared, with the same settings on all systems: for the structure, and for a known one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from deatwin.ident.narx import Fixed, Frols, Lasso, Narmax, NarxIdentifier, NarxModel, Semp, SvbNarx
from deatwin.ident.narx.known_terms import fit_variational, fit_with_noise
from deatwin.ident.narx.systems import BenchmarkSystem
from deatwin.plant import Recording

VARIATIONAL = "variational Bayes"


@dataclass(frozen=True)
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


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "fro": Method(
            "FROLS", "forward regression by error reduction, number of terms by extended BIC", Frols, (0.004, 0.013)
        ),
        "fro-told": Method(
            "FROLS, told the number",
            "forward regression that knows the number of true terms, so that only its order is judged",
            partial(Frols, criterion="none"),
            (0.004, 0.013),
            told=True,
        ),
        "lasso": Method(
            "LASSO",
            "refitted models along the LASSO path, chosen by free-run error on held-out data",
            Lasso,
            (0.12, 0.13),
        ),
        "semp": Method(
            "SEMP",
            "least free-run error with pruning, with tests added to the published rules",
            Semp,
            (0.015, 0.05),
        ),
        "svb": Method(
            "SVB",
            "variational Bayes with automatic relevance determination, as published",
            partial(SvbNarx, clean_up="none"),
            (0.06, 0.85),
        ),
        "svb-clean": Method(
            "SVB with clean-up",
            "variational Bayes whose last steps are corrected by exact evidence",
            partial(SvbNarx, clean_up="evidence"),
            (0.06, 0.85),
        ),
    }
)


ESTIMATORS: Mapping[str, Callable[[BenchmarkSystem, Recording], NarxModel]] = MappingProxyType(
    {
        "least squares": lambda system, record: Fixed(terms=system.terms).fit(record).model_,
        VARIATIONAL: lambda system, record: fit_variational(system.terms, record),
        "least prediction error, true noise terms": lambda system, record: fit_with_noise(
            system.terms, system.noise_terms, record
        ),
        "least prediction error, chosen noise terms": lambda system, record: (
            Narmax(Fixed(terms=system.terms)).fit(record).model_
        ),
    }
)
"""Estimators of the parameters of a known structure."""
