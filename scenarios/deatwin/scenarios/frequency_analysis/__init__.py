"""The frequency domain of models that are known, and of the fleet: ranges, responses of all orders, NOFRFs.

Benchmark systems come first: their frequency responses can be written down, so every tool is held against them. Then
six actuators with models of one structure, on the recordings of the story `thesis-data`: the DC component is removed,
first- and second-order responses are compared, and NOFRFs are computed for a test signal and, to see why not, for the
recording. At the end an actuator is asked for its own response.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from deatwin.ident.narx.fleet import OPERATING_INPUT, identify_fleet
from deatwin.scenarios.frequency_analysis.actuators import LARGE, ORDERS, SMALL, Actuators, Anchor, actuators, anchor
from deatwin.scenarios.frequency_analysis.figures import fleet_drawings, known_drawings
from deatwin.scenarios.frequency_analysis.known import known_systems
from deatwin.scenarios.frequency_analysis.measures import HALF, HIGH, LOW, WORDS, judge, spread, tables
from deatwin.studies.parallel import between
from deatwin.studies.report.drawing import key_of
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import StoryPage, finish, reached
from deatwin.studies.report.words import Span, notes
from deatwin.studies.stories import Setting


def run(setting: Setting) -> Mapping[str, Any]:
    """Analyse benchmark systems and the fleet in the frequency domain."""
    record = setting.record()
    fleet = identify_fleet(setting.seed, jobs=setting.jobs, progress=between(setting.progress, 0.0, 0.8))
    setting.progress(0.8, "benchmark systems")
    known = known_systems(np.random.default_rng((setting.seed, 0)))
    setting.progress(0.87, "responses of the fleet")
    found = actuators(fleet, np.random.default_rng((setting.seed, 1)), jobs=setting.jobs)
    truth = anchor(found.shown.alike, fleet)
    setting.progress(0.95, "judging and drawing")
    rows = judge(known, found, truth)
    for one in fleet.actuators:
        setting.folder.save(f"models/{key_of(one.name).lower()}.json", one.model.save)
    ridges = Span(one.ridge for one in found.each)
    page = StoryPage(
        title="frequency-analysis",
        sentence=WORDS.text("sentence", ridges=ridges, reached=reached(rows)),
        rows=rows,
        notes=notes(__package__, **_numbers(found, truth)),
        figures=[*known_drawings(known), *fleet_drawings(found)],
        tables=tables(known, found),
    )
    return finish(setting.folder, record, page)


def _numbers(found: Actuators, truth: Anchor) -> dict[str, Any]:
    """Numbers of the notes."""
    low, high = spread(found.each, LOW), spread(found.each, HIGH)
    rests = np.array([1e3 * one.first.point.output for one in found.each])
    far, gains = int(rests.argmax()), np.array([one.first.gain for one in found.each])
    cautions = [(one.name, one.nofrfs.fitted.status) for one in found.each if not one.nofrfs.fitted.status.ok]
    return {
        "found": found,
        "truth": truth,
        "step": quantity(found.fleet.actuators[0].model.sample_time, "s"),
        "fits": Span(one.fit_percent for one in found.fleet.actuators),
        "at": OPERATING_INPUT,
        "alternative_fits": Span(found.alternative.fits),
        "alternative_left": Span(100 * found.alternative.left[:, -1]),
        "alternative_gain": found.alternative.first[found.each.index(found.shown)].gain[0],
        "low": (LOW, low),
        "high": (HIGH, high),
        "alike": low <= HALF * high,
        "rests": Span(rests),
        "furthest": found.each[far].name,
        "largest": bool(np.all(gains[far] >= gains)),
        "sizes": (SMALL, LARGE),
        "orders": ORDERS,
        "cautions": "; ".join(f"{name}: {status.value}" for name, status in cautions),
    }
