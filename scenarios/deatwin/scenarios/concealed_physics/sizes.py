"""How large a study is: plain numbers, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from deatwin.plant.errors import DataError, nearest
from deatwin.scenarios.concealed_physics.specimens import CHECK_SECONDS, SECONDS

LADDER = (0.3, 0.5, 0.9, 1.6, 2.8, 5.0)
"""Strengths of the cases of an effect, structural residual over noise."""


@dataclass(frozen=True, kw_only=True)
class Size:
    """Numbers of cases, and how long each is recorded."""

    clean: int  # Cases without an effect, with one from outside the catalogue, with two effects, and with poor input
    effects: int
    outside: int
    pairs: int
    ties: int
    draws: int  # Fits of each effect whose intervals are looked at
    ladder: tuple[float, ...] = LADDER
    seconds: float = SECONDS  # Length of a case's recordings together, and of its check, s
    check_seconds: float = CHECK_SECONDS
    excitation: str = ""
    form: str = "drawn"  # How films sit on their balls, a form of `specs.CaseSpec`
    library: tuple[str, ...] = ()


SIZES: Mapping[str, Size] = MappingProxyType(
    {
        # One form of rig and few effects, since each plant that is tried has equations of its own to compile.
        "tiny": Size(
            clean=3,
            effects=4,
            outside=2,
            pairs=2,
            ties=1,
            draws=1,
            seconds=36.0,
            check_seconds=16.0,
            form="usual",
            library=("creep", "electrode_rc", "quadratic_damping", "sensor_drift"),
        ),
        # Recordings as long as a rig's own: a search that ends well on two minutes may lose its way on seven.
        "long": Size(
            clean=12,
            effects=2,
            outside=14,
            pairs=20,
            ties=0,
            draws=0,
            ladder=(0.9, 2.8),
            seconds=420.0,
            check_seconds=120.0,
            excitation="noise+holds",
        ),
        "standard": Size(clean=150, effects=6, outside=40, pairs=40, ties=24, draws=12),
        "full": Size(clean=300, effects=12, outside=80, pairs=80, ties=48, draws=24),
    }
)


def size_named(name: str) -> Size:
    """A size by its name."""
    if name not in SIZES:
        raise DataError(f"unknown size {name!r}{nearest(name, SIZES)} (known: {', '.join(SIZES)})")
    return SIZES[name]
