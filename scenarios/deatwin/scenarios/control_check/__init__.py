"""Test the control check on rigs that it does not know: would its controllers survive the real actuator?

What an inverse feedforward buys, and how near it comes to a design on the true plant; one schedule on six actuators;
five models of one actuator, what each promises and gets; a concealed effect, and designs before and after its
diagnosis; and random rigs with random designs: how often a verdict keeps its word.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from deatwin.control import Specification
from deatwin.plant.words import spaced
from deatwin.scenarios.control_check import concealed
from deatwin.scenarios.control_check.matters import QUANTITIES, Promise
from deatwin.scenarios.control_check.page import INVERSES, WORDS, drawings, judge, tables
from deatwin.scenarios.control_check.study import Study, carry_out
from deatwin.scenarios.control_check.trials import (
    CALIBRATED,
    CONCEALED,
    NO_MODEL,
    PASS,
    broken,
    caught,
    in_words,
    inside,
    sound,
)
from deatwin.studies.report.story import StoryPage, finish, reached
from deatwin.studies.report.words import notes
from deatwin.studies.stories import Setting

SIZE = "short"


def run(setting: Setting) -> Mapping[str, Any]:
    """Design controllers, check them, run them on the true rigs, and write the report."""
    record, folder = setting.record(), setting.folder
    folder.written.extend(("seal.json", "trials"))  # trials are there as soon as they are through
    study = carry_out(folder.path, setting.size or SIZE, setting.seed, setting.jobs, setting.progress)
    setting.progress(1.0, "judging and drawing")
    rows, unsound = judge(study), caught(study.outcomes)
    page = StoryPage(
        title="control-check",
        sentence=WORDS.text(
            "sentence",
            factor=study.tracking[0].ratio("PI", "inverse"),
            trials=len(study.outcomes),
            passed=inside(study.outcomes),
            unsound=unsound,
            missed=unsound.count - unsound.hits,
            reached=reached(rows),
        ),
        rows=rows,
        notes=notes(__package__, **_numbers(study)),
        figures=drawings(study),
        tables=tables(study),
    )
    return finish(folder, record, page)


def _numbers(study: Study) -> dict[str, Any]:
    """Numbers of the notes: what was found, and what was chosen beforehand."""
    nominal, hysteretic = study.tracking
    outcomes, made = study.outcomes, study.matters.promises
    errors = {p.model: p.achieved for p in made if p.quantity == "rms error"}
    return {
        "against": nominal.tracked["inverse with dynamics"].rms / nominal.best,
        "pays": " and ".join(f"{hysteretic.ratio('PI', name):.1f}" for name in INVERSES),
        "near": " and ".join(f"{hysteretic.ratio(name, f'oracle: {name}'):.1f}" for name in INVERSES),
        "concealed": concealed,
        "share_concealed": 100 * CONCEALED,
        "calibrated": ", ".join(spaced(name).replace(".", " ") for name in CALIBRATED),
        "reserve": 100 * Specification().reserve,
        "trials": len(outcomes),
        "inside": in_words(inside(outcomes)),
        "sound": in_words(sound(outcomes)),
        "caught": in_words(caught(outcomes)),
        "missed": len(broken(outcomes)),
        "cautious": sum(o.verdict != PASS and o.sound is True for o in outcomes),
        "no_model": sum(o.verdict == NO_MODEL for o in outcomes),
        "errors": ", ".join(f"{name} {error:.3g} µm" for name, error in errors.items()),
        "kept": _kept(made),
        "by_quantity": ", ".join(f"{name} {_kept([p for p in made if p.quantity == name])}" for name in QUANTITIES),
        "of_physics": _kept([p for p in made if p.model == "calibrated plant"]),
    }


def _kept(promises: Sequence[Promise]) -> str:
    return f"{sum(p.kept for p in promises)} of {len(promises)}"
