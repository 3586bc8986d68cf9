"""What is concealed in each actuator: hashed before the first diagnosis, opened after the last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deatwin.plant.effects import Effect
from deatwin.plant.errors import DataError
from deatwin.plant.fleet import Actuator, specification
from deatwin.scenarios.concealed_physics.seal import digest, thresholds

__all__ = ["SCHEMA", "Key", "concealed_in", "opened"]

SCHEMA = "deatwin/drift-seal/1"


@dataclass(frozen=True, kw_only=True, eq=False)
class Key:
    """What is concealed, by actuator.

    Parameters
    ----------
    drifts : mapping of str to mapping
        By actuator: by effect: the values of its parameters, SI.
    """

    drifts: Mapping[str, Mapping[str, Mapping[str, float]]]

    @classmethod
    def of(cls, actuators: Sequence[Actuator]) -> Key:
        """The key to actuators.

        Parameters
        ----------
        actuators : sequence of Actuator
            With their drifts.

        Returns
        -------
        Key
        """
        return cls(
            drifts={
                a.name: {e.name: {p.name: a.plant.parameters[f"{e.name}.{p.name}"].value for p in e.describe()}
                         for e in concealed_in(a)}
                for a in actuators
            }
        )  # fmt: skip

    def seal(self, seed: int) -> dict[str, Any]:
        """Content of ``seal.json``: it says nothing of the drifts, and nothing of them can be changed any more.

        Parameters
        ----------
        seed : int
            Of the story.

        Returns
        -------
        dict
            Schema, seed, SHA-256 of the key and of every number that decides in the diagnosis.
        """
        return {"schema": SCHEMA, "seed": seed, "key": digest(self.drifts), "thresholds": digest(thresholds())}


def concealed_in(actuator: Actuator) -> tuple[Effect, ...]:
    """What an actuator has and its specification has not.

    Parameters
    ----------
    actuator : Actuator
        Of the fleet.

    Returns
    -------
    tuple of Effect
    """
    known = set(specification().effect_names)
    return tuple(e for e in actuator.plant.effects if e.name not in known)


def opened(key: Key, seal: Mapping[str, Any]) -> Key:
    """The key, if it is the one that was sealed and nothing that decides has changed since.

    Parameters
    ----------
    key : Key
        To be opened.
    seal : mapping
        Content of ``seal.json``.

    Returns
    -------
    Key

    Raises
    ------
    DataError
        If key or thresholds are not those that were sealed.
    """
    now = key.seal(seal["seed"])
    changed = [part for part in ("key", "thresholds") if now[part] != seal[part]]
    if changed:
        raise DataError(f"the seal is broken: {' and '.join(changed)} changed since it was written; run the story anew")
    return key
