"""Write the files of `deatwin material`: the material, its figures and a page."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from deatwin.ident.materials import CalibratedMaterial
from deatwin.plant.prefixes import with_unit
from deatwin.plant.words import as_sentence, spaced
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import Drawing, draw, standalone
from deatwin.studies.report.story import Note, StoryPage, Table, end_run, write_story

MATERIAL_FILE = "material.toml"
_TITLES = {"stretch": "Stress over stretch", "time": "Stress over time", "frequency": "Moduli over frequency"}


def write_material(found: CalibratedMaterial, folder: ResultFolder, record: RunRecord) -> None:
    """Write all files of a calibrated material."""
    folder.text(MATERIAL_FILE, found.to_toml())
    write_story(folder, _page(found, list(_drawings(found, folder))), record)
    end_run(folder, record, "material", found.to_dict())


def _drawings(found: CalibratedMaterial, folder: ResultFolder) -> Iterator[Drawing]:
    for name in found.panels:
        with draw((6.4, 4.2)) as figure:
            found.draw_panel(name, figure.add_subplot())
            folder.text(f"figures/{name}.svg", standalone(figure))
            caption = "Dots: samples of the tests. Lines: the fitted material in the same tests."
            yield Drawing.of(figure, name, _TITLES[name], caption, _data(found, name))


def _data(found: CalibratedMaterial, name: str) -> str:
    """Return the text of the figure's CSV file."""
    dynamic = name == "frequency"
    rows = [f"test,{'frequency_Hz,modulus' if dynamic else 'time_s,stretch'},measured_Pa,modelled_Pa"]
    for block, place in zip(found.data.blocks, found.data.places, strict=True):
        if block.test.is_dma != dynamic:
            continue
        said = zip(block.measured, found.modelled[place], strict=True)
        for k, (measured, modelled) in enumerate(said):
            if dynamic:
                part, at = divmod(k, block.measured.size // 2)
                where = f"{np.asarray(block.test.frequencies)[at]:.6g},{('storage', 'loss')[part]}"
            else:
                where = f"{'' if block.times is None else f'{block.times[k]:.6g}'},{block.stretches[0, k]:.6g}"
            rows.append(f"{block.test.name},{where},{measured:.6g},{modelled:.6g}")
    return "\n".join([*rows, ""])


def _page(found: CalibratedMaterial, drawings: list[Drawing]) -> StoryPage:
    quantities = Table.of(
        "Parameters",
        found.quantities,
        {
            "parameter": lambda one: spaced(one.name),
            "value": lambda one: with_unit(one.value, one.unit),
            "from": lambda one: with_unit(one.low, one.unit),
            "to (95 % interval)": lambda one: with_unit(one.high, one.unit),
        },
    )
    choices = Table.of(
        "What else was tried",
        found.choices,
        {
            "energy": lambda one: spaced(one.energy),
            "branches": lambda one: one.branches,
            "natural logarithm of the odds against this choice": lambda one: f"{one.behind:.1f}",
        },
    )
    notes = [Note(title="What the tests cannot determine", paragraphs=[as_sentence(note) for note in found.notes])]
    notes.append(Note(title="In a rig file", paragraphs=[_USE], code=f'[film]\nmaterial = "{MATERIAL_FILE}"'))
    return StoryPage(
        title="material",
        sentence=as_sentence(found.sentence),
        rows=[],
        notes=notes,
        figures=drawings,
        tables=[quantities, choices],
    )


_USE = (
    f"Put {MATERIAL_FILE} next to the rig file, and set the key material in the section [film] of the rig file as shown below. The "
    f"ranges in {MATERIAL_FILE} are the 95 % intervals; widen them if the film of the rig may differ from the specimens in batch or thickness."
)
