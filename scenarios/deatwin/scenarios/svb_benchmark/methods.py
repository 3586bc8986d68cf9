"""The methods that are compared, each with the same settings on all systems."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from deatwin.ident.narx import Frols, SvbNarx
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.systems import BenchmarkSystem


@dataclass(frozen=True, kw_only=True)
class Method:
    """A way to choose the structure."""

    name: str
    label: str
    line: str  # What it does, in words
    make: Callable[[BenchmarkSystem], NarxIdentifier]
    efforts: tuple[float, float]


def _candidates(system: BenchmarkSystem) -> dict[str, Any]:
    return {"output_lags": system.output_lags, "input_lags": system.input_lags, "degree": system.degree}


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        method.name: method
        for method in (
            Method(
                name="fro",
                label="FRO",
                line="forward regression by error reduction, number of terms by extended BIC",
                make=lambda system: Frols(**_candidates(system)),
                efforts=(0.004, 0.013),
            ),
            Method(
                name="fro-told",
                label="FRO, told the number",
                line="the same, told how many terms are true, so that only its order is judged",
                make=lambda system: Frols(**_candidates(system), max_terms=len(system.terms), criterion="none"),
                efforts=(0.004, 0.013),
            ),
            Method(
                name="lasso",
                label="LASSO",
                line="the LASSO's path, refitted, chosen by free-run error on held-out data",
                make=lambda system: Lasso(**_candidates(system)),
                efforts=(0.12, 0.13),
            ),
            Method(
                name="semp",
                label="SEMP",
                line="least free-run error with pruning, and tests of the package beside the published rules",
                make=lambda system: Semp(**_candidates(system)),
                efforts=(0.015, 0.05),
            ),
            Method(
                name="svb",
                label="SVB",
                line="variational Bayes with automatic relevance determination, as published",
                make=lambda system: SvbNarx(**_candidates(system), clean_up="none"),
                efforts=(0.06, 0.85),
            ),
            Method(
                name="svb-clean",
                label="SVB with clean-up",
                line="the same, its last steps set right by exact evidence",
                make=lambda system: SvbNarx(**_candidates(system), clean_up="evidence"),
                efforts=(0.06, 0.85),
            ),
        )
    }
)
"""By name."""
