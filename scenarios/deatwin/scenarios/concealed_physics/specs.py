"""What a case of the study is, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from deatwin.plant.errors import DataError, nearest

__all__ = ["KINDS", "CaseSpec"]

KINDS = ("clean", "effect", "outside", "pair", "tie")
FORMS = ("drawn", "usual")


@dataclass(frozen=True, kw_only=True)
class CaseSpec:
    """A case: what is concealed, how strongly, and in what kind of recording.

    Parameters
    ----------
    name : str
        Unique in its study; fit for a file name.
    kind : {"clean", "effect", "outside", "pair", "tie"}
        What it is to show.
    effects : tuple of str
        Concealed mechanisms.
    truth : tuple of str
        A catalogue name for each of them; empty where the catalogue has none.
    rivals : tuple of str
        Of a tie, all catalogue names that its recording cannot tell apart, the truth among them.
    target_ratio : float
        Structural residual over noise that is aimed at, for each mechanism; 0 where nothing is concealed.
    seed : int
        Of the rig, the film, the commands, the mechanisms and the noise.
    excitation : str
        Name in `excitations.EXCITATIONS`, or one for each record, joined by ``+``.
    records : int
        How many records the experiment has.
    noise_share : float
        Rms of the sensor's noise over the standard deviation of the motion.
    rich : bool
        Whether the input is one that tells mechanisms apart.
    form : {"drawn", "usual"}
        How the film sits on the ball and when readings are taken: at random, or as in most rigs.
    library : tuple of str
        Effects that the diagnosis knows; empty for the whole catalogue.

    Raises
    ------
    DataError
        If the kind or the form is none of these.
    """

    name: str
    kind: str
    effects: tuple[str, ...]
    truth: tuple[str, ...]
    rivals: tuple[str, ...] = ()
    target_ratio: float
    seed: int
    excitation: str
    records: int = 1
    noise_share: float = 0.02
    rich: bool = True
    form: str = "drawn"
    library: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for what, value, known in (("kind", self.kind, KINDS), ("form", self.form, FORMS)):
            if value not in known:
                raise DataError(f"unknown {what} of case {value!r}{nearest(value, known)} (known: {', '.join(known)})")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, ready for JSON."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The case that `to_dict` described.

        Parameters
        ----------
        data : mapping
            Plain data, also as it comes back from JSON.

        Returns
        -------
        CaseSpec

        Raises
        ------
        DataError
            If a field is missing or unknown.
        """
        given: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
        try:
            return cls(**given)
        except TypeError as error:
            raise DataError(f"malformed case: {error}") from None
