"""A plant of one's own: thirty lines that describe a quarter of a car, and what they leave out is found.

A user's file, `quarter_car`, has a linear damper. Its car has another: oil is pressed through an orifice, and resists
by the square of the speed. First deatwin simulates that car itself, which says that what can be concealed can be found.
Then the recordings come from elsewhere: other equations, another integrator (`elsewhere`). Both are diagnosed by the
user's file, which knows of no drag, on a rough road; bumps, on which nothing was fitted or chosen, judge.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np

from deatwin.ident.mismatch import Diagnosis
from deatwin.plant import Experiment, Plant
from deatwin.plant.arrays import Array
from deatwin.scenarios.your_own_rig.elsewhere import CAR, drive
from deatwin.scenarios.your_own_rig.quarter_car import plant
from deatwin.scenarios.your_own_rig.roads import DRIVERS, Drives, bumps, concealed, record, rough_road, unread
from deatwin.studies.missing_physics import (
    Case,
    HeldOut,
    Law,
    Trial,
    amended_plant,
    diagnosed,
    drawings,
    error_table,
    judged,
    measures,
    tried_table,
)
from deatwin.studies.parallel import between
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.report.drawing import Drawing, Hue, draw
from deatwin.studies.report.quantities import in_interval
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish
from deatwin.studies.report.words import Words, notes
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
FILE = "quarter_car.py"
DRAG = "quadratic_damping"
FINE = 0.01  # Share of the sensor's noise by which the integrators may differ
NEAR = 1.1  # Times the sensor's noise, what the amended plant may leave
Told = tuple[Case, Diagnosis, Trial]


def run(setting: Setting) -> Mapping[str, Any]:
    """Simulate the drives, diagnose the plant, and test it on the bumps."""
    rng = np.random.default_rng(setting.seed)
    setting.progress(0.0, "driving")
    setting.folder.text(FILE, _source())
    roads = rough_road(rng, plant().rig.sample_time), bumps(plant().rig.sample_time)
    drives = {name: record(name, setting.folder, roads, rng) for name in DRIVERS}
    read = [setting.folder.path / FILE, *(file for one in drives.values() for file in one.files)]
    begun = setting.record(hashes(read))
    told = {}
    for number, (name, driven) in enumerate(drives.items()):
        first = 0.1 + 0.4 * number
        own = case(name, driven)
        progress = between(setting.progress, first, first + 0.4)
        diagnosis = diagnosed(setting, own, f"diagnosis_{name}", progress)
        told[name] = own, diagnosis, judged(own, diagnosis)[0]
    setting.progress(0.9, "drawing")
    return _written(setting, told, begun)


def case(name: str, driven: Drives) -> Case:
    """Make the case, with the recording to diagnose and the one for the test."""
    fitted, held_out = (Experiment(recordings=(recording,)) for recording in (driven.rough, driven.over_bumps))
    return Case(
        name=name,
        title=f"Recorded {name}",
        documented=(DRAG,),
        plant=plant(),
        fitted=(fitted,),
        held_out=(HeldOut(name="Bumps and a pothole", experiment=held_out),),
        unit="mm",
        scale=1e-3,
        files=driven.files,
        notes=(),
        law=lambda amended: _law(amended, held_out),
    )


def _law(amended: Plant, judging: Experiment) -> Law:
    """Force of the drag over the strut's speed: the car's own, and what the diagnosis built in."""
    _, speed, force = drive(CAR, judging.recordings[0].inputs[0], amended.rig.sample_time)
    signals, p = amended.simulate(judging).require().watched[0], amended.parameters
    linear = -p["spring"].value * signals["displacement"] - p["damper"].value * signals["velocity"]
    return Law(
        state="speed of the strut (m/s)",
        force="force beyond spring and linear damper (N)",
        measured=(speed, force),
        modelled=(signals["velocity"], signals["strut"] - linear),
        caption=WORDS.text("law"),
    )


def _written(setting: Setting, told: Mapping[str, Told], record: RunRecord) -> Mapping[str, Any]:
    rig = plant().rig
    road = bumps(rig.sample_time)
    here = concealed().simulate(Experiment(recordings=(unread(road),))).require().outputs[0][0]
    there, _, _ = drive(CAR, road, rig.sample_time)
    own, diagnosis, trial = told["elsewhere"]
    timepts = rig.sample_time * np.arange(1.0, road.size + 1)
    figures = [_agreement(timepts, road, here, there, rig.noise), *drawings(own, trial, amended_plant(diagnosis))]
    difference, limit = float(np.abs(here - there).max()), FINE * rig.noise
    rows = [WORDS.measure("agree", difference < limit, difference=1e6 * difference, limit=1e6 * limit)]
    rows += [row for one in told.values() for row in _rows(*one)]
    base, amended = (1e3 * error for error in (trial.base_error, trial.amended_error))
    page = StoryPage(
        title="your-own-rig",
        sentence=WORDS.text("sentence", found=diagnosis.sentence, base=base, amended=amended),
        rows=rows,
        notes=_notes(told),
        figures=figures,
        tables=[
            *(_titled(error_table(o, [t]), o) for o, _, t in told.values()),
            *(_titled(tried_table(o, d), o) for o, d, _ in told.values()),
        ],
    )
    plain = {
        name: {
            "verdict": diagnosis.verdict.value,
            "causes": [cause.effect for cause in diagnosis.causes],
            "base_m": trial.base_error,
            "amended_m": trial.amended_error,
        }
        for name, (_, diagnosis, trial) in told.items()
    }
    return finish(setting.folder, record, page, told=plain)


def _agreement(timepts: Array, road: Array, here: Array, elsewhere: Array, noise: float) -> Drawing:
    """Draw the bumps, the travel as both compute it, and their difference. Shapes: (n,)."""
    difference = 1e6 * (here - elsewhere)
    with draw((9.6, 5.8)) as figure:
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2, 3, 2))
        top.fill_between(timepts, 1e3 * road, -60.0, color=Hue.MEASURED, alpha=0.5, linewidth=0, step="post")
        top.set(ylabel="road (mm)")
        middle.plot(timepts, 1e3 * elsewhere, color=Hue.INK, linewidth=2.4, label="scipy, its own equations")
        middle.plot(timepts, 1e3 * here, color=Hue.AFTER, linewidth=1.0, label="deatwin, the user's file and the drag")
        middle.set(ylabel="travel (mm)")
        bottom.plot(timepts, difference, color=Hue.AFTER)
        bottom.set(ylabel="difference (µm)", xlabel="time (s)")
        figure.legend(*middle.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        columns = {"time_s": timepts, "road_mm": 1e3 * road, "deatwin_mm": 1e3 * here, "scipy_mm": 1e3 * elsewhere}
        columns["difference_um"] = difference
        return WORDS.drawing(figure, "agreement", columns, noise=1e6 * noise)


def _rows(own: Case, diagnosis: Diagnosis, trial: Trial) -> list[Measure]:
    noise, error = plant().rig.noise, trial.amended_error
    near = WORDS.measure("near", error <= NEAR * noise, NEAR=NEAR, noise=1e3 * noise, error=1e3 * error)
    found = next((c.parameters["coefficient"] for c in diagnosis.causes if c.effect == DRAG), None)
    within = found is not None and found.low <= CAR.orifice <= found.high
    shown = "no drag was named" if found is None else in_interval(found.value, found.low, found.high)
    size = WORDS.measure("size", within, drag=CAR.orifice, found=shown)
    rows = [*measures(own, diagnosis, [trial]), size, near]
    return [replace(row, measure=f"{own.title}. {row.measure}") for row in rows]


def _notes(told: Mapping[str, Told]) -> list[Note]:
    _, here, _ = told["here"]
    _, there, trial = told["elsewhere"]
    nominal = plant().parameters
    fitted = there.model.plant.parameters if there.model is not None else nominal
    moved = [(nominal[name], fitted[name].value, getattr(CAR, name)) for name in ("wheel", "spring", "damper", "tyre")]
    return notes(
        __package__,
        file=FILE,
        source=_source(),
        drag=CAR.orifice,
        here=here.sentence,
        there=there.sentence,
        moved=moved,
        base=1e3 * trial.base_error,
        left=1e3 * trial.amended_error,
        noise=1e3 * plant().rig.noise,
    )


def _source() -> str:
    return files("deatwin.scenarios.your_own_rig").joinpath(FILE).read_text(encoding="utf-8")


def _titled(table: Table, own: Case) -> Table:
    return replace(table, title=f"{own.title}: {table.title[0].lower()}{table.title[1:]}")
