"""What each effect of the catalogue adds to the reading of the default `Diaphragm()`, for the pictures on the page of effects.

``python tests/tools/signatures.py docs`` simulates the effects at their typical strengths and writes
``docs/data/signatures.json``; the build of the site draws it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deatwin.plant import Diaphragm, Effect, Experiment, Plant, Recording, catalogue
from deatwin.plant.effects.places import everywhere

SCHEMA = "deatwin/signatures/1"
SAMPLE_TIME = 0.02
CORNERS = (
    *((0.0, 1.0), (30.0, 1.0), (30.0, 2.5), (130.0, 2.5), (130.0, 1.0), (160.0, 1.0)),
    *((190.0, 3.0), (220.0, 1.0), (250.0, 3.0), (280.0, 1.0), (300.0, 1.0)),
)
"""Time, s, and command, V: a step held for 100 s, two triangles, and rests."""
POINTS = 150
"""Groups of samples in a picture, which shows the smallest and the largest value of each."""
LEVEL = 0.8
"""Share of the largest value at which an effect with a threshold begins."""


def commands() -> NDArray[np.float64]:
    """The command, V, shape (n,)."""
    return np.concatenate(
        [
            np.linspace(u0, u1, round((t1 - t0) / SAMPLE_TIME), endpoint=False)
            for (t0, u0), (t1, u1) in pairwise(CORNERS)
            if t1 > t0
        ]
    )


def reading(plant: Plant, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement, m, shape (n,)."""
    given = Experiment(recordings=(Recording.from_arrays(u, np.zeros((0, len(u))), SAMPLE_TIME),))
    return plant.simulate(given).require().outputs[0][0]


def shown(effect: Effect, levels: dict[str, float]) -> Effect:
    """The effect with its threshold within the range of the signal that it limits."""
    return replace(effect, **{effect.threshold: LEVEL * levels[effect.place.value]}) if effect.threshold else effect


def outline(values: NDArray[np.float64], points: int = POINTS) -> list[list[float]]:
    """Smallest and largest value of each group, shape (points, 2); 0 of a group that is a gap."""
    groups = (g[np.isfinite(g)] for g in np.array_split(values, min(points, len(values))))
    return [[float(f"{g.min():.3g}"), float(f"{g.max():.3g}")] if g.size else [0.0, 0.0] for g in groups]


def signatures() -> dict[str, object]:
    """What each effect adds, um, and the command, V."""
    u, plant = commands(), Plant(rig=Diaphragm())
    base = reading(plant, u)
    top = float(base.max())
    levels = {"drive": plant.parameters["gain"].value * float(u.max()), "ball": top, "sensor": top}
    added = {
        effect.name: outline(1e6 * (reading(plant.with_effects(shown(effect, levels)), u) - base))
        for effect in everywhere(catalogue())
        if plant.accepts(effect)
    }
    return {"schema": SCHEMA, "seconds": CORNERS[-1][0], "command_V": outline(u), "added_um": added}


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("docs", type=Path)
    target = parser.parse_args().docs / "data" / "signatures.json"
    target.write_text(json.dumps(signatures()) + "\n", encoding="utf-8")
    print(target)


if __name__ == "__main__":
    main()
