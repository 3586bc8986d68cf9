"""A study of one's own: its table, what it may be mixed with, what it refuses, and the example of the documents."""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deatwin.plant.errors import DataError, ModelError
from deatwin.studies.sweep import Study, grid, open_study, run_study

ROOT = Path(__file__).parents[3]


def square(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    if case["value"] == 3:
        raise ValueError("three is\nnot allowed")
    return {"square": case["value"] ** 2, "drawn": rng.random(), "track": np.arange(4.0) * case["value"], "word": "w"}


def lazy(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """So slow that it can be interrupted, which test_sweep_runs.py does."""
    time.sleep(0.2)
    return {"square": case["value"] ** 2}


@pytest.fixture
def study(tmp_path):
    return run_study(grid(value=[2, 3, 5], kind=["a", None]), square, tmp_path / "study", seed=4)


def test_the_results_are_one_table(study, tmp_path):
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


def test_an_interrupt_that_became_an_error_is_no_result(mistaken, monkeypatch, tmp_path):
    monkeypatch.setattr(np, "arange", mistaken)  # which `square` takes
    with pytest.raises(KeyboardInterrupt, match="0 of 1 cases are finished"):
        run_study(grid(value=[2]), square, tmp_path / "study", jobs=1)


def test_what_a_case_draws_depends_on_seed_and_case_alone(study, tmp_path):
    def drawn(cases: list[dict[str, Any]], seed: int) -> dict[int, float]:
        found = run_study(cases, square, tmp_path / f"{len(cases)}-{seed}", seed=seed)
        return {each["case"]["value"]: each["result"]["drawn"] for each in found}

    few, more, other = drawn(grid(value=[7, 2]), 0), drawn(grid(value=[2, 9, 7]), 0), drawn(grid(value=[7, 2]), 1)
    assert few == {value: more[value] for value in few}
    assert set(few.values()).isdisjoint(other.values())


def test_a_study_is_extended_and_its_failures_run_again(study, files):
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
def test_a_study_is_not_mixed_with_another(study, changed, words):
    given: dict[str, Any] = {"work": square, "seed": 4, **changed}
    with pytest.raises(DataError, match=words):
        run_study(grid(value=[2]), folder=study.store.folder, **given)


@pytest.mark.parametrize("changed", ["versions", "sources_digest", "digest"])
def test_a_study_is_not_mixed_with_one_of_another_version_or_code(study, changed, monkeypatch):
    from deatwin.studies import provenance
    from deatwin.studies.sweep import study as own

    told = {"versions": "versions: .*0.0.1.* now", "sources_digest": "deatwin_sources", "digest": "work_source"}
    if changed == "versions":
        monkeypatch.setattr(provenance, "versions", lambda packages: {"deatwin": "0.0.1"})
    else:
        monkeypatch.setattr(own, changed, lambda *_: "f" * 64)
    with pytest.raises(DataError, match=f"another seal \\({told[changed]}"):
        run_study([], square, study.store.folder, seed=4)


@pytest.mark.parametrize("unfit", [lambda case, rng: {}, partial(square), Study])
def test_work_that_could_hold_unseen_values_is_refused(tmp_path, unfit):
    with pytest.raises(DataError, match="must be a function of a module"):
        run_study([], unfit, tmp_path)


@pytest.mark.parametrize(
    ("cases", "words"),
    [
        ([{"value": 1}, {"value": 1}], "case 1 occurs twice"),
        ([{"value": float("nan")}], "case 0: value is nan"),
        ([{"value": [1]}], r"case 0: value is \[1\]; it must be a finite number"),
        ([{"value": 1}, "value"], "case 1 is 'value'; it must be a mapping of names to values"),
        ([{1: 2}], "case 0 is {1: 2}; it must be a mapping of names to values"),
        ({"value": 1}, "cases = {'value': 1}; give a sequence of cases"),
        (None, "cases = None; give a sequence of cases"),
        ("value", "cases = 'value'; give a sequence of cases"),
    ],
)
def test_cases_that_cannot_be_told_apart_or_written_are_refused(tmp_path, cases, words):
    with pytest.raises(DataError, match=words):
        run_study(cases, square, tmp_path)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: open_study(5), "folder must be a str or a PathLike; got an int"),
        (lambda: run_study(grid(value=[1]), square, None), "folder must be a str or a PathLike; got None"),
        (lambda: run_study(grid(value=[1]), square, "there", seed=1.5), "seed = 1.5; it must be an integer"),
        (lambda: run_study(grid(value=[1]), square, "there", settings=5), "settings must be a Mapping; got an int"),
        (lambda: grid(value=5), r"value = 5; give a list of values, as value=\[...\]"),
        (lambda: grid(method="svb"), r"method = 'svb'; give a list of values, as method=\[...\]"),
    ],
)
def test_arguments_of_another_kind_are_refused(call, words):
    with pytest.raises((DataError, ModelError), match=words):
        call()


def uneven(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"track": np.zeros(case["value"]), "mixed": "text" if case["value"] == 1 else 2.0}


def odd(case: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"spectrum": np.array([1j])}


def test_results_that_make_no_table_are_clear_errors(tmp_path):
    study = run_study(grid(value=[1, 2]), uneven, tmp_path / "uneven")
    with pytest.raises(DataError, match=r"track has arrays of several shapes, \(1,\) and \(2,\)"):
        study.to_xarray()
    failed = run_study(grid(value=[1]), odd, tmp_path / "odd").failures
    assert list(failed.values()) == [
        "DataError: the result spectrum is a ndarray; it must be a real number, an array, or a text"
    ]
    with pytest.raises(DataError, match="a study is sealed before its first case"):
        open_study(tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_the_example_of_the_documents_runs(tmp_path):
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
