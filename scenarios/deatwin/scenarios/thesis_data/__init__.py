"""The thesis' data: six actuators of one specification, recorded, and held against what the thesis saw in its own.

Its recordings are not public, and its figures 2.5 to 2.8 are known from the text only. So the figures here show what
the text says of them, and stated measures say whether the fleet does what the six did: a nearly straight curve below
2.5 V and a steep one above, loops that stay open, power at frequencies that the input does not have, and drifts that
all differ. Each drift is an effect of the catalogue (for the first actuator's roughness, one of its own), and so a
cause that `diagnose` may be asked for.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deatwin.ident.curves import mean_curve, straight_line
from deatwin.plant.files import write_recording
from deatwin.plant.fleet import TOLERANCES, specification
from deatwin.scenarios.thesis_data.counterevidence import SideBands, SmallVoltages, side_bands, small_voltages
from deatwin.scenarios.thesis_data.figures import ELASTIC, SPECIFIED, drawings
from deatwin.scenarios.thesis_data.study import Bench, Study, carry_out
from deatwin.scenarios.thesis_data.verdicts import judge
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import Note, StoryPage, Table, write_story
from deatwin.studies.stories import Setting

__all__ = ["run"]


def run(setting: Setting) -> Mapping[str, Any]:
    """Record the fleet, measure, draw."""
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    setting.progress(0.0, "recording six actuators")
    study = carry_out(
        setting.seed,
        jobs=setting.jobs,
        finished=lambda count, total: setting.progress(0.9 * count / total, "recording six actuators"),
    )
    setting.progress(0.9, "measuring and drawing")
    wished = specification()
    step = wished.rig.chain.reading_step  # type: ignore[union-attr]
    rests = {SPECIFIED: small_voltages(wished, step), ELASTIC: small_voltages(wished.without_effects(), step)}
    bands = side_bands()
    rows = judge(study)
    reached = sum(row.passed for row in rows)
    sentence = (
        f"Six actuators of one specification, each with drifts of its own that are named physics: {reached} of "
        f"{len(rows)} stated measures of what the thesis saw are reached."
    )
    figures, files = drawings(study, rests, bands, step)
    for bench in study.benches:
        name = f"recordings/{bench.actuator.name.lower().replace(' ', '')}.csv"
        setting.folder.save(name, lambda path, r=bench.recording: write_recording(path, r))  # type: ignore[misc]
    for name, columns in files.items():
        setting.folder.csv(name, columns)
    page = StoryPage(
        title="thesis-data",
        sentence=sentence,
        rows=rows,
        notes=_notes(study, rests, bands),
        figures=figures,
        tables=[_fabrications(study.benches), _histories(study.benches), _tolerances()],
    )
    write_story(setting.folder, page, record)
    result = {
        "sentence": sentence,
        "measures": [asdict(row) for row in rows],
        "small_voltages": {
            name: {"exponents": rest.exponents.tolist(), "visible_V": rest.visible} for name, rest in rests.items()
        },
        "side_bands": {"reached": bands.reached, "expected": bands.expected, "superposition": bands.superposition},
    }
    setting.folder.text("thesis-data.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _notes(study: Study, rests: Mapping[str, SmallVoltages], bands: SideBands) -> list[Note]:
    record = study.benches[-1].recording
    line = straight_line(*mean_curve(record.inputs[0], record.outputs[0]))
    gain = study.benches[-1].actuator.plant.parameters["gain"].value
    small, elastic = rests[SPECIFIED], rests[ELASTIC]
    ends = [e for rest in (elastic, small) for e in (rest.exponents[0], rest.exponents[-1])]
    zero = -gain * line.offset / line.gain
    return [
        Note(
            title="“No deformation below a minimum voltage”",
            paragraphs=[
                "The thesis says that the film does not deform below some voltage. Maxwell stress goes with the square "
                "of the voltage from 0 V on, and the film is elastic for small motions, so the displacement does too: "
                f"from {small.voltages[0]:.0f} to {small.voltages[-1]:.0f} V that of the bare film grows with the "
                f"power {ends[0]:.3f} to {ends[1]:.3f} of the voltage. Hysteresis holds the ball back, but elastically "
                f"as long as the motion is smaller than its distance: the power is {ends[2]:.3f} first and "
                f"{ends[3]:.2f} where it begins to give way. Two things look like a threshold. The sensor reads in "
                f"steps, the first of which is reached at {small.visible:.0f} V; and the straight line through the "
                f"curve below 2.5 V meets zero at {zero:.0f} V."
            ],
        ),
        Note(
            title="“Only nonlinear systems move energy to other frequencies”",
            paragraphs=[
                "Linear systems that vary in time do as well, and an actuator that drifts is one. A lag whose gain "
                f"goes up and down by a fifth at {bands.drift:g} Hz answers a line at {bands.line:g} Hz with side "
                f"bands of {bands.reached[0]:.4f} and {bands.reached[1]:.4f} (in closed form {bands.expected[0]:.4f} "
                f"and {bands.expected[1]:.4f}), though it obeys superposition to {bands.superposition:.0e}. What tells "
                "the two apart is how far the power moves: a slow drift moves it by no more than its own frequency, "
                "the square of the voltage up to twice the highest of the input. Above 1 Hz it is the nonlinearity."
            ],
        ),
    ]


def _fabrications(benches: tuple[Bench, ...]) -> Table:
    """Each actuator's values beside those of the specification."""
    wished = specification()
    rows = []
    for name in TOLERANCES:
        of_all = [wished, *(bench.actuator.plant for bench in benches)]
        if name in wished.parameters:
            unit = wished.parameters[name].unit
            cells = [quantity(plant.parameters[name].value, unit) for plant in of_all]
        else:
            unit = "m" if name.endswith("radius") else "1"
            cells = [quantity(getattr(plant.rig, name), unit) for plant in of_all]
        rows.append([name.replace("_", " ").replace(".", ", "), *cells])
    names = ["quantity", "specification", *(bench.actuator.name for bench in benches)]
    return Table(title="Fabrications", columns=names, rows=rows)


def _histories(benches: tuple[Bench, ...]) -> Table:
    rows = []
    for bench in benches:
        for effect in bench.actuator.plant.effects:
            own = [bench.actuator.plant.parameters[p.name] for p in effect.parameters]
            values = ", ".join(f"{p.name.split('.')[1].replace('_', ' ')} {quantity(p.value, p.unit)}" for p in own)
            rows.append([bench.actuator.name, effect.name.replace("_", " "), values])
    return Table(title="Physics of each", columns=["actuator", "effect", "parameters"], rows=rows)


def _tolerances() -> Table:
    rows = [[n.replace("_", " ").replace(".", ", "), f"±{100 * t.share:g} %", t.reason] for n, t in TOLERANCES.items()]
    return Table(title="Tolerances", columns=["quantity", "largest departure", "reason"], rows=rows)
