"""Files that would end the process that unpacks them: one clear error instead."""

import importlib
import io
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recordings
from deatwin.plant.files.formats import apart

UNPACKERS = """
import os, signal
def killed(content, path, *wanted): os.kill(os.getpid(), signal.SIGKILL)
def crashing(content, path, *wanted): os.abort()
def busy(content, path, *wanted):
    while True: pass
def refusing(content, path, *wanted): raise ValueError("no such file")
def counted(content, path, *wanted): return len(content), path, wanted
"""
CRASHES_SCIPY = Path(__file__).parent / "crashes_scipy.mat"
"""Of 1160 bytes, two arrays in a struct; found by tests/fuzz: the end of the process with SciPy 1.17's `loadmat`."""


@pytest.fixture
def unpackers(tmp_path, monkeypatch):
    """Functions that the other process can import."""
    (tmp_path / "unpackers_of_a_test.py").write_text(UNPACKERS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(apart, "_survived", set())
    return importlib.import_module("unpackers_of_a_test")


def test_what_a_sound_file_holds_is_returned(unpackers):
    assert apart.unpacked(unpackers.counted, b"abc", "of.mat", "u", "y") == (3, "of.mat", ("u", "y"))


def test_errors_of_python_are_raised_as_they_are(unpackers):
    with pytest.raises(ValueError, match=r"^no such file$"):
        apart.unpacked(unpackers.refusing, b"abc", "of.mat")


def test_a_crash_is_an_error_that_names_the_file(unpackers):
    with pytest.raises(DataError, match=r"^of\.mat: the library that unpacks it crashes; the file is damaged$"):
        apart.unpacked(unpackers.crashing, b"abc", "of.mat")


def test_a_library_that_does_not_come_back_is_an_error_that_names_the_file(unpackers, monkeypatch):
    monkeypatch.setattr(apart, "SECONDS", 1.0)
    with pytest.raises(DataError, match=r"^of\.mat: the library that unpacks it does not return; the file is"):
        apart.unpacked(unpackers.busy, b"abc", "of.mat")


def test_a_file_is_tried_once(unpackers, monkeypatch):
    tried = []
    monkeypatch.setattr(apart, "trial", lambda unpack, *rest: tried.append(rest) or apart.Outcome.THROUGH)
    for content in (b"abc", b"abc", b"abd"):
        apart.unpacked(unpackers.counted, content, "of.mat")
    assert tried == [(b"abc", "of.mat"), (b"abd", "of.mat")]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no such signals")
def test_what_the_system_ends_is_no_fault_of_the_file(unpackers):
    with pytest.raises(DataError, match=r"^of\.mat: the process that unpacked it was ended from outside"):
        apart.unpacked(unpackers.killed, b"abc", "of.mat")


def test_where_nothing_can_be_started_the_file_is_read_as_ever_and_tried_the_next_time(unpackers, monkeypatch):
    monkeypatch.setattr(apart.spawn, "get_executable", lambda: "no/such/python")
    assert apart.unpacked(unpackers.counted, b"abc", "of.mat")[0] == 3
    monkeypatch.undo()
    monkeypatch.setattr(apart, "_survived", set())
    unknown = type("Nowhere", (), {"__module__": "no_such_module", "__name__": "f", "__call__": lambda *_: 7})()
    assert apart.unpacked(unknown, b"abc", "of.mat") == 7
    assert not apart._survived


def test_a_program_of_one_file_does_not_begin_again(unpackers, monkeypatch):
    monkeypatch.setattr(apart.sys, "frozen", True, raising=False)
    monkeypatch.setattr(apart.subprocess, "run", None)
    assert apart.unpacked(unpackers.counted, b"abc", "of.mat")[0] == 3


def test_a_matlab_file_that_crashes_scipy_is_refused(tmp_path):
    path = shutil.copy(CRASHES_SCIPY, tmp_path / "taken.mat")
    with pytest.raises(DataError, match=r"taken\.mat: "):
        read_recordings(path)


def test_what_lies_in_the_working_folder_is_not_imported(tmp_path, monkeypatch):
    from scipy.io import savemat

    (tmp_path / "scipy.py").write_text("import os; os.abort()")
    stream = io.BytesIO()
    k = np.arange(12.0)
    savemat(stream, {"time_s": 0.02 * k, "command_V": k, "displacement_mm": k})
    (tmp_path / "taken.mat").write_bytes(stream.getvalue())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(apart, "_survived", set())
    (found,) = read_recordings("taken.mat")
    assert found.inputs.size == 12
