"""The live view's diagnoses: how they are started, followed, cancelled and refused, and what they leave."""

import json
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from deatwin.app.cli import main
from deatwin.app.live import jobs, worker
from deatwin.app.live.desk import Desk
from deatwin.app.live.jobs import MOST_RUNNING, Board, Job, Order, State
from deatwin.plant.errors import DataError
from deatwin.plant.readoptions import ReadOptions

SLOW = """
import json, signal, sys, time
print(json.dumps({"share": 0.25, "step": "half asleep"}), flush=True)
time.sleep(60)
"""
STUBBORN = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n" + SLOW
QUICK = """
import json, pathlib, sys
out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
(out / "diagnosis.json").write_text("{}")
print("not a fact")
print(json.dumps({"share": 0.5, "step": "fitting"}))
print(json.dumps({"share": 1.0, "verdict": "named", "sentence": "it creeps"}))
"""
KEEPS = (
    """
import pathlib
kept = pathlib.Path("found/partial")
kept.mkdir()
(kept / "steps.json").write_text("{}")
"""
    + SLOW
)
"""What it finished stands there when it is cancelled."""
WRONG = 'import sys; print("a warning", file=sys.stderr); sys.exit("error: noise.csv: no column")'


def board(root: Path, code: str) -> Board:
    return Board(root, [sys.executable, "-c", code])


def order(**changed: Any) -> Order:
    return replace(Order(command="diagnose", rig="rig.toml", recordings=("noise.csv",), out="found"), **changed)


def until(true: Callable[[], bool]) -> None:
    for _ in range(600):
        if true():
            return
        time.sleep(0.05)
    raise AssertionError("it did not come to that in half a minute")


def test_a_job_is_followed_to_its_end(root):
    job = board(root, QUICK).start(order())
    job.wait(30)
    assert (job.state, job.share, job.sentence) == (State.DONE, 1.0, "named: it creeps")
    assert [step for step, _ in job.steps] == ["fitting"] and 0 <= job.steps[0][1] <= job.seconds
    assert Desk.look(root).results == ("found",)


def test_what_is_done_within_a_step_is_no_step(root):
    job = board(root, "").start(order())
    job.wait(30)
    for share, step in (
        (0.3, "fitting the model with added effects"),
        (0.3, "fitting the model with added effects (creep)"),
        (0.8, "verifying"),
    ):
        job._hear(json.dumps({"share": share, "step": step}))
    assert [step for step, _ in job.steps] == ["fitting the model with added effects", "verifying"]


def test_a_job_gets_the_arguments_of_the_command(root):
    asked = order(
        recordings=("-a.csv", "b.csv"), reading=ReadOptions(input_column="-U", dt=0.02, allow_gaps=True), seed=3
    )
    words = "diagnose rig.toml ./-a.csv b.csv --out found --seed 3 --input-column=-U --dt=0.02 --allow-gaps"
    assert asked.arguments == words.split()
    parsed = worker._parse(asked.arguments)
    assert [str(path) for path in parsed["recordings"]] == ["-a.csv", "b.csv"]
    assert (parsed["input_column"], parsed["output_column"]) == ("-U", None)
    assert (parsed["allow_gaps"], parsed["seed"], parsed["dt"]) == (True, 3, 0.02)


@pytest.mark.parametrize(("commands", "files"), [(("-a.csv",), "rig.toml ./-a.csv"), ((), "rig.toml")])
def test_a_plan_reads_commands_only(commands, files):
    asked = order(command="plan", out="planned", recordings=commands, reading=ReadOptions(output_column="y", dt=0.02))
    assert asked.arguments == f"plan {files} --out planned --seed 0 --dt=0.02".split()
    parsed = worker._parse(asked.arguments)
    assert str(parsed["commands"] or "") == "".join(commands)


def test_a_plan_needs_no_recording_but_a_rig(root):
    with pytest.raises(DataError, match=r"^choose a rig file$"):
        board(root, QUICK).start(order(command="plan", rig="", recordings=()))


def test_a_failed_job_says_why_and_leaves_no_folder(root):
    job = board(root, WRONG).start(order())
    job.wait(30)
    assert (job.state, job.sentence) == (State.FAILED, "noise.csv: no column")
    assert not (root / "found").exists()


@pytest.mark.parametrize("code", [SLOW, STUBBORN], ids=["obedient", "stubborn"])
def test_a_cancelled_job_ends_whatever_it_does(code, root, monkeypatch):
    monkeypatch.setattr(jobs, "GRACE", 0.2)
    job = board(root, code).start(order())
    until(lambda: job.share == 0.25)
    assert job.seconds_left is not None and job.state is State.RUNNING
    job.cancel()
    job.wait(30)
    assert job.state is State.CANCELLED and not (root / "found").exists()


def test_what_a_cancelled_job_has_written_stays(root):
    job = board(root, "import pathlib; pathlib.Path('found/half.csv').write_text('x')\n" + SLOW).start(order())
    until(lambda: job.share == 0.25)
    job.cancel()
    job.wait(30)
    assert (root / "found" / "half.csv").read_text(encoding="utf-8") == "x"


