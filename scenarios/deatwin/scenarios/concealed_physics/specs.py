"""What a case of the study is, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from deatwin.plant.errors import DataError, nearest

KINDS = ("clean", "effect", "outside", "pair", "tie")
FORMS = ("drawn", "usual")


@dataclass(frozen=True, kw_only=True)
class CaseSpec:
    """A case: what is concealed, how strongly, and in what kind of recording."""

    name: str  # Unique in its study; fit for a file name
    kind: str  # What it is to show
    effects: tuple[str, ...]  # Concealed mechanisms
    truth: tuple[str, ...]  # A catalogue name for each of them; empty where the catalogue has none
    rivals: tuple[str, ...] = ()
    target_ratio: float
    seed: int
    excitation: str  # Name in `excitations.EXCITATIONS`, or one for each record, joined by ``+``
    records: int = 1  # How many records the experiment has
    noise_share: float = 0.02  # Rms of the sensor's noise over the standard deviation of the motion
    rich: bool = True  # Whether the input is one that tells mechanisms apart
    form: str = "drawn"  # How the film sits on the ball and when readings are taken: at random, or as in most rigs
    library: tuple[str, ...] = ()  # Effects that the diagnosis knows; empty for the whole catalogue

    def __post_init__(self) -> None:
        for what, value, known in (("kind", self.kind, KINDS), ("form", self.form, FORMS)):
            if value not in known:
                raise DataError(f"unknown {what} of case {value!r}{nearest(value, known)} (known: {', '.join(known)})")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, ready for JSON."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The case that `to_dict` described."""
        given: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
        try:
            return cls(**given)
        except TypeError as error:
            raise DataError(f"malformed case: {error}") from None
