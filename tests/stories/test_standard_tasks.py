"""The story of the standard tasks on a made-up one: runs begin where they should, and an interrupt keeps the table."""

import json
from dataclasses import replace

import numpy as np
import pytest
from stopping import StopAt

from deatwin.ident.nss import Pnlss
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording
from deatwin.scenarios.real_physics import standard_tasks
from deatwin.scenarios.real_physics.standard_tasks import STATES, Task
from deatwin.studies.public.black_boxes import LINEAR
from deatwin.studies.public.records import Candidates, DataSet
from deatwin.studies.public.sources import data_folder


def drained(seed: int) -> Recording:
    """Two tanks with linear outlets, from levels 3 and 1; the lower one is read."""
    u = np.random.default_rng(seed).uniform(0, 1, 300)
    upper, lower, readings = 3.0, 1.0, []
    for pump in u:
        readings.append(lower)
        upper, lower = upper + 0.1 * pump - 0.05 * upper, lower + 0.05 * upper - 0.02 * lower
    return Recording.from_arrays(u, np.array(readings), 4.0)


@pytest.fixture
def setting(setting, monkeypatch):
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
    test = standard_tasks.Test(name="validation", recording=data.test, goal=1e-3, shown=1)
    monkeypatch.setattr(standard_tasks, "METHODS", (LINEAR,))
    monkeypatch.setattr(
        standard_tasks, "standard_tasks", lambda *_: ((Task(data=data, tests=(test,), same_start=True),), ())
    )
    monkeypatch.setattr(standard_tasks, "calibrated", lambda *_: [])
    return setting


def test_a_state_space_begins_where_the_training_part_began(setting):
    # One sample shows the lower level alone: the upper one is known of the training part.
    errors = {row["model"]: row["error"] for row in standard_tasks.run(setting)["errors"]}
    assert errors[STATES] < 1e-6
    assert list(errors) == [STATES, LINEAR]


def test_an_interrupt_keeps_the_models_that_were_learned(setting):
    stop = StopAt(3)  # the second model has ended, perhaps before its time
    with pytest.raises(KeyboardInterrupt):
        standard_tasks.run(replace(setting, progress=stop))
    kept = json.loads((setting.folder.path / "standard-tasks.json").read_text(encoding="utf-8"))
    assert kept["sentence"].startswith("Interrupted after 1 of 2 models. ")
    assert [row["model"] for row in kept["errors"]] == [LINEAR]
    assert [text for _, text in stop.told] == [
        "0 of 2 models, still Drained tanks: output error, linear",
        "1 of 2 models, still Drained tanks: nonlinear state space",
        "2 of 2 models",
    ]


def test_one_worker_begins_with_the_shortest_and_several_with_the_longest():
    lengths = {"a": 1.0, "b": 60.0, "c": 0.2, "d": 50.0}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(standard_tasks, "_length", lambda job: lengths[job[0]])
        jobs = [(name, None) for name in lengths]
        assert [name for name, _ in standard_tasks._ordered(jobs, 1)] == ["c", "a", "d", "b"]
        assert [name for name, _ in standard_tasks._ordered(jobs, 2)] == ["b", "d", "a", "c"]


def test_data_sets_that_are_not_at_hand_are_left_out(tmp_path, monkeypatch):
    there = drained(0)
    tasks = {"_silverbox": None, "_tanks": there, "_emps": None, "_bouc_wen": None}
    for maker, task in tasks.items():
        name = maker.strip("_")
        monkeypatch.setattr(standard_tasks, maker, lambda data, name=name, task=task: task or data_folder(data, name))
    found, lines = standard_tasks.standard_tasks(tmp_path)
    assert found == (there,)
    assert standard_tasks.standard_tasks(tmp_path, ("cascaded-tanks",)) == ((there,), ())
    assert [line.split(" left out: ")[0] for line in lines] == ["Silverbox", "EMPS", "Bouc-Wen"]
    assert all("no such folder" in line and "\n" not in line for line in lines)
    monkeypatch.setattr(standard_tasks, "_tanks", lambda data: data_folder(data, "tanks"))
    with pytest.raises(DataError, match=r"Silverbox left out.*Cascaded tanks left out.*Bouc-Wen left out"):
        standard_tasks.standard_tasks(tmp_path)


def test_what_learned_no_model_has_no_size():
    outcome = standard_tasks.Outcome(data="drained", method="peer", seconds=0.0, failure="not installed")
    assert standard_tasks._size(outcome) == "–"
