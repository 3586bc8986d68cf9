"""The words of a page are read from a file, and numbers stand in them by name."""

from pathlib import Path

import pytest

from deatwin.studies.prose import Each, Prose, Span, listed
from deatwin.studies.report.svg import draw

WORDS = '''
[measure.error]
of = "error of {name}"
demanded = "below {LIMIT:g}"
reached = "{errors:.1f} mm"

[note.why]
title = "Why"
text = """
One,
two {number:d}.

Three.
"""

[figure.line]
title = "A line"
caption = "Of {name}."

[table.all]
title = "All of {name}"
columns = ["actuator", "{name}"]
'''


@pytest.fixture
def words(tmp_path: Path) -> Prose:
    (tmp_path / "page.toml").write_text(WORDS, encoding="utf-8")
    return Prose(str(tmp_path / "__init__.py"))


def test_numbers_are_filled_in_by_name(words: Prose) -> None:
    row = words.row("error", True, name="A", LIMIT=0.5, errors=Span([0.31, 0.12, 0.2]))
    assert (row.measure, row.demanded, row.reached, row.passed) == ("error of A", "below 0.5", "0.1 to 0.3 mm", True)
    note = words.note("why", number=2)
    assert (note.title, note.paragraphs) == ("Why", ["One, two 2.", "Three."])
    table = words.table("all", [["x", "1", "2"]], "more", name="B")
    assert (table.title, table.columns) == ("All of B", ["actuator", "B", "more"])
    with draw((1, 1)) as figure:
        drawing = words.drawing(figure, "line", "line2", name="C")
    assert (drawing.name, drawing.data, drawing.caption) == ("line2", "figures/line2.csv", "Of C.")
    assert words.text("figure.line.title") == "A line"


def test_a_number_that_is_not_given_is_an_error(words: Prose) -> None:
    with pytest.raises(KeyError, match="LIMIT"):
        words.row("error", False, name="A", errors=Span([1.0]))


def test_numbers_in_a_row() -> None:
    assert f"{Span([2.04, 2.01]):.1f}" == "2.0" and f"{Span([]):.1f}" == "–"
    assert f"{Each([1, 2.5], '; '):.1f}" == "1.0; 2.5"
    assert [listed(texts) for texts in (["a"], ["a", "b"], ["a", "b", "c"], [])] == ["a", "a and b", "a, b and c", ""]
