"""The runner gives the same results however the jobs are spread."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from deatwin.ident.mismatch import diagnose, plan_experiment
from deatwin.ident.parallel import jobs_as_they_end, run_jobs, spawn_generators, stream_jobs
from deatwin.plant import Creep, Diaphragm, ModelError, Plant, Recording, RigError


def draw(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.standard_normal(count)


def threads_and_process(_: int) -> tuple[int, int]:
    np.ones((8, 8)) @ np.ones((8, 8))
    return max((pool["num_threads"] for pool in threadpool_info()), default=1), os.getpid()


def fail(number: int) -> int:
    if number == 2:
        raise ValueError("job 2 failed")
    return number


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order_and_do_not_depend_on_the_workers(workers):
    jobs = [(rng, 4) for rng in spawn_generators(7, 5)]
    found = run_jobs(draw, jobs, workers=workers)
    alone = [draw(rng, 4) for rng in spawn_generators(7, 5)]
    for one, other in zip(found, alone, strict=True):
        np.testing.assert_array_equal(one, other)


def test_generators_are_independent_and_repeatable():
    first, again = spawn_generators(3, 4), spawn_generators(3, 4)
    numbers = [rng.random() for rng in first]
    assert numbers == [rng.random() for rng in again]
    assert len(set(numbers)) == 4


def test_each_worker_has_one_blas_thread():
    found = run_jobs(threads_and_process, [(k,) for k in range(4)], workers=2)
    assert all(threads == 1 for threads, _ in found)
    assert all(process != os.getpid() for _, process in found)


def test_progress_counts_every_job():
    counts: list[int] = []
    run_jobs(abs, [(-1,), (-2,), (-3,)], finished=counts.append)
    assert counts == [1, 2, 3]


def nap(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_a_job_counts_as_soon_as_it_has_ended():
    naps = [(0.5,), (0.0,), (0.0,)]
    assert [number for number, _ in jobs_as_they_end(nap, naps, workers=2)][-1] == 0
    assert list(stream_jobs(nap, naps, workers=2)) == [0.5, 0.0, 0.0]


def test_a_failing_job_is_an_error():
    with pytest.raises(ValueError, match="job 2 failed"):
        run_jobs(fail, [(k,) for k in range(4)], workers=1)


KILLED = """
import sys
sys.path.insert(0, sys.argv[1])
from marking import mark
from deatwin.ident.parallel import run_jobs
run_jobs(mark, [(sys.argv[1], k) for k in range(100)], workers=2)
"""
MARKING = """
import pathlib, time
def mark(folder, number):
    time.sleep(0.2)
    (pathlib.Path(folder) / f"{number}.done").touch()
"""


@pytest.mark.skipif(os.name == "nt", reason="a process of Windows keeps the number of a parent that is gone")
def test_jobs_that_wait_are_not_run_once_their_master_is_killed(tmp_path):
    (tmp_path / "marking.py").write_text(MARKING)
    master = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)])
    try:
        until = time.monotonic() + 60
        while not any(tmp_path.glob("*.done")) and time.monotonic() < until:
            time.sleep(0.05)
    finally:
        master.kill()
        master.wait()
    done = len(list(tmp_path.glob("*.done")))
    assert done > 0
    time.sleep(1.5)
    assert len(list(tmp_path.glob("*.done"))) <= done + 2  # those that were being run; two more wait at each worker


INTERRUPTED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a run in the background may have it ignored
from deatwin.ident.parallel import run_jobs
from deatwin.studies.interrupts import forward_signals
sys.path.insert(0, sys.argv[1])
import slow_to_import
os.mkdir(os.path.join(sys.argv[1], "starting"))
with forward_signals():
    run_jobs(slow_to_import.job, [(k,) for k in range(40)], workers=2)
"""
SLOW = """
import os, time
if os.path.exists(os.path.join(os.path.dirname(__file__), "starting")):
    time.sleep(20)
def job(number):
    return number
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no process groups that a signal reaches")
@pytest.mark.parametrize("after", [0.1, 2.0])
def test_an_interrupt_ends_workers_that_are_still_starting_without_a_word_of_theirs(tmp_path, after):
    (tmp_path / "slow_to_import.py").write_text(SLOW)
    command = [sys.executable, "-c", INTERRUPTED, str(tmp_path)]
    master = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    until = time.monotonic() + 60
    while not (tmp_path / "starting").exists() and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(after)
    os.killpg(master.pid, signal.SIGINT)
    began = time.monotonic()
    said = master.communicate(timeout=60)[1]
    assert time.monotonic() - began < 5.0  # the workers alone would take 20 s; a loaded machine takes its time
    chained = said.count("another exception occurred")  # where it came while the program handled one of its own
    assert said.count("Traceback") == 1 + chained
    assert said.rstrip().endswith("KeyboardInterrupt")


@pytest.mark.parametrize("workers", [0, -2, 1.5, None, "a", True])
def test_a_number_of_workers_that_there_cannot_be_is_refused(workers):
    with pytest.raises(ModelError, match=f"^{workers!r} worker processes: .* -1 for all cores"):
        run_jobs(int, [("1",)], workers=workers)


@pytest.mark.parametrize("seed", [-1, 1.5, None, "a", True, np.random.default_rng(0)])
def test_a_seed_is_an_integer_of_at_least_zero(seed):
    with pytest.raises(ModelError, match=r"seed = .*; it must be an integer of at least 0"):
        spawn_generators(seed, 2)


@pytest.mark.parametrize("started", [diagnose, plan_experiment])
@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"seed": None}, ModelError, "seed = None"),
        ({"seed": 1.5}, ModelError, "seed = 1.5"),
        ({"jobs": "a"}, ModelError, "'a' worker processes"),
        ({"jobs": 1.5}, ModelError, "1.5 worker processes"),
        ({"effects": "creep"}, RigError, "give a tuple of effects"),
        ({"effects": Creep()}, RigError, "give a tuple of effects"),
        ({"effects": ["creep"]}, RigError, "'creep' is not an effect: .*effect_named"),
        ({"effects": [Creep]}, RigError, "Creep is not an effect"),
    ],
)
def test_arguments_are_checked_before_the_work(started, wrong, error, message):
    recording = Recording.from_arrays(np.linspace(1.0, 2.0, 500), np.zeros(500), 0.02)
    with pytest.raises(error, match=message):
        started(Plant(rig=Diaphragm()), recording, **wrong, progress=lambda share, text: pytest.fail("it began"))


class Begun(Exception):
    """Raised by the first report of progress."""


@pytest.mark.parametrize("started", [diagnose, plan_experiment])
def test_the_likelihood_takes_one_thread(started):
    """Where cores are busy, the threads of a tall and narrow product wait for each other sixty times longer."""
    recording, seen = Recording.from_arrays(np.linspace(1.0, 2.0, 500), np.zeros(500), 0.02), []

    def progress(share, text):
        seen.append(threads_and_process(0)[0])
        raise Begun

    with pytest.raises(Begun):
        started(Plant(rig=Diaphragm()), recording, progress=progress)
    assert seen == [1]
