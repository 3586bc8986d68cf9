"""The store of a sweep's cases: its seal, spoilt and foreign cases, and how many of them lie side by side."""

import json

import pytest

from deatwin.plant.errors import DataError
from deatwin.studies.sweep import store as storing
from deatwin.studies.sweep.seal import SweepSeal
from deatwin.studies.sweep.store import CaseStore, decode, encode

SEAL = SweepSeal(schema="deatwin/test-case/1", parts={"seed": 1})
NAMES = [f"case-{number:02d}" for number in range(24)]


def test_a_folder_begun_under_another_seal_is_refused_and_told_what_differs(tmp_path):
    numbers, versions = {"a.B": 1.0, "a.C": 3.0}, {"numpy": "2.0"}
    parts = {"seed": 1, "code": "a" * 64, "thresholds": numbers, "versions": versions}
    first = SweepSeal(schema="deatwin/test-case/1", parts=parts)
    CaseStore(tmp_path, first).put("one", {"x": 1})
    changed = {"seed": 2, "code": "b" * 64, "thresholds": {**numbers, "a.B": 2.0}}
    words = r"seed: 1 there, 2 now; code: a{12} there, b{12} now; thresholds: {\"a.B\": 1.0} there, {\"a.B\": 2.0} now"
    with pytest.raises(DataError, match=rf"another seal \({words}\)"):
        CaseStore(tmp_path, SweepSeal(schema=first.schema, parts={**parts, **changed}))
    assert CaseStore(tmp_path, first).get("one")["x"] == 1


def test_a_result_is_not_written_into_a_folder_sealed_anew_nor_over_one_that_is_there(tmp_path):
    store = CaseStore(tmp_path, SEAL)
    store.put("one", {"x": 1})
    store.put("one", {"x": 2})
    assert store.get("one")["x"] == 1
    (tmp_path / "seal.json").write_text(json.dumps(SweepSeal(schema="s", parts={}).to_dict()))
    with pytest.raises(DataError, match="resealed since"):
        store.put("two", {"x": 1})


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda whole: b"", r"one\.nc: no file of a case; .*delete it, and the case is run again"),
        (lambda whole: whole[:-1], "one.nc: damaged or altered; .*delete it"),
        (lambda whole: encode({**decode(whole), "seal": "0" * 64}), "one.nc: .* another seal"),
        (lambda whole: encode({**decode(whole), "name": "two"}), "one.nc: .* another seal"),
    ],
)
def test_a_spoilt_case_is_one_clear_error(tmp_path, spoil, words):
    store = CaseStore(tmp_path, SEAL)
    store.put("one", {"x": 1})
    store.path("one").write_bytes(spoil(store.path("one").read_bytes()))
    with pytest.raises(DataError, match=words):
        store.get("one")


def test_cases_without_a_seal_and_an_altered_seal_are_refused(tmp_path):
    CaseStore(tmp_path, SEAL).put("one", {})
    path = tmp_path / "seal.json"
    text = path.read_text()
    path.write_text(text.replace('"seed": 1', '"seed": 3'))
    with pytest.raises(DataError, match="the seal was altered"):
        CaseStore(tmp_path, SEAL)
    path.unlink()
    with pytest.raises(DataError, match="holds cases but no seal"):
        CaseStore(tmp_path, SEAL)


def test_many_cases_are_spread_and_few_are_not(tmp_path):
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
def test_a_name_that_is_no_file_is_refused(tmp_path, name):
    with pytest.raises(DataError, match="a case cannot be called"):
        CaseStore(tmp_path, SEAL).put(name, {})
