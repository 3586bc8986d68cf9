"""Words of measures, figures and tables are read from a file, and numbers stand in them by name."""

import pytest

from deatwin.studies.report.drawing import draw
from deatwin.studies.report.words import Each, Span, Words

FILE = '''
[measure.error]
of = "error of {name}"
demanded = "below {LIMIT:g}"
reached = """
{errors:.1f} mm
and more"""

[figure.line]
title = "A line"
caption = "Of {name}."

[table.all]
title = "All of {name}"
columns = ["actuator", "{name}"]
'''


@pytest.fixture
def words(tmp_path, monkeypatch):
    (tmp_path / "worded").mkdir()
    (tmp_path / "worded" / "__init__.py").touch()
    (tmp_path / "worded" / "words.toml").write_text(FILE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return Words("worded")


def test_numbers_are_filled_in_by_name(words):
    row = words.measure("error", True, name="A", LIMIT=0.5, errors=Span([0.31, 0.12, 0.2]))
    found = (row.measure, row.demanded, row.reached, row.passed)
    assert found == ("error of A", "below 0.5", "0.1 to 0.3 mm and more", True)
    table = words.table("all", [["x", "1", "2"]], "more", name="B")
    assert (table.title, table.columns) == ("All of B", ["actuator", "B", "more"])
    with draw((1, 1)) as figure:
        drawing = words.drawing(figure, "line", {"x": [1.0]}, "line2", name="C")
    assert (drawing.name, drawing.data, drawing.caption) == ("line2", "figures/line2.csv", "Of C.")


def test_a_number_that_is_not_given_is_an_error(words):
    with pytest.raises(KeyError, match="LIMIT"):
        words.measure("error", False, name="A", errors=Span([1.0]))


def test_several_numbers_in_a_text():
    assert f"{Span([2.04, 2.01]):.1f}" == "2.0" and f"{Span([]):.1f}" == "–"
    assert f"{Each([1, (2.5, 3)]):.1f}" == "1.0, 2.5 and 3.0"
