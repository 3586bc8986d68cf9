"""The calibrated base plant on paper: its forms beside each other, with residuals whose sizes are given."""

from dataclasses import replace

import pytest
from made_fits import leaving
from matplotlib import pyplot as plt

from deatwin.ident.mismatch import Base, Candidate
from deatwin.ident.mismatch.model_error import differences
from deatwin.plant import Diaphragm, ReadingTime, Rig

NOISE, MODEL_ERROR = 3e-6, 4e-6
NOMINAL = Diaphragm(model_error=MODEL_ERROR)
EARLY = replace(NOMINAL, reading=ReadingTime.START_OF_HOLD)
BONDED = replace(NOMINAL, ball="bonded")


def form(rig: Rig, fitted: float, unseen: float) -> Candidate:
    """A form of the plant that leaves residuals of exactly these sizes, SI."""
    return leaving(fitted, unseen, rig=rig, noise=NOISE)


def three_forms() -> Base:
    chosen, *alternatives = form(NOMINAL, 8e-6, 9e-6), form(EARLY, 12e-6, 15e-6), form(BONDED, 20e-6, 26e-6)
    return Base(chosen=chosen, alternatives=tuple(alternatives), noise=NOISE)


def widths(axes) -> list[list[float]]:
    return [[bar.get_width() for bar in bars] for bars in axes.containers]


def test_each_form_has_a_bar_for_each_part_the_chosen_one_first():
    axes = three_forms().plot()
    fitted, unseen = widths(axes)
    assert fitted == pytest.approx([8.0, 12.0, 20.0])
    assert unseen == pytest.approx([9.0, 15.0, 26.0])
    assert axes.get_xlabel() == "rms residual (µm)"
    assert axes.get_xscale() == "linear"
    top, bottom = axes.get_ylim()[::-1]
    assert top < 0.0 < 2.0 < bottom  # the first row is the highest
    colours = [bar.get_facecolor() for bar in axes.containers[1]]
    assert colours[0] != colours[1] == colours[2]


def test_forms_are_called_by_what_differs_between_them():
    axes = three_forms().plot()
    assert [" ".join(label.get_text().split()) for label in axes.get_yticklabels()] == [
        "reading: end of hold, ball: sliding",
        "reading: start of hold, ball: sliding",
        "reading: end of hold, ball: bonded",
    ]
    other = Base(chosen=form(EARLY, 8e-6, 9e-6), alternatives=(form(NOMINAL, 9e-6, 9e-6),), noise=NOISE)
    assert [label.get_text() for label in other.plot().get_yticklabels()] == [
        "reading: start of hold",
        "reading: end of hold",
    ]
    alone = Base(chosen=form(NOMINAL, 3e-6, 3e-6), alternatives=(), noise=NOISE)
    assert [label.get_text() for label in alone.plot().get_yticklabels()] == ["base plant"]


def test_the_floor_is_noise_and_model_error_together():
    axes = three_forms().plot()
    lines = {line.get_label(): line.get_xdata()[0] for line in axes.get_lines()}
    # the hypotenuse of 3 and 4
    assert lines == {"sensor noise, 3 µm": pytest.approx(3.0), "noise and model error, 5 µm": pytest.approx(5.0)}
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    assert shown == ["fitted part", "held-out part", "chosen", "other form", *lines]
    # beyond 3 µm of noise the held-out part keeps the root of 9² - 3² = 72
    assert axes.get_title(loc="left") == "left beyond the noise: 8.49 µm; the plant's own model error: 4 µm"


def test_bars_of_very_different_sizes_are_drawn_on_a_logarithmic_scale():
    narrow = Base(chosen=form(NOMINAL, 8e-6, 9e-6), alternatives=(form(EARLY, 50e-6, 159e-6),), noise=NOISE)
    wide = replace(narrow, alternatives=(form(EARLY, 50e-6, 161e-6),))
    assert narrow.plot().get_xscale() == "linear"
    axes = wide.plot()
    assert axes.get_xscale() == "log"
    assert 0.0 < axes.get_xlim()[0] < 3.0  # the noise line is inside


def test_it_draws_into_given_axes_and_nothing_overlaps():
    figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    assert three_forms().plot(axes) is axes
    figure.canvas.draw()
    legend, title = axes.get_legend().get_window_extent(), axes._left_title.get_window_extent()
    # within a pixel of each other from below: axes, legend, title, edge of the figure
    assert axes.get_window_extent().y1 <= legend.y0 + 1.0 < legend.y1 <= title.y0 + 1.0 < title.y1 <= figure.bbox.y1
    assert legend.x1 <= figure.bbox.x1


def test_model_errors_are_no_difference_between_forms():
    refined = replace(EARLY, model_error=9e-6)
    assert differences([NOMINAL, refined]) == ({"reading": "end of hold"}, {"reading": "start of hold"})
    assert differences([NOMINAL, replace(NOMINAL, model_error=9e-6)]) == ({}, {})
    several = differences([NOMINAL, EARLY, replace(NOMINAL, prestretch=3.0)])
    assert [each["prestretch"] for each in several] == [3.5, 3.5, 3.0]
    assert [each["reading"] for each in several] == ["end of hold", "start of hold", "end of hold"]
