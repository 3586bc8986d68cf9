"""Test the control check on rigs that it does not know: would its controllers survive the real actuator?

What an inverse feedforward buys, and how near it comes to a design on the true plant; one schedule on six actuators;
five models of one actuator, what each promises and gets; a concealed effect, and designs before and after its
diagnosis; and random rigs with random designs: how often a verdict keeps its word.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from deatwin.control import Specification
from deatwin.scenarios.control_check.concealed import BAND, CLOSED_LOOP_TIME, FAST, OTHER_TIMES, SECONDS, SLOW
from deatwin.scenarios.control_check.matters import QUANTITIES, Promise
from deatwin.scenarios.control_check.page import INVERSES, drawings, judge, tables
from deatwin.scenarios.control_check.rigs import CALIBRATED, CONCEALED
from deatwin.scenarios.control_check.study import Study, carry_out
from deatwin.scenarios.control_check.trials import NO_MODEL, PASS, broken, caught, in_words, inside, sound
from deatwin.studies.report.prose import notes
from deatwin.studies.report.story import Measure, StoryPage, finish, reached
from deatwin.studies.stories import Setting

SIZE = "short"


def run(setting: Setting) -> Mapping[str, Any]:
    """Design controllers, check them, run them on the true rigs, and write the report."""
    record, folder = setting.record(), setting.folder
    folder.written.extend(("seal.json", "trials"))  # trials are there as soon as they are through
    study = carry_out(folder.path, setting.size or SIZE, setting.seed, setting.jobs, setting.progress)
    setting.progress(1.0, "judging and drawing")
    rows = judge(study)
    page = StoryPage(
        title="control-check",
        sentence=_answer(study, rows),
        rows=rows,
        notes=notes(__package__, **_numbers(study)),
        figures=drawings(study),
        tables=tables(study),
    )
    return finish(folder, record, page)


def _answer(study: Study, rows: Sequence[Measure]) -> str:
    """Summarise the results in a few sentences."""
    factor = study.tracking[0].ratio("PI", "inverse")
    passed, unsound = inside(study.outcomes), caught(study.outcomes)
    return (
        f"With the inverse of the static curve, the tracking error of PI is {factor:.1f} times smaller, at equal "
        f"margins. Of {len(study.outcomes)} random rigs and designs the check passes {passed.count}, of which "
        f"{passed.hits} keep inside the predicted band; {unsound.count} break a limit on the true rig, of which it "
        f"passes {unsound.count - unsound.hits}. {reached(rows)} stated measures are reached."
    )


def _numbers(study: Study) -> dict[str, Any]:
    """Numbers of the notes: what was found, and what was chosen beforehand."""
    nominal, hysteretic = study.tracking
    outcomes, made = study.outcomes, study.matters.promises
    errors = {p.model: p.achieved for p in made if p.quantity == "rms error"}
    return {
        "against": nominal.tracked["inverse with dynamics"].rms / nominal.best,
        "pays": " and ".join(f"{hysteretic.ratio('PI', name):.1f}" for name in INVERSES),
        "near": " and ".join(f"{hysteretic.ratio(name, f'oracle: {name}'):.1f}" for name in INVERSES),
        "seconds": SECONDS,
        "band": BAND,
        "closed_loop_time": CLOSED_LOOP_TIME,
        "other_times": [f"{time:g}" for time in OTHER_TIMES],
        "slow": SLOW,
        "fast": FAST,
        "share_concealed": 100 * CONCEALED,
        "calibrated": ", ".join(name.replace("_", " ").replace(".", " ") for name in CALIBRATED),
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
