"""The key of the concealed effects: hashed before the first diagnosis, opened after the last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from deatwin.plant import Actuator, Effect, fleet, specification
from deatwin.studies.provenance import versions
from deatwin.studies.sweep.seal import SweepSeal, digest, sources_digest, thresholds
from deatwin.studies.sweep.store import read_seal

SCHEMA = "deatwin/drift-case/1"
PACKAGES = ("deatwin.plant", "deatwin.ident")
VERSIONS = ("deatwin", "numpy", "scipy", "casadi")


@dataclass(frozen=True, kw_only=True, eq=False)
class Key:
    """Concealed effects by actuator, with their parameters in SI."""

    drifts: Mapping[str, Mapping[str, Mapping[str, float]]]

    @classmethod
    def of(cls, actuators: Sequence[Actuator]) -> Key:
        """Make the key to actuators."""
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
        """Return the hash of the key, which reveals nothing about the drifts but fixes them."""
        parts = {
            "seed": seed,
            "key": digest(self.drifts),
            "thresholds": digest(thresholds()),
            "code": sources_digest(PACKAGES, sorted(Path(__file__).parent.glob("*.py"))),
            "versions": versions(VERSIONS),
        }
        return SweepSeal(schema=SCHEMA, parts=parts)


def concealed_in(actuator: Actuator) -> tuple[Effect, ...]:
    """List the effects that an actuator has and its specification lacks."""
    known = set(specification().effect_names)
    return tuple(e for e in actuator.plant.effects if e.name not in known)


def opened(folder: Path, seed: int) -> Key:
    """Generate the key again from the seed, and check that it and the thresholds equal the sealed ones."""
    key = Key.of(fleet(seed))
    key.seal(seed).require_same(read_seal(folder), folder)
    return key
