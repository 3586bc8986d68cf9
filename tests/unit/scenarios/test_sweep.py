"""Sweeps: nothing lost, nothing repeated, the same bytes wherever it runs; and a study of one's own."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib import parallel_config

from deatwin.plant import Experiment, Recording, thesis_plant
from deatwin.plant.errors import DataError
from deatwin.scenarios.sweep import CaseStore, Study, SweepSeal, grid, open_study, run_study, run_sweep
from deatwin.scenarios.sweep import store as storing
from deatwin.scenarios.sweep.casefile import decode, encode
from deatwin.scenarios.sweep.lock import alone

ROOT = Path(__file__).parents[3]
SEAL = SweepSeal(schema="deatwin/test-case/1", parts={"seed": 1})
NAMES = [f"case-{number:02d}" for number in range(24)]
posix = pytest.mark.skipif(os.name == "nt", reason="there are no such signals on Windows")


# --- work -----------------------------------------------------------------------------------------------------------


def note(folder: Path, name: str, store: CaseStore[Any]) -> None:
    """Append a line: which case is begun, in which process, and whether its result is there already."""
    file = os.open(folder / "begun.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.write(file, f"{name} {os.getpid()} {store.has(name)}\n".encode())
    os.close(file)


def numbers(name: str) -> dict[str, Any]:
    """What a case yields: it depends on its name alone."""
    rng = np.random.default_rng(int(name[-2:]))
    matrix = rng.standard_normal((30, 30))
    return {"status": "done", "solved": np.linalg.solve(matrix, rng.standard_normal(30)).tolist(), "odd": float("nan")}


def work(folder: Path, store: CaseStore[Any], name: str) -> dict[str, Any]:
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


def square(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    if case["value"] == 3:
        raise ValueError("three is\nnot allowed")
    return {"square": case["value"] ** 2, "drawn": rng.random(), "track": np.arange(4.0) * case["value"], "word": "w"}


def process(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"process": os.getpid()}


def lazy(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    time.sleep(0.2)
    return {"square": case["value"] ** 2}


def begun(folder: Path) -> Counter[str]:
    """How often each case was begun; none may have been begun once its result was there."""
    lines = [line.split() for line in (folder / "begun.log").read_text().splitlines()]
    assert [line for line in lines if line[2] != "False"] == []
    return Counter(line[0] for line in lines)


def run(folder: Path, jobs: int | None, **options: Any) -> CaseStore[SweepSeal]:
    store = CaseStore(folder, SEAL)
    run_sweep(partial(work, folder, store), {name: name for name in NAMES}, store, jobs=jobs, **options)
    return store


def files(store: CaseStore[Any]) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in store.cases.rglob("*.nc")}


@pytest.fixture(scope="module")
def alone_on_one_core(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files that one core writes without any trouble."""
    folder = tmp_path_factory.mktemp("one")
    store = run(folder, 1)
    assert begun(folder) == dict.fromkeys(NAMES, 1)
    assert sorted(os.listdir(folder)) == ["begun.log", "cases", "seal.json"]
    return files(store)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two dask workers, each a process of its own."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as made, distributed.Client(made) as client:  # fmt: skip
        yield client


# --- the same wherever it runs, nothing lost, nothing repeated --------------------------------------------------------


def test_a_case_file_holds_what_the_work_returned(alone_on_one_core: dict[str, bytes]) -> None:
    found = decode(alone_on_one_core["case-07.nc"])
    stamp = {"schema": "deatwin/test-case/1", "seal": SEAL.hash, "name": "case-07"}
    assert math.isnan(found.pop("odd"))
    expected = {**stamp, **numbers("case-07")}
    del expected["odd"]
    assert found == expected


