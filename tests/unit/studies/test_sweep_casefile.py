"""The file of a case: read back to the last bit, the same bytes for the same case, and read by others' programs."""

import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.io import netcdf_file

from deatwin.plant.errors import DataError
from deatwin.studies.sweep.store import decode, encode, read_case, write_case

CASE: dict[str, Any] = {
    "name": "größe 3 µm",
    "passed": True,
    "count": 7,
    "nothing": None,
    "empty": [],
    "blank": "",
    "result": {
        "gain": 0.1 + 0.2,
        "track": [1.5, math.inf, -0.0],
        "gaps": [1.0, None],
        "table": [[1, 2, 3], [4, 5, 6]],
        "ragged": [[1], [2, 3]],
        "large": 2**40,
        "inner": {"odd": math.nan, "words": ["ab", "", "größer"]},
    },
    "causes": [{"effect": "creep", "p": 0.9}, {"effect": "delay", "p": None, "known": False}],
}


@pytest.mark.parametrize(
    "record",
    [
        CASE,
        {},
        {"x": -0.0, "y": 5e-324, "z": 0.1, "most": 1.7976931348623157e308, "whole": 3.0, "int": 3, "far": -(10**400)},
        {"a": {"b": {"c": {}}}, "d": [[], [[]], {}], "e": [None], "mixed": [1, "a", None, True, {"k": []}]},
        {"lone \ud800": "\ud800", "nul": "a\0b\0", "lines": "\r\n\u2028", "": "no name", "/": 1, " ": 2, "_": 3},
        {
            "record": "like the variable",
            "mode": "w",
            "fp": 1,
            "dimensions": [1],
            "sha256": "0" * 64,
            "a.b": 1,
            "a": {"b": 2},
            "c": [1, 2],
            "c_0": 3,
            "0" * 64: [1],
        },
    ],
)
def test_a_case_comes_back_to_the_last_bit(record):
    content = encode(record)
    # Python's JSON tells 3 from 3.0, -0.0 from 0.0, True from 1, and writes the shortest text that gives a float back.
    assert json.dumps(decode(content)) == json.dumps(record)
    assert encode(json.loads(json.dumps(record))) == content


def test_scipy_and_xarray_read_the_numbers_by_their_path(tmp_path):
    write_case(tmp_path / "one.nc", CASE)
    with netcdf_file(tmp_path / "one.nc", mmap=False) as file:
        assert file.variables["result.gain"].data == 0.1 + 0.2
        assert json.loads(file.variables["record"].data.tobytes())["name"] == "größe 3 µm"
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "one.nc") as found:
        found = found.load()
    assert found["name"].item() == "größe 3 µm" and found["passed"].item() == 1
    np.testing.assert_array_equal(found["result.track"], [1.5, np.inf, 0.0])
    np.testing.assert_array_equal(found["result.gaps"], [1.0, np.nan])
    np.testing.assert_array_equal(found["result.table"], [[1, 2, 3], [4, 5, 6]])
    assert found["result.large"].item() == 2.0**40 and np.isnan(found["result.inner.odd"].item())
    assert found["result.inner.words"].values.tolist() == ["ab", "", "größer"]
    assert found["causes.effect"].values.tolist() == ["creep", "delay"]
    np.testing.assert_array_equal(found["causes.p"], [0.9, np.nan])
    np.testing.assert_array_equal(found["causes.known"], [np.nan, 0.0])
    # What the format cannot hold is in the record alone.
    assert not {"nothing", "empty", "blank", "result.ragged"} & set(found.variables)
    assert json.loads(found["record"].item())["result"]["ragged"] == [[1], [2, 3]]
    assert found.attrs["schema"] == "deatwin/case-file/1"


def test_names_that_clash_are_told_apart_and_say_what_they_were(tmp_path):
    xarray = pytest.importorskip("xarray")
    write_case(tmp_path / "one.nc", {"a.b": 1, "a": {"b": 2}, "µ/m": 3, "record": 4, "c": [5, 6], "c_0": 7})
    with xarray.open_dataset(tmp_path / "one.nc") as found:
        named = {v.attrs.get("long_name", name): v.values.tolist() for name, v in found.data_vars.items()}
        assert found["a.b"].item() == 1 and found["a.b_2"].item() == 2
    assert named["µ/m"] == 3 and named["record"] == 4
    assert named["c"] == [5, 6] and named["c_0"] == 7


def test_no_single_byte_can_be_altered_unseen():
    content = encode({"x": 1.0, "text": "abc", "track": [1, 2]})
    for place in range(len(content)):
        altered = bytearray(content)
        altered[place] ^= 1
        with pytest.raises(ValueError, match=r"no file of a case|damaged or altered"):
            decode(bytes(altered))


def test_files_of_others_and_parts_of_files_are_one_clear_error(tmp_path):
    path = tmp_path / "other.nc"
    with netcdf_file(path, "w") as file:
        file.createDimension("x", 3)
        file.createVariable("record", "f8", ("x",))[:] = 0.0
    with pytest.raises(DataError, match=r"other\.nc: no file of a case; .*delete it"):
        read_case(path)
    content = encode(CASE)
    for spoilt in (*(content[:length] for length in range(0, len(content), 7)), content + b"\0"):
        path.write_bytes(spoilt)
        with pytest.raises(DataError, match=r"other\.nc: (no file of a case|damaged or altered); .*delete it"):
            read_case(path)
    with pytest.raises(DataError, match=r"none\.nc: this case has not been run"):
        read_case(tmp_path / "none.nc")


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    (tmp_path / "one.nc").mkdir()
    (tmp_path / "one.nc" / "held").touch()
    with pytest.raises(DataError, match=r"one\.nc: this is a folder; give the name of a file"):
        write_case(tmp_path / "one.nc", CASE)
    assert [path.name for path in tmp_path.iterdir()] == ["one.nc"]
