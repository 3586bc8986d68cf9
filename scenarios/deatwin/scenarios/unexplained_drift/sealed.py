"""What is concealed in each actuator: hashed before the first diagnosis, opened after the last."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deatwin.plant.effects import Effect
from deatwin.plant.errors import DataError
from deatwin.plant.fleet import Actuator, fleet, specification
from deatwin.scenarios.concealed_physics.seal import Seal, digest

__all__ = ["SCHEMA", "SEAL_FILE", "Key", "concealed_in", "opened"]

SCHEMA = "deatwin/drift-seal/2"
SEAL_FILE = "seal.json"
SIZE = "six actuators"
SEALED = ("seed", "key", "thresholds", "code")


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
            Schema, seed, SHA-256 of the key, of every number that decides in the diagnosis, and of the sources of
            plant, identification and this story.
        """
        now = Seal.of(SIZE, seed, self.drifts)
        return {
            "schema": SCHEMA, "seed": seed, "key": now.key, "thresholds": digest(now.thresholds),
            "code": digest([now.code, *_sources()]),
        }  # fmt: skip


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


def opened(folder: Path, seed: int) -> Key:
    """The key, made anew from the seed, if it is the one that was sealed and nothing that decides has changed since.

    Parameters
    ----------
    folder : path
        With the ``seal.json`` that was written before the first diagnosis.
    seed : int
        Of the story.

    Returns
    -------
    Key

    Raises
    ------
    DataError
        If there is no seal, or seed, key, thresholds or code are not those that were sealed.
    """
    key = Key.of(fleet(seed))
    now, then = key.seal(seed), _read(folder / SEAL_FILE)
    changed = [part for part in SEALED if now[part] != then.get(part)]
    if changed:
        raise DataError(f"the seal is broken: {' and '.join(changed)} changed since it was written; run the story anew")
    return key


def _read(path: Path) -> Mapping[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise DataError(f"{path}: no such file; the drifts are sealed before the first diagnosis") from None
    except json.JSONDecodeError as error:
        raise DataError(f"{path}: line {error.lineno}: {error.msg}; it must hold the seal of the drifts") from None
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        raise DataError(f"{path}: this is no seal of the drifts; its schema must be {SCHEMA}")
    return found


def _sources() -> list[str]:
    """SHA-256 of each source of this story; those of plant and identification are in the seal that it shares."""
    paths = sorted(Path(__file__).parent.glob("*.py"))
    return [f"{path.name}:{hashlib.sha256(path.read_bytes()).hexdigest()}" for path in paths]
