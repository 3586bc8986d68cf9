"""A plant of one's own: thirty lines that describe a quarter of a car, and what they leave out is found.

A user's file, `quarter_car`, has a linear damper. Its car has another: oil is pressed through an orifice, and resists
by the square of the speed. First deatwin simulates that car itself, which says that what can be concealed can be found.
Then the recordings come from elsewhere: other equations, another integrator (`elsewhere`). Both are diagnosed by the
user's file, which knows of no drag, on a rough road; bumps, on which nothing was fitted or chosen, judge.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib.resources import files
from typing import Any

import numpy as np

from deatwin.ident.mismatch import Diagnosis
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment
from deatwin.scenarios.real_physics import figures as shared
from deatwin.scenarios.real_physics.accounts import error_table, measures, tried_table
from deatwin.scenarios.real_physics.case import Case, HeldOut, Law, Trial, diagnosed, judged
from deatwin.scenarios.your_own_rig.elsewhere import CAR, drive
from deatwin.scenarios.your_own_rig.figures import agreement
from deatwin.scenarios.your_own_rig.quarter_car import plant
from deatwin.scenarios.your_own_rig.roads import DRIVERS, Drives, bumps, concealed, record, rough_road, unread
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.report.quantities import in_interval
from deatwin.studies.report.story import Note, Row, StoryPage, Table, write_story
from deatwin.studies.stories import Setting

__all__ = ["case", "run"]

FILE = "quarter_car.py"
DRAG = "quadratic_damping"
FINE = 0.01
"""Of the sensor's noise, by which both integrators may differ."""
NEAR = 1.1
"""Times the sensor's noise, what the amended plant may leave."""
Told = tuple[Case, Diagnosis, Trial]


def run(setting: Setting) -> Mapping[str, Any]:
    """Drive, diagnose, and judge on the bumps."""
    rng = np.random.default_rng(setting.seed)
    setting.progress(0.0, "driving")
    setting.folder.text(FILE, _source())
    roads = rough_road(rng, plant().rig.sample_time), bumps(plant().rig.sample_time)
    drives = {name: record(name, setting.folder, roads, rng) for name in DRIVERS}
    read = [setting.folder.path / FILE, *(file for one in drives.values() for file in one.files)]
    begun = RunRecord(command=setting.command, inputs=hashes(read), seed=setting.seed, jobs=setting.jobs)
    told = {}
    for number, (name, driven) in enumerate(drives.items()):
        first = 0.1 + 0.4 * number
        own = case(name, driven)
        diagnosis = diagnosed(
            setting,
            own,
            f"diagnosis_{name}",
            lambda share, text, first=first: setting.progress(first + 0.4 * share, text),  # type: ignore[misc]
        )
        told[name] = own, diagnosis, judged(own, diagnosis)[0]
    setting.progress(0.9, "drawing")
    return _written(setting, told, begun)


def case(name: str, driven: Drives) -> Case:
    """What is diagnosed, and what judges."""
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
        caption="Bumps and a pothole. Recording: what the car's own equations have, which no fit has seen; amended "
        "plant: the force of the effect that was built in.",
    )


