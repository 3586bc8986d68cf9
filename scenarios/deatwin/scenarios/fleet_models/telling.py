"""How both stories run, and what they write."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from deatwin.scenarios.fleet_models.figures import Columns
from deatwin.scenarios.fleet_models.study import Programme, Study, carry_out
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import StoryPage, write_story
from deatwin.studies.stories import Setting

Account = tuple[StoryPage, Mapping[str, Columns]]
"""A page, whose title is the name of the story, and the columns of each CSV file."""


def tell(
    setting: Setting, programme: Programme, method: str, account: Callable[[Setting, Study], Account]
) -> Mapping[str, Any]:
    """Identify the fleet, and write the page, the models of a method, the data of the figures and what is plain data."""
    record = setting.record()
    study = carry_out(setting.seed, programme, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.9, "judging and drawing")
    page, files = account(setting, study)
    return _written(setting.folder, page, study, method, files, record)


def _written(
    folder: ResultFolder, page: StoryPage, study: Study, method: str, files: Mapping[str, Columns], record: RunRecord
) -> Mapping[str, Any]:
    for name, columns in files.items():
        folder.csv(name, columns)
    for bench in study.recorded:
        name = f"models/{bench.name.lower().replace(' ', '')}_{method.lower()}.json"
        folder.save(name, bench.models[method].model.save)
    write_story(folder, page, record)
    result = {"sentence": page.sentence, "measures": [asdict(row) for row in page.rows], "models": _validations(study)}
    folder.text(f"{page.title}.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    folder.text("run.json", json.dumps(record.finished([*folder.written, "run.json"]), indent=1) + "\n")
    return result


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
