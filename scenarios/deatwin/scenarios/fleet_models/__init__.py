"""Six actuators identified: twelve models, their validation, and what of it the drifts undo.

The recordings are those of the story `thesis-data`. Each is looked over, a stationary stretch is taken and its end
held out; sampling time, lags and degree are chosen by free-run error on the training sections; SEMP and SVB choose
terms, and the held-out sections say what the models are worth. What a model fails at is shown, and held against the
same actuator without its drift, and without its hysteresis, under the same commands and the same noise.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deatwin.ident.narx import Frols
from deatwin.scenarios.fleet_models.choice import Choice, compare
from deatwin.scenarios.fleet_models.figures import drawings
from deatwin.scenarios.fleet_models.notes import notes
from deatwin.scenarios.fleet_models.preparation import RULE
from deatwin.scenarios.fleet_models.study import METHODS, SVB, Study, carry_out
from deatwin.scenarios.fleet_models.tables import SHOWN, tables
from deatwin.scenarios.fleet_models.verdicts import judge
from deatwin.scenarios.provenance import RunRecord
from deatwin.scenarios.report.story import StoryPage, write_story
from deatwin.scenarios.stories import Setting

__all__ = ["run"]

LONGEST_PATH = 40
"""Of FRO, in terms, where it is held against SVB."""


def run(setting: Setting) -> Mapping[str, Any]:
    """Identify the fleet.

    Parameters
    ----------
    setting : Setting
        Folder, seed and the like; no public recordings are needed.

    Returns
    -------
    mapping
        The measures with what they demand and reach, the validation of each model, and a sentence.

    Raises
    ------
    SimulationError
        If a film pulls in.
    """
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    study = carry_out(setting.seed, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.9, "judging and drawing")
    rows = judge(study)
    fits = [bench.models[method].fit for method in METHODS for bench in study.recorded]
    sentence = (
        f"Six actuators, twelve models: over sections that nothing was fitted to, their free runs fit {min(fits):.0f} "
        f"to {max(fits):.0f} %; {sum(row.passed for row in rows)} of {len(rows)} stated measures are reached. What "
        "drift, hysteresis and the polynomials' own misfit leave is in the correlation tests."
    )
    figures, files = drawings(study, _choice(study))
    for name, columns in files.items():
        setting.folder.csv(name, columns)
    for bench in study.recorded:
        for method in METHODS:
            name = f"models/{bench.name.lower().replace(' ', '')}_{method.lower()}.json"
            setting.folder.save(name, bench.models[method].model.save)
    page = StoryPage(
        title="fleet-models", sentence=sentence, rows=rows, notes=notes(study), figures=figures, tables=tables(study)
    )
    write_story(setting.folder, page, setting.seed)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows], "models": _validations(study)}
    setting.folder.text("fleet-models.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _choice(study: Study) -> Choice:
    """Follow the paths of SVB and FRO on the actuator that is shown in full."""
    bench, plan = study.recorded[SHOWN - 1], study.plan
    fro = Frols(
        output_lags=plan.output_lags, input_lags=plan.input_lags, degree=plan.degree, rule=RULE,
        max_terms=LONGEST_PATH, criterion="none",
    )  # fmt: skip
    return compare(bench.models[SVB].search, fro.fit(bench.sections[0]), *bench.sections)


def _validations(study: Study) -> list[dict[str, Any]]:
    """What the held-out sections say of each model, as plain data."""
    return [
        {
            "actuator": bench.name,
            "recording": variant,
            "method": method,
            "terms": [str(term) for term in found.model.terms],
            "theta": found.model.theta.tolist(),
            "validation": found.held_out.to_json(),
        }
        for variant, benches in study.benches.items()
        for bench in benches
        for method, found in bench.models.items()
    ]
