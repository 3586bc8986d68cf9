"""How stories end: pages, tables, prose, rates."""

import json

import numpy as np
import pytest
from markdown_tables import markdown_table
from scipy.stats import binom

from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.rates import Rate
from deatwin.studies.report import words
from deatwin.studies.report.drawing import Drawing, draw
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish, reached
from deatwin.studies.report.tables import csv_text


def test_a_story_ends_with_page_figures_result_and_record(tmp_path):
    with draw((3, 2)) as figure:
        figure.add_subplot().plot([0, 1], [1, 2])
        drawings = [
            Drawing.of(figure, "line", "A line", "It rises.", {"x_m": np.arange(2.0)}),
            Drawing.of(figure, "words", "Words", "Cells.", csv_text(["who"], [["a"]])),
        ]
    rows = [Measure("error", "below 1e-06", "2e-09", True), Measure("count", "at least 3", "2", False)]
    page = StoryPage(
        title="tale",
        sentence="So it was.",
        rows=rows,
        notes=[Note(title="Why", paragraphs=["Because."])],
        figures=drawings,
        tables=[Table(title="All", columns=["a"], rows=[["1"]])],
    )
    record = RunRecord(command=["deatwin"], inputs=[], seed=3, jobs=1)
    folder = ResultFolder(tmp_path)

    result = finish(folder, record, page, extra=1)

    assert list(result) == ["sentence", "measures", "tables", "extra"]
    assert result["tables"] == [{"title": "All", "columns": ["a"], "rows": [["1"]]}]
    assert json.loads((tmp_path / "tale.json").read_text()) == result
    assert result["measures"][0] == {"measure": "error", "demanded": "below 1e-06", "reached": "2e-09", "passed": True}
    assert reached(rows) == "1 of 2" and page.label == "1 of 2 goals reached" and not page.passed
    assert (tmp_path / "figures/words.csv").read_text() == "who\na\n"
    assert (tmp_path / "figures/line.csv").read_text() == "x_m\n0.0\n1.0\n"
    outputs = json.loads((tmp_path / "run.json").read_text())["outputs"]
    assert outputs == ["figures/line.csv", "figures/words.csv", "report.html", "tale.json", "run.json"]
    shown = (tmp_path / "report.html").read_text()
    assert all(text in shown for text in ("So it was.", "Because.", "It rises.", "at least 3"))


def test_notes_come_from_a_template_with_named_numbers(tmp_path, monkeypatch):
    (tmp_path / "told").mkdir()
    (tmp_path / "told" / "__init__.py").touch()
    (tmp_path / "told" / "notes.md.j2").write_text(
        "## First {{ n }}\n\nOne line\nand another of {{ x|form('.2f') }} for {{ names|listed }}.\n\nNext.\n\n"
        "{% if n > 2 %}\n## Second\n```\na\n  b\n```\n{% endif %}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert words.notes("told", n=3, x=1.234, names=["a", "b"]) == [
        Note(title="First 3", paragraphs=["One line and another of 1.23 for a and b.", "Next."]),
        Note(title="Second", paragraphs=[], code="a\n  b\n"),
    ]
    assert len(words.notes("told", n=1, x=1, names=[])) == 1


def test_tables_in_markdown():
    assert markdown_table(["a", "b"], [["x|y", "1"]]) == ["| a | b |", "|---|---|", "| x/y | 1 |"]


@pytest.mark.parametrize(
    ("hits", "count", "interval", "least", "most"),
    # Closed forms: without a hit, and with hits only, the bounds are powers of the tail probability.
    [
        (0, 10, (0.0, 1 - 0.025**0.1), 0.0, 1 - 0.05**0.1),
        (10, 10, (0.025**0.1, 1.0), 0.05**0.1, 1.0),
        (0, 0, (0.0, 1.0), 0.0, 1.0),
    ],
)
def test_bounds_of_a_rate_are_exact(hits, count, interval, least, most):
    rate = Rate(hits=hits, count=count)
    assert rate.interval == pytest.approx(interval)
    assert (rate.least, rate.most) == pytest.approx((least, most))


def test_bounds_of_a_rate_are_where_the_binomial_tails_have_their_probability():
    low, high = Rate(hits=7, count=21).interval
    assert binom.sf(6, 21, low) == pytest.approx(0.025) and binom.cdf(7, 21, high) == pytest.approx(0.025)
    rate = Rate(hits=7, count=21)
    assert binom.sf(6, 21, rate.least) == pytest.approx(0.05) and binom.cdf(7, 21, rate.most) == pytest.approx(0.05)


def test_a_rate_in_words():
    assert str(Rate.of([True, False, True, True])) == "75 % (19.4 to 99.4)"
