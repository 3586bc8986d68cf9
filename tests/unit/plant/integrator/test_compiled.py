"""Compiled code and the virtual machine."""

import logging
import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from deatwin.plant import Coupon, Planar, Plant, simulate
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.integrator import compiled, dense
from deatwin.plant.simulate import Simulator


@pytest.fixture
def compiler_named(monkeypatch):
    """``compiler_named(name)`` lets the library see that compiler alone."""

    def name(program):
        monkeypatch.setenv("DEATWIN_COMPILER", program)
        monkeypatch.delenv(compiled.SAID, raising=False)

    yield name
    monkeypatch.undo()


def square(name="square"):
    x = ca.MX.sym("x")
    return ca.Function(name, [x], [x**2])


@pytest.mark.usefixtures("c_compiler")
def test_the_compiled_plant_and_the_virtual_machine_agree(full, compiler_named):
    inputs = band_limited_noise(np.random.default_rng(5), 6.0, 0.02)
    settings = dict(start=0.0, sample_time=0.02, rest_command=0.0, values=full.free_values)
    fast = full.simulator
    compiler_named("")
    slow = Simulator(full.equations)
    np.testing.assert_allclose(
        fast.run(inputs, **settings).outputs, slow.run(inputs, **settings).outputs, rtol=0, atol=1e-9
    )
    both = [s.run_with_sensitivities(inputs, **settings).sensitivities for s in (fast, slow)]
    np.testing.assert_allclose(both[0], both[1], rtol=1e-6, atol=1e-9 * np.abs(both[0]).max())


def test_the_cache_is_the_users_own(tmp_path, monkeypatch):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path / "cache"))
    assert compiled.cache_folder() == tmp_path / "cache"
    assert stat.S_IMODE((tmp_path / "cache").stat().st_mode) == 0o700


@pytest.mark.usefixtures("c_compiler")
def test_code_is_compiled_once(tmp_path, monkeypatch):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    assert float(compiled.compile_functions({"square": square()})["square"](3.0)) == 9.0
    (library,) = tmp_path.iterdir()
    written = library.stat().st_mtime_ns
    compiled.compile_functions({"square": square()})
    assert [f.stat().st_mtime_ns for f in tmp_path.iterdir()] == [written]


@pytest.mark.usefixtures("c_compiler")
def test_what_follows_from_known_equations_is_not_written_again(oscillator, tmp_path, monkeypatch):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    base = Plant(rig=oscillator())
    commands = band_limited_noise(np.random.default_rng(6), 2.0, 0.02)
    settings = dict(start=0.0, sample_time=0.02, rest_command=0.0, values=base.free_values)
    first = Simulator(base.equations).run_with_sensitivities(commands, **settings)
    kept = {f.name: f.stat().st_mtime_ns for f in tmp_path.iterdir()}
    assert sorted(Path(name).suffix for name in kept) == [".so", ".txt"]
    with monkeypatch.context() as patch:
        patch.setattr(simulate, "step_functions", None)  # which nobody needs
        again = Simulator(base.equations).run_with_sensitivities(commands, **settings)
    assert {f.name: f.stat().st_mtime_ns for f in tmp_path.iterdir()} == kept
    np.testing.assert_array_equal(again.outputs, first.outputs)
    np.testing.assert_array_equal(again.sensitivities, first.sensitivities)
    # Other equations, other numbers and other code of ours have another key.
    equations = Plant(rig=Coupon()).equations
    origin, scale = (base.equations.dynamics, base.equations.output), base.equations.scale
    keys = [
        compiled.key_of(origin, scale),
        compiled.key_of((equations.dynamics, equations.output), scale),
        compiled.key_of(origin, 2 * scale),
    ]
    monkeypatch.setattr(compiled, "_own_code", lambda: "changed")
    keys.append(compiled.key_of(origin, scale))
    assert len(set(keys)) == 4


@pytest.mark.usefixtures("c_compiler")
def test_where_elimination_gives_up_the_sparse_method_solves(tmp_path, monkeypatch):
    """Against the code that eliminates; both leave 1e-12 of a state's size in the equations."""
    base = Plant(rig=Planar(sides="free", side_prestretch=2.0))
    commands = band_limited_noise(np.random.default_rng(6), 2.0, 0.02)
    settings = dict(start=0.0, sample_time=0.02, rest_command=0.0, values=base.free_values)
    expected = base.simulator.run_with_sensitivities(commands, **settings)
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    monkeypatch.setattr(dense, "GIVEN", 1e300)  # which no share exceeds
    sparse = Simulator(base.equations).run_with_sensitivities(commands, **settings)
    for one, other in ((sparse.outputs, expected.outputs), (sparse.sensitivities, expected.sensitivities)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(other).max())
    assert not np.array_equal(sparse.sensitivities, expected.sensitivities)  # another method rounds otherwise