@posix
def test_two_processes_of_which_one_is_killed_write_the_same_bytes(
    tmp_path: Path, alone_on_one_core: dict[str, bytes]
) -> None:
    (tmp_path / "trap-case-05").touch()
    told: list[tuple[float, str]] = []
    store = run(tmp_path, 2, tell=lambda share, text: told.append((share, text)))
    assert files(store) == alone_on_one_core
    often = begun(tmp_path)
    assert set(often) == set(NAMES) and often["case-05"] == 2
    assert often.total() <= len(NAMES) + 2  # the killed one, and what the other worker was at when loky ended it
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == pytest.approx(1.0)
    assert told[-1][1] == "case 24 of 24, about 1 s left"
    assert not (tmp_path / "running").exists()


@posix
def test_a_dask_cluster_of_which_a_worker_is_killed_writes_the_same_bytes(
    tmp_path: Path, alone_on_one_core: dict[str, bytes], cluster: Any
) -> None:
    (tmp_path / "trap-case-09").touch()
    with parallel_config(backend="dask"):
        store = run(tmp_path, None)
    assert files(store) == alone_on_one_core
    often = begun(tmp_path)
    assert often["case-09"] == 2 and often.total() == len(NAMES) + 1
    processes = {line.split()[1] for line in (tmp_path / "begun.log").read_text().splitlines()}
    assert len(processes) >= 2 and str(os.getpid()) not in processes


def test_a_plant_simulated_here_in_two_processes_and_on_a_cluster_reads_the_same(tmp_path: Path, cluster: Any) -> None:
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
import test_sweep
from deatwin.scenarios.sweep import grid, run_study
if sys.argv[3] == "sweep":
    test_sweep.run(Path(sys.argv[2]), 2)
else:
    run_study(grid(value=range(10, 60)), test_sweep.lazy, sys.argv[2], jobs=2)
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
def test_a_run_of_which_the_master_is_killed_is_gone_on_with(
    tmp_path: Path, alone_on_one_core: dict[str, bytes]
) -> None:
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
def test_control_c_leaves_usable_results_and_a_clear_line(tmp_path: Path) -> None:
    master = started(tmp_path, "study")
    master.send_signal(signal.SIGINT)
    said = master.communicate(timeout=30)[1].splitlines()[-1]
    assert master.returncode != 0
    line = re.fullmatch(r"KeyboardInterrupt: interrupted: (\d+) of 50 cases are through and stay in (\S+); .+", said)
    assert line and Path(line[2]) == tmp_path / "cases"
    study = open_study(tmp_path)
    assert len(study) == int(line[1]) >= 4
    table = study.to_xarray()
    np.testing.assert_array_equal(table["square"], table["value"] ** 2)


@posix
def test_a_case_that_always_ends_its_worker_is_given_up_and_no_other(tmp_path: Path) -> None:
    store = CaseStore(tmp_path, SEAL)
    with pytest.raises(DataError, match=r"died each of 2 times that it ran case-03 \(memory\?\)"):
        run_sweep(partial(deadly, "case-03"), {name: name for name in NAMES[:8]}, store, jobs=2)
    assert store.missing(NAMES[:8]) == ["case-03"]


def deadly(victim: str, name: str) -> dict[str, Any]:
    if name == victim:
        os.kill(os.getpid(), signal.SIGKILL)
    return {}


@pytest.fixture(autouse=True)
def few_deaths(monkeypatch: pytest.MonkeyPatch) -> None:
    from deatwin.scenarios.sweep import run as running

    monkeypatch.setattr(running, "MOST_DEATHS", 2)
    monkeypatch.setattr(running, "TOGETHER", 1)


def test_an_error_of_the_work_stops_a_sweep_and_keeps_what_is_through(tmp_path: Path) -> None:
    store = CaseStore(tmp_path, SEAL)
    with pytest.raises(ZeroDivisionError):
        run_sweep(failing, {name: name for name in NAMES[:4]}, store, jobs=1)
    assert store.missing(NAMES[:4]) == ["case-02", "case-03"]
    assert not (tmp_path / "running").exists()


def failing(name: str) -> dict[str, Any]:
    return {"share": 1 / (2 - int(name[-2:]))}


