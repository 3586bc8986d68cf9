"""The live view without a browser: what it lists, takes, starts, stops, compares, and whom it answers."""

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

from deatwin.plant.errors import DataError, DeatwinError
from deatwin.scenarios.cli import main
from deatwin.scenarios.live import worker
from deatwin.scenarios.live.comparison import compare
from deatwin.scenarios.live.desk import Desk, free_name, inside, safe_name
from deatwin.scenarios.live.guard import Guard
from deatwin.scenarios.live.jobs import MOST_RUNNING, Board, Job, Order, State
from deatwin.scenarios.live.uploads import keep_upload
from deatwin.scenarios.live.verdicts import Verdict

ROWS = [f"{0.02 * k:.2f},{2 + 0.1 * (k % 7):.1f},0.3\n" for k in range(40)]
TABLE = "time_s,command_V,displacement_mm\n" + "".join(ROWS)
DIAGNOSIS: dict[str, Any] = {
    "schema": "deatwin/diagnosis/1", "output": {"name": "displacement", "unit": "um"}, "verdict": "named",
    "noise": 2.0, "model_error": 0.9,
    "detect": {"p_value": 0.0, "excess": 4.1, "smallest_detectable": {"creep": 0.4}},
    "locate": {"time": [], "frequency": [], "region": [], "place": []},
    "causes": [{
        "effect": "creep", "family": "film", "probability": 0.98, "share_explained": 0.97,
        "parameters": {"time": {"value": 54.0, "low": 50.0, "high": 59.0, "unit": "s"}},
    }],
    "set": ["creep"], "indistinguishable": [], "next_experiment": None, "free_form": None,
    "sentence": "The film <keeps> creeping.",
    "fit": {"fitted": {"before": 9.8, "after": 2.05}, "unseen": {"before": 10.2, "after": 2.1, "gain_low": 7.4}},
    "warnings": [],
}  # fmt: skip
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
KEEPS = """
import pathlib
kept = pathlib.Path("found/partial")
kept.mkdir()
(kept / "steps.json").write_text("{}")
""" + SLOW
"""What it finished stands there when it is cancelled."""
WRONG = 'import sys; print("a warning", file=sys.stderr); sys.exit("error: noise.csv: no column")'