def cut(folder):
    """Half of the only library."""
    (library,) = folder.glob("*.so")
    whole = library.read_bytes()
    library.unlink()  # the loader has this one open
    library.write_bytes(whole[: len(whole) // 2])
    return library


@pytest.mark.usefixtures("c_compiler")
def test_a_damaged_library_is_built_anew(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    for build in (
        lambda: compiled.compile_functions({"square": square()}, key="known"),
        lambda: compiled.recalled(["square"], "known"),
    ):
        compiled.compile_functions({"square": square()}, key="known")
        caplog.clear()
        library = cut(tmp_path)
        with caplog.at_level(logging.WARNING, logger="deatwin"):
            build()
        assert [r.getMessage() for r in caplog.records] == [f"{library} was damaged: it is removed and built anew"]
        assert float(compiled.compile_functions({"square": square()}, key="known")["square"](3.0)) == 9.0
        assert len(list(tmp_path.glob("*.so"))) == 1


@pytest.mark.usefixtures("c_compiler")
def test_threads_that_start_cold_build_one_library(tmp_path, monkeypatch):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    built, build = [], compiled._built
    monkeypatch.setattr(compiled, "_built", lambda *a: built.append(1) or build(*a))

    def nine(_):
        return float(compiled.compile_functions({"square": square()})["square"](3.0))

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(nine, range(8), timeout=60)) == [9.0] * 8
    assert len(built) == 1


@pytest.mark.usefixtures("c_compiler")
def test_processes_that_start_cold_or_on_a_damaged_library_finish(tmp_path, monkeypatch):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    code = (
        "import casadi as ca; from deatwin.plant.integrator.compiled import compile_functions; x = ca.MX.sym('x');"
        "print(float(compile_functions({'square': ca.Function('square', [x], [x**2])})['square'](3)))"
    )
    for _ in range(2):
        started = [subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1, text=True) for _ in range(2)]
        assert [one.communicate(timeout=60)[0] for one in started] == ["9.0\n"] * 2
        assert len(list(tmp_path.glob("*.so"))) == 1
        cut(tmp_path)


@pytest.mark.parametrize(("macros", "passes"), [("__GNUC__", True), ("__GNUC__ 4\n#define __clang__", False)])
def test_a_compiler_is_told_what_it_knows(macros, passes, tmp_path):
    # Clang takes an unknown option of code generation for an error.
    program = tmp_path / "cc"
    program.write_text(f"#!/bin/sh\ncat <<'EOF'\n#define {macros} 1\nEOF\n")
    program.chmod(0o755)
    common = {"-O2", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-freciprocal-math", "-march=native"}
    others = set(compiled._target(str(program)).flags) - common
    assert ("-fno-tree-pre" in others) == passes
    assert bool(others) == passes


@pytest.mark.parametrize("note", ["gone.so", "", "\0", "é" * 300])
def test_a_note_that_leads_nowhere_is_passed_over(note, tmp_path, monkeypatch):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    (tmp_path / "key.txt").write_text(note, encoding="utf-8")
    assert compiled.recalled(["march"], "key") is None
    assert compiled.recalled(["march"], "unknown") is None
    (tmp_path / "key.txt").write_text("broken.so", encoding="utf-8")
    (tmp_path / "broken.so").write_text("no library")
    assert compiled.recalled(["march"], "key") is None


@pytest.mark.parametrize("program", ["", "false"])
def test_without_a_working_compiler_the_virtual_machine_serves(program, compiler_named, tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    compiler_named(program)
    with caplog.at_level(logging.WARNING, logger="deatwin"):  # which a quiet command may have silenced before
        functions = compiled.compile_functions({"square": square()})
    assert float(functions["square"](3.0)) == 9.0
    assert "slower" in caplog.text
    assert list(tmp_path.iterdir()) == []


def test_workers_do_not_repeat_what_was_said(compiler_named, monkeypatch):
    compiler_named("")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    code = "from deatwin.plant.integrator.compiled import compile_functions as c; c({}); c({})"

    def said():
        return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stderr

    assert said().count("slower") == 1
    compiled.compile_functions({})
    assert said() == ""