def test_the_name_of_a_cancelled_job_that_kept_steps_may_be_used_again(root):
    jobs = board(root, KEEPS)
    first = jobs.start(order())
    until(lambda: first.share == 0.25)
    with pytest.raises(DataError, match="found: a running job writes into it"):
        jobs.start(order())
    first.cancel()
    first.wait(30)
    kept = root / "found" / "partial" / "steps.json"
    assert first.state is State.CANCELLED and kept.read_text(encoding="utf-8") == "{}"
    failed = board(root, WRONG).start(order())
    failed.wait(30)
    assert failed.state is State.FAILED and kept.is_file()  # nothing is lost before there is something new
    again = board(root, QUICK).start(order())
    again.wait(30)
    assert again.state is State.DONE and (root / "found" / "diagnosis.json").is_file()


@pytest.mark.parametrize("beside", ["diagnosis.json", "half.csv", "partial/notes.md", "figures/residual.csv"])
def test_what_holds_more_than_the_steps_of_a_cancelled_job_is_not_replaced(beside, root):
    for name in ("partial/steps.json", "partial/base_model.json", beside):
        (root / "found" / name).parent.mkdir(parents=True, exist_ok=True)
        (root / "found" / name).write_text("{}", encoding="utf-8")
    with pytest.raises(DataError, match="found: this name is already taken, and results are not replaced"):
        board(root, QUICK).start(order())
    (root / "found" / beside).unlink()
    if beside.startswith("figures"):
        (root / "found" / "figures").rmdir()
    jobs = board(root, QUICK)
    jobs.start(order()).wait(30)
    assert jobs.jobs[0].state is State.DONE


def test_a_link_to_the_steps_of_a_cancelled_job_is_not_written_through(root):
    (root.parent / "elsewhere" / "partial").mkdir(parents=True)
    (root / "found").symlink_to(root.parent / "elsewhere")
    (root / "second").mkdir()
    (root / "second" / "partial").symlink_to(root.parent / "elsewhere" / "partial")
    for out in ("found", "second"):
        with pytest.raises(DataError, match=f"{out}: this name is already taken"):
            board(root, QUICK).start(order(out=out))


def test_closing_the_board_ends_a_job_and_what_it_started(root):
    child = "import os, subprocess, sys\nc = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
    jobs = board(root, child + "open('child', 'w').write(str(c.pid))\n" + SLOW)
    job = jobs.start(order())
    until(lambda: job.share == 0.25)
    child_id = int((root / "child").read_text(encoding="utf-8"))
    jobs.close()
    assert job.state is State.CANCELLED and jobs.running == []
    until(lambda: ended(child_id))


def ended(process: int) -> bool:
    """Whether a process is gone, or waits for nothing but to be counted as such."""
    try:
        os.kill(process, 0)
        status = Path(f"/proc/{process}/stat")
        return status.is_file() and status.read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z"
    except ProcessLookupError:
        return True


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"recordings": ()}, "choose a rig file and at least one recording"),
        ({"rig": ""}, "choose a rig file"),
        ({"rig": "../secret.csv"}, "lies outside of"),
        ({"recordings": ("noise.csv", "/etc/hostname")}, "lies outside of"),
        ({"recordings": ("gone.csv",)}, "gone.csv: there is no such file in the folder"),
        ({"rig": "os:getcwd"}, "os:getcwd: there is no such file in the folder"),
        ({"out": "../found"}, '../found: not a valid name for a folder here; use for example "found"'),
        ({"out": "rig.toml"}, "rig.toml: this name is already taken, and results are not replaced"),
    ],
)
def test_an_order_that_cannot_be_is_refused(changed, message, root):
    before = sorted(root.parent.rglob("*"))
    with pytest.raises(DataError, match=re.escape(message)):
        board(root, QUICK).start(order(**changed))
    assert sorted(root.parent.rglob("*")) == before


def test_too_many_at_once_are_refused(root):
    jobs = board(root, SLOW)
    for number in range(MOST_RUNNING):
        jobs.start(order(out=f"found-{number}"))
    with pytest.raises(DataError, match="are running"):
        jobs.start(order(out="more"))
    jobs.close()


def test_no_module_of_the_folder_is_imported(root):
    (root / "json.py").write_text("raise SystemExit('taken in')", encoding="utf-8")
    job = Job(root, order(), [sys.executable, "-m", "json.tool", "--help"])
    job.wait(30)
    assert (job.state, job.sentence) == (State.DONE, "")


def test_the_worker_hears_an_interrupt_that_was_dropped(monkeypatch, capsys, heard):
    def dropped(arguments: Sequence[str]) -> None:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        worker._progress(0.5, "fitting")

    monkeypatch.setattr(worker, "_diagnose", dropped)
    assert worker.main(["diagnose"]) == 130
    said = capsys.readouterr()
    assert ("interrupted" in said.err, said.out) == (True, "")


def test_the_worker_complains_as_the_command_does(root, monkeypatch, capsys):
    monkeypatch.chdir(root)
    arguments = ["diagnose", "rig.toml", "noise.csv", "--out", "found"]
    assert (worker.main(arguments), capsys.readouterr().err) == (main(arguments), capsys.readouterr().err)