def test_the_users_backend_is_used(tmp_path: Path) -> None:
    with parallel_config(backend="threading", n_jobs=2):
        there = run_study(grid(value=[1, 2, 3]), process, tmp_path / "threads")
    assert {found["result"]["process"] for found in there} == {os.getpid()}
    with parallel_config(backend="loky", n_jobs=2):
        away = run_study(grid(value=[1, 2, 3]), process, tmp_path / "processes")
    assert os.getpid() not in {found["result"]["process"] for found in away}


def test_no_backend_is_forced_anywhere() -> None:
    """Whoever calls joblib leaves the backend to the user's configuration."""
    calls = {
        path: re.findall(r"Parallel\(([^\n]*)\)\(|parallel_(?:backend|config)\(", path.read_text(encoding="utf-8"))
        for root in ("plant", "ident", "control", "scenarios") for path in (ROOT / root).rglob("*.py")
    }  # fmt: skip
    made = [call for found in calls.values() for call in found]
    assert len(made) >= 2  # the runner of jobs and that of sweeps
    assert [call for call in made if not call or re.search("backend|prefer|require", call)] == []


# --- the store ------------------------------------------------------------------------------------------------------


def test_a_folder_begun_under_another_seal_is_refused_and_told_what_differs(tmp_path: Path) -> None:
    first = SweepSeal(schema="deatwin/test-case/1", parts={"seed": 1, "code": "a" * 64, "versions": {"numpy": "2.0"}})
    CaseStore(tmp_path, first).put("one", {"x": 1})
    other = SweepSeal(schema=first.schema, parts={"seed": 2, "code": "b" * 64, "versions": {"numpy": "2.0"}})
    with pytest.raises(DataError, match=r"another seal \(seed: 1 there, 2 now; code: a{12} there, b{12} now\)"):
        CaseStore(tmp_path, other)
    assert CaseStore(tmp_path, first).get("one")["x"] == 1


def test_a_result_is_not_written_into_a_folder_sealed_anew_nor_over_one_that_is_there(tmp_path: Path) -> None:
    store = CaseStore(tmp_path, SEAL)
    store.put("one", {"x": 1})
    store.put("one", {"x": 2})
    assert store.get("one")["x"] == 1
    (tmp_path / "seal.json").write_text(json.dumps(SweepSeal(schema="s", parts={}).to_dict()))
    with pytest.raises(DataError, match="sealed anew"):
        store.put("two", {"x": 1})


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda whole: b"", r"one\.nc: no file of a case; .*delete it, and the case is run again"),
        (lambda whole: b'{"x": 1}', "one.nc: no file of a case; .*delete it"),
        (lambda whole: whole[:-1], "one.nc: damaged or altered; .*delete it"),
        (lambda whole: whole[: len(whole) // 2], "one.nc: damaged or altered; .*delete it"),
        (lambda whole: whole + b"\0", "one.nc: damaged or altered"),
        (lambda whole: whole[:-1] + b"\x07", "one.nc: damaged or altered"),
        (lambda whole: whole.replace(b'"x": 1', b'"x": 2'), "one.nc: damaged or altered"),
        (lambda whole: encode({**decode(whole), "seal": "0" * 64}), "one.nc: .* another seal"),
        (lambda whole: encode({**decode(whole), "name": "two"}), "one.nc: .* another seal"),
    ],
)
def test_a_spoilt_case_is_one_clear_error(tmp_path: Path, spoil: Callable[[bytes], bytes], words: str) -> None:
    store = CaseStore(tmp_path, SEAL)
    store.put("one", {"x": 1})
    store.path("one").write_bytes(spoil(store.path("one").read_bytes()))
    with pytest.raises(DataError, match=words):
        store.get("one")


def test_cases_of_a_former_version_are_refused_and_stay(tmp_path: Path) -> None:
    store = CaseStore(tmp_path, SEAL)
    former = tmp_path / "cases" / "case-00.json"
    former.write_text("{}")
    with pytest.raises(DataError, match="holds cases as JSON files, as former versions wrote them"):
        run_sweep(numbers, {"case-00": "case-00"}, store)
    assert former.exists() and not store.has("case-00")
    (tmp_path / "seal.json").unlink()
    with pytest.raises(DataError, match="holds cases as JSON files"):
        CaseStore(tmp_path, SEAL)


