"""A material calibrated on tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from deatwin.ident.materials.fit import Fit, Quantity
from deatwin.ident.materials.noise import Noise
from deatwin.ident.materials.observations import Block, Observations
from deatwin.ident.materials.section import toml_of
from deatwin.ident.materials.tests import MaterialTest
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.drawing import Axes, panels_or_new
from deatwin.plant.records import Json
from deatwin.plant.rigs.rigmaterial import read_material
from deatwin.plant.substance import Material


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """An energy and a number of branches that were tried."""

    energy: str
    branches: int
    behind: float  # Log odds of the most probable choice over this one
    fit: Fit


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedMaterial(Frozen):
    """Material calibrated by `calibrate_material`, with the intervals of its parameters.

    Parameters
    ----------
    section : mapping
        The material as the section ``[material]`` of a rig file. The range of each parameter is its 95 % interval.
    quantities : tuple of Quantity
        Parameters of the energy, then modulus and relaxation time of each Maxwell branch, the fastest branch first.
        Each has ``name``, ``value``, 95 % limits ``low`` and ``high``, and ``unit``.
    covariance : ndarray, shape (k, k)
        Covariance of the k fitted parameters: first those of the energy, each transformed by its `Scale`, then the
        logarithms of all moduli, then the logarithms of all relaxation times.
    noise : Noise
        Estimated errors of the tests. ``absolute`` (Pa) and ``relative`` have one value for stresses and one for
        moduli. ``scatter`` is the relative standard deviation between specimens.
    choices : tuple of Choice
        Combinations of an energy and a number of branches that were fitted, with fields ``energy``, ``branches`` and
        ``behind``: the logarithm of the odds of the most probable combination over this one.
    notes : tuple of str
        Remarks on what the tests cannot determine.
    tests : tuple of MaterialTest
        Tests to which the material was fitted.
    data : Observations
        Samples of the tests that were used.
    modelled : ndarray, shape (n,)
        Stresses or moduli that the material predicts for these samples, Pa.
    """

    section: Mapping[str, Json]
    quantities: tuple[Quantity, ...]
    covariance: Array
    noise: Noise
    choices: tuple[Choice, ...]
    notes: tuple[str, ...]
    tests: tuple[MaterialTest, ...]
    data: Observations
    modelled: Array

    @cached_property
    def material(self) -> Material:
        """The material as an object, for use in a rig."""
        found, mistakes = read_material(self.section)
        if found is None:
            raise ValueError(f"no section of a rig file: {mistakes}")
        return found

    @property
    def sentence(self) -> str:
        """The result in one sentence."""
        energy, number = self.section["energy"], len(self.material.branches)
        branches = f"{number} branch{'' if number == 1 else 'es'}" if number else "no branches"
        return (
            f"{self.section['name']}: {energy} with {branches}, from {len(self.tests)} test{'s'[: len(self.tests) > 1]}"
        )

    @property
    def lines(self) -> tuple[str, ...]:
        """Parameters and notes as plain text, one line each."""
        return (*map(str, self.quantities), *(f"note: {note}" for note in self.notes))

    def __str__(self) -> str:
        return "\n".join([self.sentence, *self.lines])

    def to_toml(self) -> str:
        """Return the text of a file with the section ``[material]``."""
        head = [
            f"Made by deatwin from {', '.join(test.name for test in self.tests)}.",
            "low and high: intervals of 95 %.",
        ]
        return toml_of(self.section, [*head, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, SI."""
        return {
            "sentence": self.sentence,
            "material": dict(self.section),
            "quantities": [asdict(one) for one in self.quantities],
            "noise": asdict(self.noise),
            "choices": [{"energy": c.energy, "branches": c.branches, "behind": c.behind} for c in self.choices],
            "notes": list(self.notes),
        }

    def plot(self, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
        """Draw measured and computed stresses and moduli on `axes`, one for each of `panels`, or on new ones."""
        shown = panels_or_new(axes, len(self.panels), height=2.6)
        for name, panel in zip(self.panels, shown, strict=True):
            self.draw_panel(name, panel)
        return shown

    @property
    def panels(self) -> tuple[str, ...]:
        """Names of the diagrams that `plot` draws: "stretch", "time" and "frequency", as far as there are data."""
        kinds = [block.test for block in self.data.blocks]
        shown = {
            "stretch": any(not test.is_dma for test in kinds),
            "time": any(not test.is_dma and test.times is not None for test in kinds),
            "frequency": any(test.is_dma for test in kinds),
        }
        return tuple(name for name, there in shown.items() if there)

    def draw_panel(self, name: str, ax: Axes) -> None:
        """Draw the diagram `name`, one of `panels`, on `ax`."""
        for block, place in zip(self.data.blocks, self.data.places, strict=True):
            if block.test.is_dma == (name == "frequency") and (name != "time" or block.times is not None):
                _draw_block(name, ax, block, self.modelled[place])
        labels = {"stretch": "stretch", "time": "time (s)", "frequency": "frequency (Hz)"}
        ax.set(xlabel=labels[name], ylabel="modulus (kPa)" if name == "frequency" else "nominal stress (kPa)")
        if name != "stretch":
            ax.set_xscale("log")
        if name == "frequency":
            ax.set_yscale("log")
        ax.legend(fontsize="small", ncols=2 if len(self.tests) > 5 else 1)


def _draw_block(name: str, ax: Axes, block: Block, modelled: Array) -> None:
    if name == "frequency":
        at = np.asarray(block.test.frequencies)
        pairs = zip(("storage", "loss"), np.split(block.measured, 2), np.split(modelled, 2), strict=True)
        for what, measured, said in pairs:
            (dots,) = ax.plot(at, measured / 1e3, ".", label=f"{block.test.name}: {what}")
            ax.plot(at, said / 1e3, color=dots.get_color())
        return
    at = block.stretches[0] if name == "stretch" or block.times is None else block.times
    (dots,) = ax.plot(at, block.measured / 1e3, ".", markersize=3, alpha=0.6, label=block.test.name)
    ax.plot(at, modelled / 1e3, color=dots.get_color())
