"""The story of the standard tasks on a made-up one: runs begin where they should, and an interrupt keeps the table."""

import json
from dataclasses import replace

import numpy as np
import pytest
from stopping import StopAt

from deatwin.ident.nss import Pnlss
from deatwin.plant.recording import Recording
from deatwin.scenarios.real_physics import standard_tasks, task_parts
from deatwin.scenarios.real_physics.task_parts import STATES, Task
from deatwin.studies.public.black_boxes import LINEAR
from deatwin.studies.public.records import Candidates, DataSet
from deatwin.studies.stories import Setting


def drained(seed: int) -> Recording:
    """Two tanks with linear outlets, from levels 3 and 1; the lower one is read."""
    u = np.random.default_rng(seed).uniform(0, 1, 300)
    upper, lower, readings = 3.0, 1.0, []
    for pump in u:
        readings.append(lower)
        upper, lower = upper + 0.1 * pump - 0.05 * upper, lower + 0.05 * upper - 0.02 * lower
    return Recording.from_arrays(u, np.array(readings), 4.0)


@pytest.fixture
def setting(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> Setting:
    data = DataSet(
        name="drained",
        title="Drained tanks",
        train=drained(0),
        test=drained(1),
        candidates=Candidates(output_lags=2, input_lags=(1, 2), degree=1, max_terms=4),
        unit="V",
        scale=1.0,
        further={STATES: Pnlss(states=2, degrees=(), feedthrough=False)},
    )
    test = task_parts.Test(name="validation", recording=data.test, goal=1e-3, published="", shown=1)
    monkeypatch.setattr(task_parts, "METHODS", (LINEAR,))
    monkeypatch.setattr(standard_tasks, "standard_tasks", lambda _: (Task(data=data, tests=(test,), same_start=True),))
    monkeypatch.setattr(standard_tasks, "calibrated", lambda *_: [])
    return setting


def test_a_state_space_begins_where_the_training_part_began(setting: Setting) -> None:
    # One sample shows the lower level alone: the upper one is known of the training part.
    errors = {row["model"]: row["error"] for row in standard_tasks.run(setting)["errors"]}
    assert errors[STATES] < 1e-6
    assert list(errors) == [STATES, LINEAR]


def test_an_interrupt_keeps_the_models_that_were_learned(setting: Setting) -> None:
    stop = StopAt(3)  # the second model has ended, perhaps before its time
    with pytest.raises(KeyboardInterrupt):
        standard_tasks.run(replace(setting, progress=stop))
    kept = json.loads((setting.folder.path / "standard-tasks.json").read_text(encoding="utf-8"))
    assert kept["sentence"].startswith("Interrupted after 1 of 2 models. ")
    assert [row["model"] for row in kept["errors"]] == [STATES]
    assert [text for _, text in stop.told] == [
        "0 of 2 models, still Drained tanks: nonlinear state space",
        "1 of 2 models, still Drained tanks: output error, linear",
        "2 of 2 models",
    ]