def test_cases_without_a_seal_and_an_altered_seal_are_refused(tmp_path: Path) -> None:
    CaseStore(tmp_path, SEAL).put("one", {})
    path = tmp_path / "seal.json"
    text = path.read_text()
    path.write_text(text.replace('"seed": 1', '"seed": 3'))
    with pytest.raises(DataError, match="the seal was altered"):
        CaseStore(tmp_path, SEAL)
    path.unlink()
    with pytest.raises(DataError, match="holds cases but no seal"):
        CaseStore(tmp_path, SEAL)


def test_many_cases_are_spread_and_few_are_not(tmp_path: Path) -> None:
    few = CaseStore(tmp_path / "few", SEAL, expected=storing.SIDE_BY_SIDE)
    many = CaseStore(tmp_path / "many", SEAL, expected=storing.SIDE_BY_SIDE + 1)
    for store in (few, many):
        for name in NAMES:
            store.put(name, {})
    assert {path.parent for path in few.cases.rglob("*.nc")} == {few.cases}
    folders = {path.parent for path in many.cases.rglob("*.nc")}
    assert len(folders) > 10 and {folder.parent for folder in folders} == {many.cases}
    # Both stay as they were begun, however many are asked for later.
    for folder, expected in ((few.folder, 10**6), (many.folder, 0)):
        again = CaseStore(folder, SEAL, expected=expected)
        assert again.names() == set(NAMES) and again.missing([*NAMES, "new"]) == ["new"]
        assert again.get("case-03")["name"] == "case-03"


@pytest.mark.parametrize("name", ["../out", "a/b", "", ".hidden", "a" * 201, "nul\0"])
def test_a_name_that_is_no_file_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="a case cannot be called"):
        CaseStore(tmp_path, SEAL).put(name, {})


def test_a_second_run_at_the_same_time_is_refused(tmp_path: Path) -> None:
    store = CaseStore(tmp_path, SEAL)
    with alone(tmp_path / "running"), pytest.raises(DataError, match="another process is running these cases"):
        run_sweep(numbers, {"case-00": "case-00"}, store)
    run_sweep(numbers, {"case-00": "case-00"}, store)
    assert store.has("case-00")


# --- a study of one's own -------------------------------------------------------------------------------------------


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return run_study(grid(value=[2, 3, 5], kind=["a", None]), square, tmp_path / "study", seed=4)


def test_the_results_are_one_table(study: Study, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    table = study.to_xarray()
    assert table.sizes == {"case": 6, "track_0": 4}
    np.testing.assert_array_equal(table["value"], [2, 2, 3, 3, 5, 5])
    assert list(table["kind"].values) == ["a", "", "a", "", "a", ""]
    np.testing.assert_array_equal(table["square"], [4, 4, np.nan, np.nan, 25, 25])
    np.testing.assert_array_equal(table["track"][4], [0, 5, 10, 15])
    assert np.isnan(table["track"][2]).all()
    assert list(table["error"].values) == ["", "", *["ValueError: three is not allowed"] * 2, "", ""]
    assert len(np.unique(table["drawn"].dropna("case"))) == 4
    assert json.loads(table.attrs["sealed"])["seed"] == 4
    study.to_netcdf(tmp_path / "all.nc")
    with xarray.open_dataset(tmp_path / "all.nc") as read:
        xarray.testing.assert_equal(read, table)
    assert os.listdir(tmp_path) == ["study", "all.nc"] or sorted(os.listdir(tmp_path)) == ["all.nc", "study"]


def test_what_a_case_draws_depends_on_seed_and_case_alone(study: Study, tmp_path: Path) -> None:
    def drawn(cases: list[dict[str, Any]], seed: int) -> dict[int, float]:
        found = run_study(cases, square, tmp_path / f"{len(cases)}-{seed}", seed=seed)
        return {each["case"]["value"]: each["result"]["drawn"] for each in found}

    few, more, other = drawn(grid(value=[7, 2]), 0), drawn(grid(value=[2, 9, 7]), 0), drawn(grid(value=[7, 2]), 1)
    assert few == {value: more[value] for value in few}
    assert set(few.values()).isdisjoint(other.values())


def test_a_study_is_extended_and_its_failures_run_again(study: Study) -> None:
    before = files(study.store)
    cases = grid(value=[2, 3, 5, 6], kind=["a", None])
    more = run_study(cases, square, study.store.folder, seed=4)
    assert len(more) == 8 and len(more.failures) == 2
    assert {name: text for name, text in files(more.store).items() if name in before} == before
    more.discard_failures()
    assert len(open_study(study.store.folder)) == 6
    assert len(run_study(cases, square, study.store.folder, seed=4).failures) == 2


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"seed": 5}, "seed: 4 there, 5 now"),
        ({"settings": {"noise": 2.0}}, r'settings: {} there, {"noise": 2.0} now'),
        ({"work": lazy}, 'work: "square" there, "lazy" now'),
    ],
)
def test_a_study_is_not_mixed_with_another(study: Study, changed: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"work": square, "seed": 4, **changed}
    with pytest.raises(DataError, match=words):
        run_study(grid(value=[2]), folder=study.store.folder, **given)


