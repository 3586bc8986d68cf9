"""The frequency domain of models that are known, and of the fleet: ranges, responses of all orders, NOFRFs.

Benchmark systems come first: their frequency responses can be written down, so every tool is held against them. Then
six actuators with models of one structure, on the recordings of the story `thesis-data`: the DC component is removed,
first- and second-order responses are compared, and NOFRFs are computed for a test signal and, to see why not, for the
recording. At the end an actuator is asked for its own response.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from deatwin.ident.narx.fleet.alike import identify_fleet
from deatwin.scenarios.frequency_analysis.actuators import SHOWN, Actuators, actuators
from deatwin.scenarios.frequency_analysis.anchor import anchor
from deatwin.scenarios.frequency_analysis.benchmark_figures import benchmark_drawings
from deatwin.scenarios.frequency_analysis.benchmarks import benchmarks
from deatwin.scenarios.frequency_analysis.fleet_figures import fleet_drawings
from deatwin.scenarios.frequency_analysis.notes import notes
from deatwin.scenarios.frequency_analysis.tables import tables
from deatwin.scenarios.frequency_analysis.verdicts import judge
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import Row, StoryPage, write_story
from deatwin.studies.stories import Setting

__all__ = ["run"]


def run(setting: Setting) -> Mapping[str, Any]:
    """Analyse benchmark systems and the fleet in the frequency domain."""
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    fleet = identify_fleet(
        setting.seed, jobs=setting.jobs, progress=lambda share, text: setting.progress(0.8 * share, text)
    )
    setting.progress(0.8, "benchmark systems")
    known = benchmarks(np.random.default_rng((setting.seed, 0)))
    setting.progress(0.87, "responses of the fleet")
    found = actuators(fleet, np.random.default_rng((setting.seed, 1)), jobs=setting.jobs)
    truth = anchor(fleet.actuators[min(SHOWN, len(fleet.actuators)) - 1], fleet)
    setting.progress(0.95, "judging and drawing")
    rows = judge(known, found, truth)
    sentence = _sentence(rows, found)
    figures = []
    for drawing, columns in (*benchmark_drawings(known), *fleet_drawings(found, truth)):
        figures.append(drawing)
        setting.folder.csv(drawing.data, columns)
    for one in fleet.actuators:
        setting.folder.save(f"models/{one.name.lower().replace(' ', '')}.json", one.model.save)
    page = StoryPage(
        title="frequency-analysis",
        sentence=sentence,
        rows=rows,
        notes=notes(found, truth),
        figures=figures,
        tables=tables(known, found),
    )
    write_story(setting.folder, page, record)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows]}
    setting.folder.text("frequency-analysis.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _sentence(rows: list[Row], found: Actuators) -> str:
    ridges = [one.ridge for one in found.each]
    return (
        "Frequency responses and NOFRFs agree with closed forms and with simulation; of the "
        f"{len(found.each)} actuators each second-order response has its ridge where f₁ + f₂ = 0, "
        f"{min(ridges):.1f} to {max(ridges):.1f} times what is beside it; {sum(row.passed for row in rows)} of "
        f"{len(rows)} stated measures are reached. What a first-order response is worth, the actuator itself says."
    )
