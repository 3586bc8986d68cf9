"""Film materials by name: published ones, and energies for films of which nothing else is known."""

from __future__ import annotations

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.published import PUBLISHED, UNKNOWN
from deatwin.plant.safe_read import clipped
from deatwin.plant.substance import Branch as Branch
from deatwin.plant.substance import Material as Material

MATERIALS = PUBLISHED
"""Materials with published parameters: a read-only mapping of their names in rig files to `Material`."""


def material(name: str | Material) -> Material:
    """Return a material itself, or by its key in `MATERIALS`, or by an energy of `deatwin.plant.laws`."""
    if isinstance(name, Material):
        return name
    energy = name.lower().replace("-", "_").replace(" ", "_")
    found = MATERIALS.get(name) or UNKNOWN.get(energy)
    if found is None:
        known = (*MATERIALS, *UNKNOWN)
        raise RigError(f"unknown material {clipped(name)!r}{nearest(name, known)} (known: {', '.join(known)})")
    return found
