"""One structure, estimated in several ways (thesis table 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.estimation import TotalLeastSquares
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.refine import refine
from deatwin.ident.narx.shrinkage import Ridge
from deatwin.ident.narx.terms import Term
from deatwin.ident.narx.validate import Validation, validate
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Terms = Sequence[Term]
NOISE_LAGS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimated:
    """A structure with the parameters of one estimator."""

    name: str
    model: NarxModel  # The structure's terms first; those of the noise after them
    training: Validation
    held_out: Validation


def _with_noise(terms: Terms, section: Recording) -> NarxModel:
    process = Fixed(terms=terms)
    return Narmax(process, noise_lags=NOISE_LAGS, noise_degree=1, criterion="none").fit(section).model_


ESTIMATORS: Mapping[str, Callable[[Terms, Recording], NarxModel]] = MappingProxyType(
    {
        "least squares": lambda terms, section: Fixed(terms=terms).fit(section).model_,
        "ridge": lambda terms, section: Fixed(terms=terms, estimator=Ridge()).fit(section).model_,
        "total least squares": lambda terms, section: (
            Fixed(terms=terms, estimator=TotalLeastSquares()).fit(section).model_
        ),
        "least prediction error": _with_noise,
        "least free-run error": lambda terms, section: refine(Fixed(terms=terms).fit(section).model_, section),
    }
)
"""Estimators of the parameters of given terms; the fourth adds e(k-1) and e(k-2)."""


def estimate_all(terms: Terms, training: Recording, held_out: Recording) -> tuple[Estimated, ...]:
    """Estimate a structure with each of `ESTIMATORS`."""
    found = []
    for name, estimate in ESTIMATORS.items():
        try:
            model = estimate(terms, training)
        except ModelError:
            continue
        found.append(
            Estimated(name=name, model=model, training=validate(model, training), held_out=validate(model, held_out))
        )
    return tuple(found)
