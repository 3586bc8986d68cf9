"""What is concealed in each actuator: hashed before the first diagnosis, opened after the last."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from deatwin.plant.effects import Effect
from deatwin.plant.fleet import Actuator, fleet, specification
from deatwin.scenarios.concealed_physics.seal import Seal
from deatwin.studies.provenance import versions
from deatwin.studies.sweep.seal import SweepSeal, digest
from deatwin.studies.sweep.store import read_seal

SCHEMA = "deatwin/drift-case/1"
SIZE = "six actuators"
VERSIONS = ("deatwin", "numpy", "scipy", "casadi")


@dataclass(frozen=True, kw_only=True, eq=False)
class Key:
    """What is concealed, by actuator."""

    drifts: Mapping[str, Mapping[str, Mapping[str, float]]]

    @classmethod
    def of(cls, actuators: Sequence[Actuator]) -> Key:
        """The key to actuators."""
        return cls(
            drifts={
                a.name: {
                    e.name: {p.name: a.plant.parameters[f"{e.name}.{p.name}"].value for p in e.describe()}
                    for e in concealed_in(a)
                }
                for a in actuators
            }
        )

    def seal(self, seed: int) -> SweepSeal:
        """The seal: it says nothing of the drifts, and nothing of them can be changed any more."""
        now = Seal.of(SIZE, seed, self.drifts)
        parts = {
            "seed": seed,
            "key": now.key,
            "thresholds": digest(now.thresholds),
            "code": digest([now.code, *_sources()]),
            "versions": versions(VERSIONS),
        }
        return SweepSeal(schema=SCHEMA, parts=parts)


def concealed_in(actuator: Actuator) -> tuple[Effect, ...]:
    """What an actuator has and its specification has not."""
    known = set(specification().effect_names)
    return tuple(e for e in actuator.plant.effects if e.name not in known)


def opened(folder: Path, seed: int) -> Key:
    """The key, made anew from the seed, if it is the one that was sealed and nothing that decides has changed since."""
    key = Key.of(fleet(seed))
    key.seal(seed).require_same(read_seal(SweepSeal, folder), folder)
    return key


def _sources() -> list[str]:
    """SHA-256 of each source of this story; those of plant and identification are in the seal that it shares."""
    paths = sorted(Path(__file__).parent.glob("*.py"))
    return [f"{path.name}:{hashlib.sha256(path.read_bytes()).hexdigest()}" for path in paths]
