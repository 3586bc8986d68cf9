"""Runs of a sweep: nothing lost, nothing repeated, the same bytes wherever they run."""

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib import parallel_config

from deatwin.plant import Experiment, Recording, thesis_plant
from deatwin.plant.errors import DataError
from deatwin.studies.sweep import grid, open_study, run_study
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal
from deatwin.studies.sweep.store import CaseStore, decode, exclusive_lock

ROOT = Path(__file__).parents[3]
SEAL = SweepSeal(schema="deatwin/test-case/1", parts={"seed": 1})
NAMES = [f"case-{number:02d}" for number in range(24)]
posix = pytest.mark.skipif(os.name == "nt", reason="there are no such signals on Windows")


# --- work -----------------------------------------------------------------------------------------------------------


def note(folder: Path, name: str, store: CaseStore) -> None:
    """Append a line: which case is begun, in which process, and whether its result is there already."""
    file = os.open(folder / "begun.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.write(file, f"{name} {os.getpid()} {store.has(name)}\n".encode())
    os.close(file)


def numbers(name: str) -> dict[str, Any]:
    """What a case yields: it depends on its name alone."""
    rng = np.random.default_rng(int(name[-2:]))
    matrix = rng.standard_normal((30, 30))
    return {"status": "done", "solved": np.linalg.solve(matrix, rng.standard_normal(30)).tolist(), "odd": float("nan")}


def work(folder: Path, store: CaseStore, name: str) -> dict[str, Any]:
    """Note the beginning, and end the worker if a trap is laid for this case; a trap works once."""
    note(folder, name, store)
    time.sleep(0.01)
    try:
        (folder / f"trap-{name}").unlink()
    except FileNotFoundError:
        return numbers(name)
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("a killed process goes on")


def simulate(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    plant = thesis_plant()
    command = rng.uniform(0.5, 3.0, 6).repeat(25) * case["share"]
    silent = Recording.from_arrays(command, np.zeros(command.size), plant.rig.sample_time)
    made = plant.record(Experiment(recordings=(silent,)), rng).recordings[0]
    return {"reading": made.outputs[0], "largest": made.outputs.max()}


def process(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"process": os.getpid()}


def begun(folder: Path) -> Counter[str]:
    """How often each case was begun; none may have been begun once its result was there."""
    lines = [line.split() for line in (folder / "begun.log").read_text().splitlines()]
    assert [line for line in lines if line[2] != "False"] == []
    return Counter(line[0] for line in lines)


def run(folder: Path, jobs: int | None, **options: Any) -> CaseStore:
    store = CaseStore(folder, SEAL)
    run_sweep(partial(work, folder, store), {name: name for name in NAMES}, store, jobs=jobs, **options)
    return store


@pytest.fixture(scope="module")
def alone_on_one_core(files, tmp_path_factory):
    """The files that one core writes without any trouble."""
    folder = tmp_path_factory.mktemp("one")
    store = run(folder, 1)
    assert begun(folder) == dict.fromkeys(NAMES, 1)
    assert sorted(os.listdir(folder)) == ["begun.log", "cases", "seal.json"]
    return files(store)


@pytest.fixture(scope="module")
def cluster():
    """Two dask workers, each a process of its own."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as made,
        distributed.Client(made) as client,
    ):
        yield client


# --- the same wherever it runs, nothing lost, nothing repeated --------------------------------------------------------


def test_a_case_file_holds_what_the_work_returned(alone_on_one_core):
    found = decode(alone_on_one_core["case-07.nc"])
    stamp = {"schema": "deatwin/test-case/1", "seal": SEAL.hash, "name": "case-07"}
    assert math.isnan(found.pop("odd"))
    expected = {**stamp, **numbers("case-07")}
    del expected["odd"]
    assert found == expected


@posix
def test_two_processes_of_which_one_is_killed_write_the_same_bytes(tmp_path, alone_on_one_core, files):
    (tmp_path / "trap-case-05").touch()
    told: list[tuple[float, str]] = []
    store = run(tmp_path, 2, tell=lambda share, text: told.append((share, text)))
    assert files(store) == alone_on_one_core
    often = begun(tmp_path)
    assert set(often) == set(NAMES) and often["case-05"] == 2
    assert often.total() <= len(NAMES) + 2  # the killed one, and what the other worker was at when loky ended it
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == pytest.approx(1.0)
    assert told[-1][1] == "case 24 of 24"
    assert not (tmp_path / "running").exists()


@posix
def test_a_dask_cluster_of_which_a_worker_is_killed_writes_the_same_bytes(tmp_path, alone_on_one_core, cluster, files):
    (tmp_path / "trap-case-09").touch()
    with parallel_config(backend="dask"):
        store = run(tmp_path, None)
    assert files(store) == alone_on_one_core
    often = begun(tmp_path)
    assert often["case-09"] == 2 and often.total() == len(NAMES) + 1
    processes = {line.split()[1] for line in (tmp_path / "begun.log").read_text().splitlines()}
    assert len(processes) >= 2 and str(os.getpid()) not in processes


def test_a_plant_simulated_here_in_two_processes_and_on_a_cluster_reads_the_same(files, tmp_path, cluster):
    cases = grid(share=[0.5, 0.8, 1.0])
    found = [run_study(cases, simulate, tmp_path / "1", jobs=1), run_study(cases, simulate, tmp_path / "2", jobs=2)]
    with parallel_config(backend="dask"):
        found.append(run_study(cases, simulate, tmp_path / "3"))
    assert all(study.failures == {} for study in found)
    assert files(found[0].store) == files(found[1].store) == files(found[2].store)
    assert found[0].to_xarray()["reading"].shape == (3, 150)


SCRIPT = """
import signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background jobs ignore
sys.path.insert(0, sys.argv[1])
import test_sweep_runs, test_sweep_studies
from deatwin.studies.sweep import grid, run_study
if sys.argv[3] == "sweep":
    test_sweep_runs.run(Path(sys.argv[2]), 2)
else:
    run_study(grid(value=range(10, 60)), test_sweep_studies.lazy, sys.argv[2], jobs=2)
"""


def started(folder: Path, what: str) -> subprocess.Popen[str]:
    """A run in a process of its own, of which some cases are through."""
    arguments = [sys.executable, "-c", SCRIPT, str(Path(__file__).parent), str(folder), what]
    master = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, start_new_session=True)
    until = time.monotonic() + 60
    while len(list((folder / "cases").glob("*.nc"))) < 4:
        assert master.poll() is None and time.monotonic() < until, master.communicate()
        time.sleep(0.02)
    return master


def is_running(process: int) -> bool:
    """Whether a process lives; one that has ended and that nobody has asked for its status does not."""
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"


@pytest.mark.skipif(not Path("/proc").exists(), reason="how processes end is read from /proc")
def test_a_run_of_which_the_master_is_killed_is_gone_on_with(tmp_path, alone_on_one_core, files):
    master = started(tmp_path, "sweep")
    master.kill()
    master.communicate()
    through = files(CaseStore(tmp_path, SEAL))
    assert 4 <= len(through) < len(NAMES)
    orphans = {int(line.split()[1]) for line in (tmp_path / "begun.log").read_text().splitlines()}
    (tmp_path / "cases" / ".case-23.nc.0a1b2c3d").write_text("half")
    store = run(tmp_path, 1)
    assert files(store) == alone_on_one_core
    often = begun(tmp_path)
    assert set(often) == set(NAMES) and often.total() <= len(NAMES) + 2
    assert not any(map(is_running, orphans))
    assert list((tmp_path / "cases").glob(".*")) == []


@posix
def test_control_c_leaves_usable_results_and_a_clear_line(tmp_path):
    master = started(tmp_path, "study")
    master.send_signal(signal.SIGINT)
    said = master.communicate(timeout=30)[1].splitlines()[-1]
    assert master.returncode != 0
    line = re.fullmatch(r"KeyboardInterrupt: interrupted: (\d+) of 50 cases are finished and stay in (\S+); .+", said)
    assert line and Path(line[2]) == tmp_path / "cases"
    study = open_study(tmp_path)
    assert len(study) == int(line[1]) >= 4
    table = study.to_xarray()
    np.testing.assert_array_equal(table["square"], table["value"] ** 2)


@posix
def test_what_a_fit_kept_when_it_was_interrupted_is_no_result(tmp_path, heard):
    store = CaseStore(tmp_path, SEAL)
    with pytest.raises(KeyboardInterrupt, match="interrupted: 0 of 1 cases"):
        run_sweep(best_so_far, {"case-00": "case-00"}, store, jobs=1)
    assert store.missing(["case-00"]) == ["case-00"]


def best_so_far(name: str) -> dict[str, Any]:
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    return numbers(name)


@posix
def test_a_case_of_which_the_worker_is_terminated_is_run_again(tmp_path):
    (tmp_path / "trap").touch()
    store = CaseStore(tmp_path, SEAL)
    run_sweep(partial(terminated_once, tmp_path), {name: name for name in NAMES[:4]}, store, jobs=2)
    assert store.missing(NAMES[:4]) == []


def terminated_once(folder: Path, name: str) -> dict[str, Any]:
    try:
        (folder / "trap").unlink()
    except FileNotFoundError:
        return numbers(name)
    os.kill(os.getpid(), signal.SIGTERM)
    raise AssertionError("a terminated process goes on")


@posix
def test_a_case_that_always_ends_its_worker_is_given_up_and_no_other(tmp_path):
    store = CaseStore(tmp_path, SEAL)
    with pytest.raises(DataError, match=r"died each of 2 times that it ran case-03 \(memory\?\)"):
        run_sweep(partial(deadly, "case-03"), {name: name for name in NAMES[:8]}, store, jobs=2)
    assert store.missing(NAMES[:8]) == ["case-03"]


def deadly(victim: str, name: str) -> dict[str, Any]:
    if name == victim:
        os.kill(os.getpid(), signal.SIGKILL)
    return {}


@pytest.fixture(autouse=True)
def few_deaths(monkeypatch):
    from deatwin.studies.sweep import run as running

    monkeypatch.setattr(running, "MOST_DEATHS", 2)
    monkeypatch.setattr(running, "TOGETHER", 1)


def test_an_error_of_the_work_stops_a_sweep_and_keeps_what_is_through(tmp_path):
    store = CaseStore(tmp_path, SEAL)
    with pytest.raises(ZeroDivisionError):
        run_sweep(failing, {name: name for name in NAMES[:4]}, store, jobs=1)
    assert store.missing(NAMES[:4]) == ["case-02", "case-03"]
    assert not (tmp_path / "running").exists()


def failing(name: str) -> dict[str, Any]:
    return {"share": 1 / (2 - int(name[-2:]))}


def test_the_users_backend_is_used(tmp_path):
    """Threads here; processes of a cluster above."""
    with parallel_config(backend="threading", n_jobs=2):
        there = run_study(grid(value=[1, 2, 3]), process, tmp_path / "threads")
    assert {found["result"]["process"] for found in there} == {os.getpid()}


def test_no_backend_is_forced_anywhere():
    """Whoever calls joblib leaves the backend to the user's configuration."""
    calls = {
        path: re.findall(r"Parallel\(([^\n]*)\)\(|parallel_(?:backend|config)\(", path.read_text(encoding="utf-8"))
        for root in ("plant", "ident", "control", "scenarios")
        for path in (ROOT / root).rglob("*.py")
    }
    made = [call for found in calls.values() for call in found]
    assert len(made) >= 2  # the runner of jobs and that of sweeps
    assert [call for call in made if not call or re.search("backend|prefer|require", call)] == []


def test_a_second_run_at_the_same_time_is_refused(tmp_path):
    store = CaseStore(tmp_path, SEAL)
    with exclusive_lock(tmp_path / "running"), pytest.raises(DataError, match="another process is running these cases"):
        run_sweep(numbers, {"case-00": "case-00"}, store)
    run_sweep(numbers, {"case-00": "case-00"}, store)
    assert store.has("case-00")


ORPHAN = """
import os, time
from types import SimpleNamespace
from deatwin.studies.sweep import run
run.parent_process = lambda: SimpleNamespace(pid=os.getppid() + 1)  # the one that started this worker is gone
run._end_with_master()
time.sleep(30)
"""


@posix
def test_a_worker_that_starts_after_its_master_was_killed_ends():
    assert subprocess.run([sys.executable, "-c", ORPHAN], timeout=60, check=False).returncode == 1
