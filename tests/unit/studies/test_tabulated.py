"""The data of a drawn figure."""

import csv

import numpy as np

from deatwin.studies.report.drawing import draw, draw_map, share_bar
from deatwin.studies.report.tables import drawn_table


def test_lines_maps_and_hidden_labels_are_told_with_their_panels():
    with draw((4.0, 3.0)) as figure:
        left, right = figure.subplots(1, 2)
        left.plot([0.0, 1.0], [2.0, 3.0], label="_second actuator")
        left.set(xlabel="time (s)")
        left.set_title("gain", loc="left")
        left.plot([5.0], [6.0])  # without a label
        mesh = draw_map(right, np.array([0.0, 1.0]), np.array([10.0, 20.0, 30.0]), np.arange(6.0).reshape(2, 3))
        share_bar(figure, mesh, [right], "dB")
        rows = list(csv.DictReader(drawn_table(figure).splitlines()))
    assert {row["panel"] for row in rows} == {"1", "2"}  # a colour bar is none
    line = [row for row in rows if row["series"] == "second actuator"]
    assert [(row["title"], row["horizontal"], row["x"], row["y"], row["value"]) for row in line] == [
        ("gain", "time (s)", "0", "2", ""),
        ("gain", "time (s)", "1", "3", ""),
    ]
    assert [row["series"] for row in rows if row["x"] == "5"] == [""]
    cells = {(float(row["x"]), float(row["y"])): float(row["value"]) for row in rows if row["kind"] == "map"}
    assert cells == {(x, y): 3.0 * x + y / 10 - 1 for x in (0.0, 1.0) for y in (10.0, 20.0, 30.0)}
