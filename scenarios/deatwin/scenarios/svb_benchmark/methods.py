"""The methods that are compared, with the same settings on all systems: for the structure, and for a known one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from deatwin.ident.narx import Frols, NarxModel, SvbNarx
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.known_terms import fit_variational, fit_with_noise
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.systems import BenchmarkSystem
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