@pytest.mark.parametrize("changed", ["versions", "sources_digest", "digest"])
def test_a_study_is_not_mixed_with_one_of_another_version_or_code(
    study: Study, changed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deatwin.scenarios import provenance
    from deatwin.scenarios.sweep import study as own

    told = {"versions": "versions: .*0.0.1.* now", "sources_digest": "deatwin_sources", "digest": "work_source"}
    if changed == "versions":
        monkeypatch.setattr(provenance, "versions", lambda packages: {"deatwin": "0.0.1"})
    else:
        monkeypatch.setattr(own, changed, lambda *_: "f" * 64)
    with pytest.raises(DataError, match=f"another seal \\({told[changed]}"):
        run_study([], square, study.store.folder, seed=4)


@pytest.mark.parametrize("unfit", [lambda case, rng: {}, partial(square), Study])
def test_work_that_could_hold_unseen_values_is_refused(tmp_path: Path, unfit: Any) -> None:
    with pytest.raises(DataError, match="must be a function of a module"):
        run_study([], unfit, tmp_path)


@pytest.mark.parametrize(
    ("cases", "words"),
    [
        ([{"value": 1}, {"value": 1}], "case 1 is there twice"),
        ([{"value": float("nan")}], "case 0: value is nan"),
        ([{"value": [1]}], r"case 0: value is \[1\]; it must be a finite number"),
    ],
)
def test_cases_that_cannot_be_told_apart_or_written_are_refused(tmp_path: Path, cases: Any, words: str) -> None:
    with pytest.raises(DataError, match=words):
        run_study(cases, square, tmp_path)


def uneven(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"track": np.zeros(case["value"]), "mixed": "text" if case["value"] == 1 else 2.0}


def odd(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"spectrum": np.array([1j])}


def test_results_that_make_no_table_are_clear_errors(tmp_path: Path) -> None:
    study = run_study(grid(value=[1, 2]), uneven, tmp_path / "uneven")
    with pytest.raises(DataError, match=r"track has arrays of several shapes, \(1,\) and \(2,\)"):
        study.to_xarray()
    failed = run_study(grid(value=[1]), odd, tmp_path / "odd").failures
    assert list(failed.values()) == ["DataError: the result spectrum is a ndarray; it must be a real number, an array, "
                                     "or a text"]  # fmt: skip
    with pytest.raises(DataError, match="a study is sealed before its first case"):
        open_study(tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_the_example_of_the_documents_runs(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "how-to" / "run-a-study.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python title=\"stiffness_study.py\"\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(code.splitlines()) <= 30
    (tmp_path / "stiffness_study.py").write_text(code)
    done = subprocess.run(
        [sys.executable, "stiffness_study.py"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == re.findall(r"^```text\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[0]
    assert (tmp_path / "stiffness.nc").exists()
