"""Names and roles of explanations and rig variants, for the rows of drawings and tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from deatwin.ident.mismatch.model_error import differences
from deatwin.ident.mismatch.naming.candidate import Candidate, Distance
from deatwin.plant.effects.titles import effects_in_words


class Forms(Protocol):
    """Variants of the base plant, in the form in which `Base` holds them."""

    @property
    def chosen(self) -> Candidate: ...
    @property
    def alternatives(self) -> tuple[Candidate, ...]: ...
    @property
    def noise(self) -> float: ...


class Explanations(Protocol):
    """Explanations that were tried, in the form in which `Naming` holds them."""

    @property
    def base(self) -> Candidate: ...
    @property
    def candidates(self) -> tuple[Candidate, ...]: ...
    @property
    def best(self) -> Candidate | None: ...
    @property
    def alternatives(self) -> tuple[Candidate, ...]: ...
    @property
    def probabilities(self) -> Mapping[tuple[str, ...], float]: ...
    @property
    def distances(self) -> tuple[Distance, ...]: ...
    @property
    def failed(self) -> tuple[str, ...]: ...
    @property
    def noise(self) -> float: ...


@dataclass(frozen=True, kw_only=True)
class Row:
    """One candidate with its name and its role among the others."""

    name: str  # in words
    candidate: Candidate
    role: str  # such as "best explanation"

    @property
    def sizes(self) -> tuple[float, float]:
        """Rms residuals on the fitted and on the held-out part, SI."""
        return self.candidate.fitted_test.rms, self.candidate.unseen_test.rms


def variant_rows(base: Forms) -> list[Row]:
    """Return the variants of the base plant, the chosen one first, named by what they state differently."""
    variants = (base.chosen, *base.alternatives)
    told = differences([c.calibration.plant.rig for c in variants])
    return [
        Row(name=_stated(values) or "base plant", candidate=c, role="chosen" if c is base.chosen else "other form")
        for values, c in zip(told, variants, strict=True)
    ]


def row_of(candidate: Candidate, naming: Explanations) -> Row:
    """Return the row of a candidate, named by its effects and, if it belongs to another rig variant, by that variant."""
    name = in_words(candidate) or "base plant"
    # Candidates of another search belong to another variant of the rig.
    stated, own = differences([c.calibration.plant.rig for c in (naming.base, candidate)])
    if own != stated:
        name = f"{name} ({_stated(own)})"
    return Row(name=name, candidate=candidate, role=_role(candidate, naming))


def in_words(candidate: Candidate) -> str:
    """Return the effects of a candidate in words, such as "creep + sensor lag"."""
    return effects_in_words(" + ".join(candidate.effects))


def _role(candidate: Candidate, naming: Explanations) -> str:
    if candidate is naming.base:
        return "base plant"
    if candidate is naming.best:
        return "best explanation"
    return "not ruled out" if candidate in naming.alternatives else "other"


def _stated(values: Mapping[str, Any]) -> str:
    """Write some fields of a rig in words, such as ``"reading: start of hold, ball: sliding"``."""
    return ", ".join(f"{name.replace('_', ' ')}: {_value(value)}" for name, value in values.items())


def _value(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("_", " ")