def write_result(folder: Path, recordings: dict[str, str] | None = None, **changed: Any) -> None:
    folder.mkdir(parents=True)
    (folder / "diagnosis.json").write_text(json.dumps({**DIAGNOSIS, **changed}), encoding="utf-8")
    if recordings is not None:
        inputs = [{"file": file, "sha256": 64 * digit} for file, digit in recordings.items()]
        (folder / "run.json").write_text(json.dumps({"inputs": inputs, "seconds": 12.5}), encoding="utf-8")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with a rig and a recording, and a secret beside it."""
    root = tmp_path / "lab"
    root.mkdir()
    (root / "rig.toml").write_text("", encoding="utf-8")
    (root / "noise.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "secret.csv").write_text(TABLE, encoding="utf-8")
    return root


# Names


@pytest.mark.parametrize("name", ["../secret.csv", "sub/../../secret.csv", "/etc/hostname", "..", "leads/out.csv"])
def test_a_name_that_leads_out_of_the_folder_is_refused(name: str, root: Path) -> None:
    (root / "leads").mkdir()
    (root / "leads" / "out.csv").symlink_to(root.parent / "secret.csv")
    with pytest.raises(DataError, match="lies outside of"):
        inside(root, name)


def test_a_folder_that_is_a_link_outwards_and_one_that_has_a_null_are_refused(root: Path) -> None:
    (root / "up").symlink_to(root.parent)
    with pytest.raises(DataError, match="lies outside of"):
        inside(root, "up/secret.csv")
    with pytest.raises(DataError, match="no name of a file"):
        inside(root, "noise\0.csv")


def test_a_name_inside_is_its_path_also_where_the_folder_itself_is_a_link(root: Path) -> None:
    (root.parent / "shortcut").symlink_to(root)
    assert inside(root, "noise.csv") == inside(root.parent / "shortcut", "sub/../noise.csv") == root / "noise.csv"


@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        ("noise.csv", "noise.csv"),
        ("../../etc/noise.csv", "noise.csv"),
        ("C:\\lab\\noise.csv", "noise.csv"),
        ("--out.csv", "out.csv"),
        (".hidden.csv", "hidden.csv"),
        ('a<b>:"|?*\n.csv', "a_b_______.csv"),
        ("Übung 1.csv", "Übung 1.csv"),
        ("U\u0308bung.csv", "Übung.csv"),
    ],
)
def test_a_name_that_is_sent_becomes_one_of_a_file_in_the_folder(sent: str, kept: str) -> None:
    assert safe_name(sent) == kept


@pytest.mark.parametrize("sent", ["", "...", "/", "a" * 101 + ".csv", "con.csv", "LPT1", "a\u202eb.csv"])
def test_a_name_of_which_nothing_can_be_made_is_refused(sent: str) -> None:
    with pytest.raises(DataError):
        safe_name(sent)


# What lies in the folder


def test_recordings_rigs_and_results_are_listed_and_nothing_else(root: Path) -> None:
    write_result(root / "found")
    for name in ("model.json", "next_input.csv", "figures/residual.csv", "rivals/delay.json", "kept.csv"):
        (root / "found" / name).parent.mkdir(exist_ok=True)
        (root / "found" / name).write_text("", encoding="utf-8")
    for name in ("day 2/steps.TSV", ".cache/a.csv", "notes.md", "a/b/c/d/deep.csv", "a/b/c/near.nc"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("", encoding="utf-8")
    (root / "out.csv").symlink_to(root.parent / "secret.csv")
    (root / "up").symlink_to(root.parent)
    (root / "again.csv").symlink_to(root / "noise.csv")
    desk = Desk.look(root)
    assert desk.recordings == ("a/b/c/near.nc", "again.csv", "day 2/steps.TSV", "found/kept.csv", "noise.csv")
    assert desk.rigs == ("found/model.json", "rig.toml")
    assert desk.results == ("found",)
    assert desk.whole


def test_a_folder_of_results_is_itself_a_result(tmp_path: Path) -> None:
    write_result(tmp_path / "found")
    assert Desk.look(tmp_path / "found").results == (".",)


def test_a_full_folder_is_listed_in_part_and_says_so(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deatwin.scenarios.live.desk.MOST_FILES", 1)
    desk = Desk.look(root)
    assert (len(desk.recordings) + len(desk.rigs), desk.whole) == (1, False)


def test_a_name_that_is_taken_is_not_offered(root: Path) -> None:
    assert free_name(root) == "diagnosis-1"
    (root / "diagnosis-1").mkdir()
    (root / "diagnosis-2").symlink_to("nowhere")
    assert free_name(root) == "diagnosis-3"


# Uploads


def left_over(root: Path) -> set[str]:
    return {path.name for path in root.iterdir()} - {"rig.toml", "noise.csv"}


def test_a_sound_recording_is_kept_under_its_own_name(root: Path) -> None:
    assert keep_upload(root, "..\\steps.csv", TABLE.encode(), most_bytes=10_000) == "steps.csv"
    assert (root / "steps.csv").read_text(encoding="utf-8") == TABLE
    assert left_over(root) == {"steps.csv"}


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("big.csv", TABLE * 20, r"big.csv: 0.0 MB; at most 0.01 MB are taken \(--upload-limit\)"),
        ("page.html", TABLE, r'page.html: files ".html" are not taken; drop one of .csv, .txt, .tsv, .toml'),
        ("noise.csv", TABLE, "noise.csv: the folder has a file of this name; rename yours"),
        ("key.toml", "[film]\nprestrech = 3", r'^key.toml: .+ line 2, \[film\]: unknown key "prestrech"; did you mean'),
    ],
)
def test_what_is_not_taken_leaves_nothing_behind(name: str, content: str, message: str, root: Path) -> None:
    with pytest.raises(DeatwinError, match=message):
        keep_upload(root, name, content.encode(), most_bytes=10_000)
    assert left_over(root) == set()
    assert (root / "noise.csv").read_text(encoding="utf-8") == TABLE


@pytest.mark.parametrize(
    "content", [TABLE.replace("command_V", "comand_V"), TABLE.replace("0.12,", "0.12,nan"), "", "time_s\n", "\x00\x01"]
)
def test_a_bad_recording_is_refused_in_the_words_of_the_command_line(
    content: str, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DataError) as refused:
        keep_upload(root, "bad.csv", content.encode(), most_bytes=10_000)
    monkeypatch.chdir(root)
    (root / "bad.csv").write_text(content, encoding="utf-8", newline="")
    assert main(["identify", "bad.csv", "--out", "model.json"]) == 1
    assert capsys.readouterr().err == f"error: {refused.value}\n"


def test_other_columns_are_read_as_they_are_named(root: Path) -> None:
    content = TABLE.replace("command_V", "U").encode()
    columns = {"input_column": "U", "output_column": "displacement_mm"}
    assert keep_upload(root, "other.csv", content, most_bytes=10_000, **columns) == "other.csv"
    with pytest.raises(DataError, match="command_V"):
        keep_upload(root, "again.csv", content, most_bytes=10_000)


# Jobs


def board(root: Path, code: str) -> Board:
    return Board(root, [sys.executable, "-c", code])


def order(**changed: Any) -> Order:
    return replace(Order(rig="rig.toml", recordings=("noise.csv",), out="found"), **changed)


def until(true: Callable[[], bool]) -> None:
    for _ in range(600):
        if true():
            return
        time.sleep(0.05)
    raise AssertionError("it did not come to that in half a minute")


def test_a_job_is_followed_to_its_end(root: Path) -> None:
    job = board(root, QUICK).start(order())
    job.wait(30)
    assert (job.state, job.share, job.sentence) == (State.DONE, 1.0, "named: it creeps")
    assert [step for step, _ in job.steps] == ["fitting"] and 0 <= job.steps[0][1] <= job.seconds
    assert Desk.look(root).results == ("found",)


def test_a_job_gets_the_arguments_of_the_command(root: Path) -> None:
    asked = order(recordings=("-a.csv", "b.csv"), input_column="-U", allow_gaps=True, seed=3)
    words = "diagnose rig.toml ./-a.csv b.csv --out found --seed 3 --input-column=-U --allow-gaps"
    assert asked.arguments == words.split()
    parsed = worker._parse(asked.arguments)
    assert [str(path) for path in parsed["recordings"]] == ["-a.csv", "b.csv"]
    assert (parsed["input_column"], parsed["output_column"]) == ("-U", None)
    assert (parsed["allow_gaps"], parsed["seed"]) == (True, 3)


def test_a_failed_job_says_why_and_leaves_no_folder(root: Path) -> None:
    job = board(root, WRONG).start(order())
    job.wait(30)
    assert (job.state, job.sentence) == (State.FAILED, "noise.csv: no column")
    assert not (root / "found").exists()


@pytest.mark.parametrize("code", [SLOW, STUBBORN], ids=["obedient", "stubborn"])
def test_a_cancelled_job_ends_whatever_it_does(code: str, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deatwin.scenarios.live.jobs.GRACE", 0.2)
    job = board(root, code).start(order())
    until(lambda: job.share == 0.25)
    assert job.seconds_left is not None and job.state is State.RUNNING
    job.cancel()
    job.wait(30)
    assert job.state is State.CANCELLED and not (root / "found").exists()


def test_what_a_cancelled_job_has_written_stays(root: Path) -> None:
    job = board(root, "import pathlib; pathlib.Path('found/half.csv').write_text('x')\n" + SLOW).start(order())
    until(lambda: job.share == 0.25)
    job.cancel()
    job.wait(30)
    assert (root / "found" / "half.csv").read_text(encoding="utf-8") == "x"


def test_the_name_of_a_cancelled_job_that_kept_steps_may_be_used_again(root: Path) -> None:
    jobs = board(root, KEEPS)
    first = jobs.start(order())
    until(lambda: first.share == 0.25)
    with pytest.raises(DataError, match="found: a diagnosis that runs writes into it"):
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
def test_what_holds_more_than_the_steps_of_a_cancelled_job_is_not_replaced(beside: str, root: Path) -> None:
    for name in ("partial/steps.json", "partial/base_model.json", beside):
        (root / "found" / name).parent.mkdir(parents=True, exist_ok=True)
        (root / "found" / name).write_text("{}", encoding="utf-8")
    with pytest.raises(DataError, match="found: is there already; results are not replaced"):
        board(root, QUICK).start(order())
    (root / "found" / beside).unlink()
    if beside.startswith("figures"):
        (root / "found" / "figures").rmdir()
    jobs = board(root, QUICK)
    jobs.start(order()).wait(30)
    assert jobs.jobs[0].state is State.DONE


def test_a_link_to_the_steps_of_a_cancelled_job_is_not_written_through(root: Path) -> None:
    (root.parent / "elsewhere" / "partial").mkdir(parents=True)
    (root / "found").symlink_to(root.parent / "elsewhere")
    (root / "second").mkdir()
    (root / "second" / "partial").symlink_to(root.parent / "elsewhere" / "partial")
    for out in ("found", "second"):
        with pytest.raises(DataError, match=f"{out}: is there already"):
            board(root, QUICK).start(order(out=out))


def test_closing_the_board_ends_a_job_and_what_it_started(root: Path) -> None:
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
        ({"out": "../found"}, '../found: no name for a folder here; take for example "found"'),
        ({"out": "rig.toml"}, "rig.toml: is there already; results are not replaced"),
    ],
)
def test_an_order_that_cannot_be_is_refused(changed: dict[str, Any], message: str, root: Path) -> None:
    before = sorted(root.parent.rglob("*"))
    with pytest.raises(DataError, match=re.escape(message)):
        board(root, QUICK).start(order(**changed))
    assert sorted(root.parent.rglob("*")) == before


def test_too_many_at_once_are_refused(root: Path) -> None:
    jobs = board(root, SLOW)
    for number in range(MOST_RUNNING):
        jobs.start(order(out=f"found-{number}"))
    with pytest.raises(DataError, match="are running"):
        jobs.start(order(out="more"))
    jobs.close()


def test_no_module_of_the_folder_is_imported(root: Path) -> None:
    (root / "json.py").write_text("raise SystemExit('taken in')", encoding="utf-8")
    job = Job(root, order(), [sys.executable, "-m", "json.tool", "--help"])
    job.wait(30)
    assert (job.state, job.sentence) == (State.DONE, "")


def test_the_worker_complains_as_the_command_does(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(root)
    arguments = ["diagnose", "rig.toml", "noise.csv", "--out", "found"]
    assert (worker.main(arguments), capsys.readouterr().err) == (main(arguments), capsys.readouterr().err)


# Verdicts side by side


def test_a_verdict_is_read_with_its_recordings(root: Path) -> None:
    write_result(root / "found", {"rig.toml": "c", "noise.csv": "a"})
    verdict = Verdict.read(root, "found")
    assert (verdict.verdict, verdict.tone, verdict.unit, verdict.fault) == ("named", "good", "µm", "")
    assert (verdict.fitted, verdict.unseen, verdict.noise) == ((9.8, 2.05), (10.2, 2.1), 2.0)
    assert [(cause.effect, cause.parameters) for cause in verdict.causes] == [
        ("creep", (("time", "54 s", "50 to 59 s"),))
    ]
    assert verdict.recordings == {64 * "a"} and verdict.seconds == 12.5 and not verdict.report


@pytest.mark.parametrize("text", ["", "{}", '{"schema": "deatwin/narx/1"}', "[" * 100_000])
def test_a_damaged_result_is_a_fault_and_no_traceback(text: str, root: Path) -> None:
    (root / "broken").mkdir()
    (root / "broken" / "diagnosis.json").write_text(text, encoding="utf-8")
    verdict = Verdict.read(root, "broken")
    assert verdict.fault.startswith("broken/diagnosis.json: ") and str(root) not in verdict.fault
    assert "broken/diagnosis.json: " in compare([verdict]).html()


def test_a_result_that_lies_outside_is_not_read(root: Path) -> None:
    write_result(root.parent / "elsewhere")
    assert "lies outside of" in Verdict.read(root, "../elsewhere").fault
    (root / "linked").mkdir()
    (root / "linked" / "diagnosis.json").symlink_to(root.parent / "elsewhere" / "diagnosis.json")
    assert "lies outside of" in Verdict.read(root, "linked").fault


def test_errors_of_one_unit_are_drawn_to_one_scale(root: Path) -> None:
    fit = {"fitted": {"before": 40.0, "after": None}, "unseen": {"before": 30.0, "after": None, "gain_low": None}}
    write_result(root / "one")
    write_result(root / "two", fit=fit, causes=[], verdict="unknown")
    write_result(root / "force", output={"name": "force", "unit": "N"})
    comparison = compare([Verdict.read(root, name) for name in ("one", "two", "force", "gone")])
    assert comparison.limits == (40.0, 40.0, 10.2, 0.0)


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        ({"noise.csv": "a", "rig.toml": "b"}, {"other name.csv": "a", "rig.toml": "c"}, True),
        ({"noise.csv": "a"}, {"noise.csv": "b"}, False),
        ({"noise.csv": "a"}, None, None),
    ],
)
def test_it_is_said_whether_the_recordings_are_the_same(
    first: dict[str, str], second: dict[str, str] | None, same: bool | None, root: Path
) -> None:
    write_result(root / "one", first)
    write_result(root / "two", second)
    verdicts = [Verdict.read(root, name) for name in ("one", "two")]
    assert compare(verdicts).same_recordings is same
    assert compare(verdicts[:1]).same_recordings is None


def test_the_table_says_all_and_nothing_in_it_is_markup(root: Path) -> None:
    write_result(root / "<b>one", {"noise.csv": "a"}, set=["creep", "dielectric_absorption"])
    write_result(root / "two", {"<i>.csv": "b"})
    (root / "two" / "report.html").write_text("", encoding="utf-8")
    table = compare([Verdict.read(root, name) for name in ("<b>one", "two")]).html()
    for text in (
        "The film &lt;keeps&gt; creeping.", "54 s", "50 to 59 s", "creep, dielectric absorption", "10.2 → 2.10 µm",
        "9.80 → 2.05 µm", "2.00 µm", 64 * "a", "Not from the same recordings", 'href="results/two/report.html"',
        "&lt;b&gt;one", "&lt;i&gt;.csv", "took 12.5 s",
    ):  # fmt: skip
        assert text in table, text
    assert "<b>" not in table and "<i>" not in table
    assert table.count("<svg") == 2 and "results/%3Cb%3Eone" not in table


# Who may ask


def ask(kind: str = "http", method: str = "GET", query: str = "", path: str = "/", **headers: str) -> tuple[int, str]:
    """Status and text of what a guard answers; 200 where it lets the request pass."""
    said: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message: Any) -> None:
        said.append(message)

    async def receive() -> Any:
        return {}

    sent = {"host": "127.0.0.1:8000", "cookie": "deatwin-8000=secret", **headers}
    scope = {
        "type": kind, "method": method, "path": path, "query_string": query.encode(),
        "headers": [(name.replace("_", "-").encode(), text.encode()) for name, text in sent.items() if text],
    }  # fmt: skip
    guard = Guard(app, port=8000, key="secret", most_bytes=1000)
    asyncio.run(guard(scope, receive, send))
    first = said[0]
    if first["type"] == "websocket.close":
        return first["code"], first["reason"]
    return first["status"], str(dict(first["headers"])) + str(said[1:])


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_browser_here_that_has_the_key_is_answered(kind: str, host: str) -> None:
    status, text = ask(kind, host=host, origin=f"http://{host}")
    assert status == 200 and "default-src 'self'" in text and "frame-ancestors 'none'" in text


@pytest.mark.parametrize("host", ["evil.example:8000", "127.0.0.1:8001", "127.0.0.1", "localhost.evil.org:8000", ""])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_another_host_is_refused_also_with_the_key(kind: str, host: str) -> None:
    assert ask(kind, host=host)[0] == (421 if kind == "http" else 1008)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:8001", "https://127.0.0.1:8000"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_another_origin_is_refused_also_with_the_key(kind: str, origin: str) -> None:
    assert ask(kind, origin=origin)[0] == (403 if kind == "http" else 1008)


@pytest.mark.parametrize("cookie", ["", "deatwin-8000=wrong", "deatwin-8001=secret", "deatwin-8000=", "\x01;;=\xfc"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_without_the_key_nothing_is_shown(kind: str, cookie: str) -> None:
    assert ask(kind, cookie=cookie)[0] == (403 if kind == "http" else 1008)


def test_the_key_in_the_address_becomes_a_cookie() -> None:
    status, text = ask(query="key=secret", cookie="")
    assert status == 303 and "deatwin-8000=secret; Path=/; HttpOnly; SameSite=Lax" in text
    assert ask(query="key=wrong", cookie="")[0] == 403
    assert ask("websocket", query="key=secret", cookie="")[0] == 1008


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"content_length": "900"}, 200),
        ({"content_length": "200000"}, 413),
        ({"content_length": "9" * 30}, 413),
        ({}, 411),
        ({"content_length": "-1"}, 411),
        ({"content_length": "10", "transfer_encoding": "chunked"}, 411),
    ],
)
def test_no_more_is_taken_than_the_limit(headers: dict[str, str], status: int) -> None:
    assert ask(method="POST", **headers)[0] == status


# The command


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["view", "gone"], "error: gone: there is no such folder\n"),
        (["view", "noise.csv"], "error: noise.csv: is a file; give the folder that it lies in\n"),
    ],
)
def test_what_is_no_folder_is_refused(
    arguments: list[str], message: str, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(root)
    assert main(arguments) == 1
    assert capsys.readouterr() == ("", message)


@pytest.mark.parametrize("package", ["nicegui", "uvicorn", "fastapi"])
def test_without_the_extra_it_says_what_to_install(
    package: str, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.endswith("live.page")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    assert main(["view", str(root), "--no-browser"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: the live view needs NiceGUI (") and 'pip install "deatwin[view]"' in error


@pytest.fixture
def server(root: Path) -> Iterator[tuple[Any, dict[str, Any]]]:
    """The command in a process of its own, and what it printed."""
    pytest.importorskip("nicegui", reason="the live view needs the extra `view`")
    code = "import sys; from deatwin.scenarios.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ["view", str(root), "--no-browser", "--json", "--upload-limit", "1"]
    process = subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True)
    try:
        text = ""
        while not text.endswith("}\n"):
            line = process.stdout.readline()  # type: ignore[union-attr]
            assert line, "it ended"
            text += line
        yield process, json.loads(text)
    finally:
        process.kill()
        process.communicate()


def test_the_server_answers_here_only_and_ends_with_ctrl_c(server: tuple[Any, dict[str, Any]], root: Path) -> None:
    process, printed = server
    port = int(re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?key=\S{32}", printed["address"])[1])  # type: ignore[index]
    (root / "report.html").write_text("<p>found</p>", encoding="utf-8")

    def get(path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> tuple[int, Any, str]:
        connection = HTTPConnection("127.0.0.1", port, timeout=30)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read().decode()

    assert get("/", Host="evil.example")[0] == 421
    assert get("/")[0] == 403
    status, headers, _ = get(printed["address"].partition(f":{port}")[2])
    assert status == 303
    cookie = {"Cookie": headers["Set-Cookie"].partition(";")[0]}
    status, headers, page = get("/", **cookie)
    assert status == 200 and "connect-src 'self'" in headers["Content-Security-Policy"]
    assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", page)
    assert get("/", Origin="http://evil.example", **cookie)[0] == 403
    declared = {"Content-Length": "2000000", **cookie}  # refused before any of it is sent
    assert get("/_nicegui/client/x/upload/1", "POST", None, **declared)[0] == 413
    status, headers, text = get("/results/report.html", **cookie)
    assert (status, text) == (200, "<p>found</p>") and headers["Content-Security-Policy"].startswith("sandbox ")
    assert get("/results/rig.toml", **cookie)[0] == 404
    assert get("/results/..%2Fsecret.csv", **cookie)[0] == 403
    with pytest.raises(ConnectionRefusedError):  # another address of this machine
        socket.create_connection(("127.0.0.2", port), timeout=5)
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 0


def test_a_port_that_is_taken_is_said(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("nicegui", reason="the live view needs the extra `view`")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["view", str(root), "--no-browser", "--port", str(port)]) == 1
    said = capsys.readouterr().err
    assert said == f"error: port {port}: taken by another program; give another, or 0 for any that is free\n"
