"""What both stories write."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deatwin.scenarios.fleet_models.figures import Columns
from deatwin.scenarios.fleet_models.study import Study
from deatwin.scenarios.provenance import RunRecord
from deatwin.scenarios.report.story import StoryPage, write_story
from deatwin.scenarios.stories import Setting

__all__ = ["tell"]


def tell(
    setting: Setting, page: StoryPage, study: Study, *, method: str, files: Mapping[str, Columns], record: RunRecord
) -> Mapping[str, Any]:
    """Write the page, the models of a method, the data of the figures and what is plain data.

    Parameters
    ----------
    setting : Setting
        With the folder.
    page : StoryPage
        Its title is the name of the story.
    study : Study
        All of it.
    method : str
        Whose six models are the story's own.
    files : mapping of str to mapping of str to ndarray
        Columns of each CSV file.
    record : RunRecord
        Begun with the run.

    Returns
    -------
    mapping
        The measures with what they demand and reach, the validation of each model, and the sentence.
    """
    folder = setting.folder
    for name, columns in files.items():
        folder.csv(name, columns)
    for bench in study.recorded:
        name = f"models/{bench.name.lower().replace(' ', '')}_{method.lower()}.json"
        folder.save(name, bench.models[method].model.save)
    write_story(folder, page, record)
    result = {
        "sentence": page.sentence, "measures": [asdict(row) for row in page.rows], "models": _validations(study),
    }  # fmt: skip
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