def _written(setting: Setting, told: Mapping[str, Told], record: RunRecord) -> Mapping[str, Any]:
    rig = plant().rig
    road = bumps(rig.sample_time)
    here = concealed().simulate(Experiment(recordings=(unread(road),))).require().outputs[0][0]
    there, _, _ = drive(CAR, road, rig.sample_time)
    own, diagnosis, trial = told["elsewhere"]
    made = [
        agreement(rig.sample_time * np.arange(1.0, road.size + 1), road, here, there, rig.noise),
        shared.held_out(own, trial),
        shared.residuals(own, trial),
    ]
    if diagnosis.causes and diagnosis.model is not None:
        made.append(shared.law(own, own.law(diagnosis.model.plant)))
    for drawing, columns in made:
        setting.folder.csv(drawing.data, columns)
    rows = [_agree(float(np.abs(here - there).max()), rig.noise)]
    rows += [row for one in told.values() for row in _rows(*one)]
    base, amended = (1e3 * error for error in (trial.base_error, trial.amended_error))
    sentence = (
        f"A plant of thirty lines, and recordings that an integrator of others made: {diagnosis.sentence} Over bumps, "
        f"on which nothing was fitted or chosen, the free run is off by {base:.3g} mm rms before and {amended:.3g} mm "
        "after."
    )
    page = StoryPage(
        title="your-own-rig",
        sentence=sentence,
        rows=rows,
        notes=_notes(told),
        figures=[drawing for drawing, _ in made],
        tables=[
            *(_titled(error_table(o, [t]), o) for o, _, t in told.values()),
            *(_titled(tried_table(o, d), o) for o, d, _ in told.values()),
        ],
    )
    write_story(setting.folder, page, record)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows], "told": _plain(told)}
    setting.folder.text("your-own-rig.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _plain(told: Mapping[str, Told]) -> dict[str, Any]:
    return {
        name: {
            "verdict": diagnosis.verdict.value,
            "causes": [cause.effect for cause in diagnosis.causes],
            "base_m": trial.base_error,
            "amended_m": trial.amended_error,
        }
        for name, (_, diagnosis, trial) in told.items()
    }


def _agree(difference: float, noise: float) -> Row:
    return Row(
        measure="The same car over the bumps, by deatwin and by scipy: largest difference of the travel",
        demanded=f"below {1e6 * FINE * noise:.3g} µm, a hundredth of the sensor's noise",
        reached=f"{1e6 * difference:.2g} µm",
        passed=difference < FINE * noise,
    )


def _rows(own: Case, diagnosis: Diagnosis, trial: Trial) -> list[Row]:
    noise = plant().rig.noise
    rows = [*measures(own, diagnosis, [trial]), _size(diagnosis)]
    rows.append(
        Row(
            measure="Bumps and a pothole: free run of the amended plant, rms error",
            demanded=f"at most {NEAR:g} times the sensor's noise, {1e3 * noise:g} mm",
            reached=f"{1e3 * trial.amended_error:.4g} mm",
            passed=trial.amended_error <= NEAR * noise,
        )
    )
    return [replace(row, measure=f"{own.title}. {row.measure}") for row in rows]


def _size(diagnosis: Diagnosis) -> Row:
    found = next((c.parameters["coefficient"] for c in diagnosis.causes if c.effect == DRAG), None)
    measure, demanded = "The drag of the car, within its 95 % interval", f"{CAR.orifice:g} N s²/m²"
    if found is None:
        return Row(measure=measure, demanded=demanded, reached="no drag was named", passed=False)
    return Row(
        measure=measure,
        demanded=demanded,
        reached=in_interval(found.value, found.low, found.high),
        passed=found.low <= CAR.orifice <= found.high,
    )


def _notes(told: Mapping[str, Told]) -> list[Note]:
    _, here, _ = told["here"]
    _, there, trial = told["elsewhere"]
    shift = there.model.plant.parameters if there.model is not None else plant().parameters
    nominal = plant().parameters
    moved = ", ".join(
        f"{name} {nominal[name].value:g} to {shift[name].value:.4g} {nominal[name].unit} (the car has "
        f"{getattr(CAR, name):g})"
        for name in ("wheel", "spring", "damper", "tyre")
    )
    return [
        Note(
            title="Monday: the file",
            code=_source(),
            paragraphs=[
                f"A rig is a class with parameters and equations; the whole file, {FILE}, is here and beside this page. "
                "The body is weighed, so that no fit moves it; every other value is a guess off a data sheet. What may be "
                "found missing is what the file offers: the road (drive), the strut's force (force, with displacement and "
                "velocity watched), the reading (sensor).",
                "The same on the command line: deatwin diagnose quarter_car:plant "
                "recordings/elsewhere_rough_road.csv --input-column road_m --output-column travel_m --out found.",
            ],
        ),
        Note(
            title="Tuesday: can it be found at all?",
            paragraphs=[
                f"deatwin drives the car itself, with a drag of {CAR.orifice:g} N s²/m² that the diagnosis is not told, "
                f"and with other values than those of the file. Verdict: {here.sentence}",
                "An easy life: the equations that made the recording are those that explain it. It says that this road "
                "and this sensor are good enough, no more.",
            ],
        ),
        Note(
            title="Wednesday: recordings from elsewhere",
            paragraphs=[
                "The car again, by somebody who has never seen the file: momenta for velocities, travel for the body's "
                "height, scipy's Runge-Kutta with step control for fixed implicit steps. The first figure holds the two "
                f"against each other. Verdict: {there.sentence}",
                f"What the fit made of the guesses: {moved}.",
            ],
        ),
        Note(
            title="Thursday: bumps",
            paragraphs=[
                "Four bumps and holes that nobody fitted anything to; the strut moves faster than on the rough road. The "
                f"calibrated base plant has chosen a damper for the rough road's speeds, and is off by "
                f"{1e3 * trial.base_error:.3g} mm rms; with the drag built in {1e3 * trial.amended_error:.3g} mm are left, "
                f"of which the sensor's noise is {1e3 * plant().rig.noise:g} mm.",
                "What this page does not show: a real car has dry friction in its seals, a damper that differs up and "
                "down, and a tyre that leaves the ground. With model_share = 0.002 the file claims to be right to 0.2 % of "
                "the travel, which these cars allow; for a real one that share would be larger.",
            ],
        ),
    ]


def _source() -> str:
    return files("deatwin.scenarios.your_own_rig").joinpath(FILE).read_text(encoding="utf-8")


def _titled(table: Table, own: Case) -> Table:
    return replace(table, title=f"{own.title}: {table.title[0].lower()}{table.title[1:]}")
