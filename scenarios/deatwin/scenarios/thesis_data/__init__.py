"""The thesis' data: six actuators of one specification, recorded, and held against what the thesis saw in its own.

Its recordings are not public, and its figures 2.5 to 2.8 are known from the text only. So the figures here show what
the text says of them, and stated measures say whether the fleet does what the six did: a nearly straight curve below
2.5 V and a steep one above, loops that stay open, power at frequencies that the input does not have, and drifts that
all differ. Each drift is an effect of the catalogue (for the first actuator's roughness, one of its own), and so a
cause that `diagnose` may be asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from deatwin.ident.curves import mean_curve, straight_line
from deatwin.plant import specification
from deatwin.plant.files import write_recording
from deatwin.plant.fleet import TOLERANCES
from deatwin.plant.words import spaced
from deatwin.scenarios.thesis_data.page import ELASTIC, SPECIFIED, drawings, judge
from deatwin.scenarios.thesis_data.study import Bench, SmallVoltages, Study, carry_out, side_bands, small_voltages
from deatwin.studies.parallel import between
from deatwin.studies.report.drawing import key_of
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import StoryPage, Table, finish, reached
from deatwin.studies.report.words import Words, notes
from deatwin.studies.stories import Setting

WORDS = Words(__package__)


def run(setting: Setting) -> Mapping[str, Any]:
    """Record the six actuators, evaluate the recordings, and draw the figures."""
    record = setting.record()
    study = carry_out(setting.seed, jobs=setting.jobs, progress=between(setting.progress, 0.0, 0.9))
    setting.progress(0.9, "measuring and drawing")
    wished = specification()
    step = wished.rig.chain.reading_step  # type: ignore[union-attr]
    rests = {SPECIFIED: small_voltages(wished, step), ELASTIC: small_voltages(wished.without_effects(), step)}
    bands, rows = side_bands(), judge(study)
    for bench in study.benches:
        name = f"recordings/{key_of(bench.actuator.name).lower()}.csv"
        setting.folder.save(name, lambda path, r=bench.recording: write_recording(path, r))  # type: ignore[misc]
    page = StoryPage(
        title="thesis-data",
        sentence=WORDS.text("sentence", reached=reached(rows)),
        rows=rows,
        notes=notes(__package__, bands=bands, **_thresholds(study.benches[-1], rests)),
        figures=drawings(study, rests, bands, step),
        tables=_tables(study),
    )
    small = {name: {"exponents": rest.exponents.tolist(), "visible_V": rest.visible} for name, rest in rests.items()}
    sides = {name: getattr(bands, name) for name in ("reached", "expected", "superposition")}
    return finish(setting.folder, record, page, small_voltages=small, side_bands=sides)


def _thresholds(bench: Bench, rests: Mapping[str, SmallVoltages]) -> dict[str, Any]:
    """Apparent smallest voltages, and the powers that contradict them."""
    line = straight_line(*mean_curve(bench.recording.inputs[0], bench.recording.outputs[0]))
    gain = bench.actuator.plant.parameters["gain"].value
    return {
        "volts": rests[SPECIFIED].voltages,
        "elastic": rests[ELASTIC].exponents,
        "gripped": rests[SPECIFIED].exponents,
        "visible": rests[SPECIFIED].visible,
        "zero": -gain * line.offset / line.gain,
    }


def _tables(study: Study) -> list[Table]:
    names = [bench.actuator.name for bench in study.benches]
    tolerances = [[_spaced(name), f"±{100 * t.share:g} %", t.reason] for name, t in TOLERANCES.items()]
    return [
        WORDS.table("fabrications", list(_fabrications(study)), *names),
        WORDS.table("histories", list(_histories(study))),
        WORDS.table("tolerances", tolerances),
    ]


def _fabrications(study: Study) -> Iterator[list[str]]:
    """Each actuator's values beside those of the specification."""
    plants = [specification(), *(bench.actuator.plant for bench in study.benches)]
    for name in TOLERANCES:
        if name in plants[0].parameters:
            unit, values = plants[0].parameters[name].unit, [plant.parameters[name].value for plant in plants]
        else:
            unit, values = "m" if name.endswith("radius") else "1", [getattr(plant.rig, name) for plant in plants]
        yield [_spaced(name), *(quantity(value, unit) for value in values)]


def _histories(study: Study) -> Iterator[list[str]]:
    for plant, name in ((bench.actuator.plant, bench.actuator.name) for bench in study.benches):
        for effect in plant.effects:
            own = [plant.parameters[p.name] for p in effect.parameters]
            values = ", ".join(f"{spaced(p.name.split('.')[1])} {quantity(p.value, p.unit)}" for p in own)
            yield [name, spaced(effect.name), values]


def _spaced(name: str) -> str:
    return spaced(name).replace(".", ", ")
