"""Files as they lie on disks: packed, with formulas, with marks between thousands."""

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant import safe_read
from deatwin.plant.errors import DataError
from deatwin.plant.files import csvtable, read_recording

HEAD = "time_s,command_V,displacement_mm"
ROWS = [f"{0.02 * k:.2f},{k % 3},{k}" for k in range(20)]
TEXT = "\n".join([HEAD, *ROWS])


def pack(path: Path, **files: str) -> Path:
    """Pack texts by the name of the file: one by gzip, or several as a zip archive."""
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress("".join(files.values()).encode()))
        return path
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, text in files.items():
            packed.writestr(f"folder/{name.replace('_', '.')}", text)
        packed.writestr("__MACOSX/folder/._r.csv", "what macOS adds")
    return path


@pytest.mark.parametrize("name", ["r.csv.gz", "r.csv.zip", "r.ZIP"])
def test_a_packed_text_is_read_as_it_is(tmp_path: Path, name: str) -> None:
    (tmp_path / "plain.csv").write_text(TEXT, encoding="utf-8")
    plain, packed = map(read_recording, (tmp_path / "plain.csv", pack(tmp_path / name, r_csv=TEXT)))
    np.testing.assert_array_equal(plain.outputs, packed.outputs)


@pytest.mark.parametrize("name", ["r.csv.gz", "r.zip"])
def test_a_packed_text_that_is_too_large_is_refused(tmp_path: Path, monkeypatch, name: str) -> None:
    monkeypatch.setattr(csvtable, "TEXT_BYTES", 100_000)
    path = pack(tmp_path / name, r_csv=TEXT + "\n" * 1_000_000)
    with pytest.raises(DataError, match="it unpacks to more than 100 kB"):
        read_recording(path)
    assert safe_read.TEXT_BYTES > 100_000


@pytest.mark.parametrize("name", ["r.mat.gz", "r.7z"])
def test_what_is_packed_otherwise_has_to_be_unpacked(tmp_path: Path, name: str) -> None:
    pack(tmp_path / name, r_csv=TEXT)
    with pytest.raises(DataError, match="it is packed; unpack it"):
        read_recording(tmp_path / name)


@pytest.mark.parametrize(
    ("files", "held"),
    [
        ({"a_csv": TEXT, "b_csv": TEXT}, "folder/a.csv, folder/b.csv;"),
        ({"a_mat": ""}, "folder/a.mat;"),
        ({}, "no file;"),
    ],
)
def test_an_archive_of_other_files_has_to_be_unpacked(tmp_path: Path, files: dict[str, str], held: str) -> None:
    with pytest.raises(DataError, match=rf"one text file .* holds {held} unpack it, and give the files inside it"):
        read_recording(pack(tmp_path / "r.zip", **files))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (
            ['0.02,1,"1.234,5"'],
            r'row 3, column "displacement_mm": "1.234,5" has a thousands separator; write it as 1234,5',
        ),
        (['0.02,1,"1,5"'], r'row 3, column "displacement_mm": "1,5" has a comma, but row 2, column "time_s": "0.00"'),
        (
            ["0.02,1,1'23.5"],
            'row 3, column "displacement_mm": "1\'23.5" is not a number',
        ),
        (["0.02,1,1,234.5"], "row 3: the row has 4 cells, but the header has 3; is 1,234.5 one number"),
        (["00:00:00,020,1,2"], "row 3: the row has 4 cells, but the header has 3; is 00:00:00,020 one time"),
    ],
)
def test_a_mark_between_thousands_is_told_where_it_stands(tmp_path: Path, rows: list[str], said: str) -> None:
    path = tmp_path / "r.csv"
    path.write_text("\n".join([HEAD, "0.00,1,2", *rows, *ROWS[2:]]), encoding="utf-8")
    with pytest.raises(DataError, match=said):
        read_recording(path)


@pytest.mark.parametrize("number", ["1'234.5", "1’234.5", "1\u202f234.5", "1\u00a0234.5", "1 234.5", '"1,234.5"'])
def test_a_certain_mark_between_thousands_is_read(tmp_path: Path, number: str) -> None:
    path = tmp_path / "r.csv"
    path.write_text("\n".join([HEAD, "0.00,1,2", f"0.02,1,{number}", *ROWS[2:]]), encoding="utf-8")
    assert read_recording(path).outputs[0, 1] == 1.2345


def test_points_between_thousands_beside_decimal_commas_are_read(tmp_path: Path) -> None:
    """As a German spreadsheet writes 837 and 1002.5 and 1200300: the point is certain, so 1.002 is a thousand."""
    path, values = tmp_path / "r.csv", ("837", "1.002,5", "1.002", "1.200.300", "0,25", "-2.500,125")
    rows = [f"{k / 100:.2f};{k % 3};".replace(".", ",") + value for k, value in enumerate(values)]
    path.write_text("\n".join(["time_s;command_V;displacement_um", *rows]), encoding="utf-8")
    np.testing.assert_allclose(
        1e6 * read_recording(path).outputs[0], [837.0, 1002.5, 1002.0, 1200300.0, 0.25, -2500.125], rtol=1e-12
    )


@pytest.mark.parametrize("most", [999.5, 1999.5])
def test_an_empty_last_cell_does_not_hide_a_comma_between_thousands(tmp_path: Path, most: float) -> None:
    """Each row without a value in the last column; the readings, um, exceed a thousand in one row or in all rows."""
    path = tmp_path / "r.csv"
    rows = [f"{0.02 * k:.2f},{k % 3},{max(most, 1000.0 + k if k == 7 else 0.0):,.1f}," for k in range(20)]
    path.write_text("\n".join(["time_s,command_V,displacement_um,note", *rows]), encoding="utf-8")
    first, number = (9, "1,007.0") if most < 1000.0 else (2, "1,999.5")
    with pytest.raises(DataError, match=f"row {first}: the row has 5 cells, but the header has 4; is {number} one"):
        read_recording(path)
    path.write_text(path.read_text(encoding="utf-8").replace(number, number.replace(",", "")), encoding="utf-8")
    np.testing.assert_allclose(read_recording(path).outputs[0, 7], 1e-6 * float(number.replace(",", "")))


def test_points_that_may_part_thousands_are_asked_for(tmp_path: Path) -> None:
    """A column of whole numbers as written in German: 837, 1.002; where all have three decimals, they are no thousands."""
    path = tmp_path / "r.csv"
    for last, fault in (("999", True), ("999.000", False), ("0.999", False)):
        rows = [f"{20 * k};{k % 3};{1 + k % 5}.{125 + k}" for k in range(20)]
        path.write_text("\n".join(["time_ms;command_V;displacement_um", *rows, f"400;1;{last}"]), encoding="utf-8")
        if fault:
            with pytest.raises(DataError, match=r'row 2, .*_um": "1.125" may mean thousands or a decimal point'):
                read_recording(path)
        else:
            assert read_recording(path).outputs[0, 0] == 1.125e-6


def test_a_formula_without_a_value_is_named(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(HEAD.split(","))
    for k in range(20):
        book.active.append([0.02 * k, k % 3, f"=B{k + 2}*2"])
    book.save(tmp_path / "r.xlsx")
    with pytest.raises(DataError, match=r'row 2, column "displacement_mm": "=B2\*2" is a formula whose value'):
        read_recording(tmp_path / "r.xlsx")
