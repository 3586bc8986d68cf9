"""A naming on paper: the candidates that were tried, with residuals whose sizes are given."""

from dataclasses import replace
from itertools import pairwise

import pytest
from made_fits import leaving
from matplotlib import pyplot as plt

from deatwin.ident.mismatch import Candidate, Naming
from deatwin.ident.mismatch.naming.decide import nothing_tried
from deatwin.plant import Diaphragm, ReadingTime, Rig

NOISE = 2e-6
RIG = Diaphragm()
BARE, BEST, RIVAL, OTHER = "base plant", "best explanation", "not ruled out", "other"


def candidate(*effects: str, fitted: float, unseen: float, rig: Rig = RIG) -> Candidate:
    """An explanation that leaves residuals of exactly these sizes, in µm."""
    return leaving(1e-6 * fitted, 1e-6 * unseen, *effects, rig=rig, noise=NOISE)


BASE = candidate(fitted=12.0, unseen=16.0)
CREEP = candidate("creep", fitted=2.1, unseen=2.3)
DRIFT = candidate("permittivity_drift", fitted=2.2, unseen=2.2)
LAG = candidate("sensor_lag", fitted=7.0, unseen=11.0)
PAIR = candidate("permittivity_drift", "prestretch_relaxation", fitted=5.0, unseen=6.0)


def named(*candidates: Candidate, best: Candidate | None = None, alternatives: tuple[Candidate, ...] = ()) -> Naming:
    return Naming(candidates=(BASE, *candidates), best=best, alternatives=alternatives, probabilities={}, noise=NOISE)


def many(count: int, start: float = 5.0) -> list[Candidate]:
    """Explanations that leave more and more."""
    return [candidate(f"effect_{k}", fitted=start, unseen=start + 0.1 * k) for k in range(count)]


def labels(axes) -> list[str]:
    return [" ".join(label.get_text().split()) for label in axes.get_yticklabels()]


def roles(axes) -> dict[str, str]:
    """Role of each row, by the colour of its filled bar in the legend."""
    legend = axes.get_legend()
    known = {
        patch.get_facecolor(): text.get_text()
        for patch, text in zip(legend.get_patches(), legend.get_texts()[: len(legend.get_patches())], strict=True)
        if "part" not in text.get_text()
    }
    return {name: known[bar.get_facecolor()] for name, bar in zip(labels(axes), axes.containers[1], strict=True)}


def test_each_candidate_has_a_bar_for_each_part_the_base_plant_first():
    axes = named(LAG, CREEP, PAIR, DRIFT, best=CREEP, alternatives=(DRIFT,)).plot()
    assert labels(axes) == [
        "base plant",
        "permittivity drift",
        "creep",
        "permittivity drift + prestretch relaxation",
        "sensor lag",
    ]
    fitted, unseen = ([bar.get_width() for bar in bars] for bars in axes.containers)
    assert fitted == pytest.approx([12.0, 2.2, 2.1, 5.0, 7.0])
    assert unseen == pytest.approx([16.0, 2.2, 2.3, 6.0, 11.0])
    assert axes.get_xlabel() == "rms residual (µm)"
    bottom, top = axes.get_ylim()
    assert top < 0.0 < 4.0 < bottom  # the first row is the highest


def test_the_answer_and_its_rivals_are_told_by_their_colours():
    axes = named(LAG, CREEP, DRIFT, best=CREEP, alternatives=(DRIFT,)).plot()
    assert roles(axes) == {"base plant": BARE, "permittivity drift": RIVAL, "creep": BEST, "sensor lag": OTHER}
    hollow = [bar.get_facecolor()[3] for bar in axes.containers[0]]
    assert hollow == [0.0] * 4  # the fitted part
    assert axes.get_title(loc="left") == "best explanation: creep"


def test_the_noise_is_a_line():
    (line,) = named(CREEP, best=CREEP).plot().get_lines()
    assert line.get_xdata() == pytest.approx([2.0, 2.0])
    assert line.get_label() == "sensor noise, 2 µm"


def test_of_many_the_best_on_unseen_data_are_drawn():
    axes = named(*reversed(many(20)), best=None).plot()
    assert labels(axes) == ["base plant", *(f"effect {k}" for k in range(11))]
    assert [len(bars) for bars in axes.containers] == [12, 12]
    assert axes.get_title(loc="left") == "no effect explains the recordings\n11 of 20 that were tried"


def test_the_answer_and_its_rivals_are_always_drawn():
    """They need not leave the least of the held-out part: evidence is of both parts, and the effects are counted."""
    axes = named(*many(20, start=1.0), CREEP, PAIR, best=PAIR, alternatives=(CREEP,)).plot()
    known = roles(axes)
    assert len(known) == 12
    assert known["permittivity drift + prestretch relaxation"] == BEST
    assert known["creep"] == RIVAL
    crowd = tuple(many(14))
    known = roles(named(CREEP, *crowd, best=CREEP, alternatives=crowd).plot())
    assert sum(role == RIVAL for role in known.values()) == 14


def test_a_rival_in_another_form_of_the_rig_says_so():
    early = replace(RIG, reading=ReadingTime.START_OF_HOLD, model_error=3e-6)
    alternative = candidate("delay", fitted=2.2, unseen=2.4, rig=early)
    axes = named(CREEP, candidate("delay", fitted=4.0, unseen=4.0), best=CREEP, alternatives=(alternative,)).plot()
    assert labels(axes) == ["base plant", "creep", "delay (reading: start of hold)", "delay"]
    assert roles(axes)["delay (reading: start of hold)"] == RIVAL
    assert axes.get_title(loc="left") == "best explanation: creep"  # all four are there


@pytest.mark.parametrize(("unseen", "scale"), [(41.9, "linear"), (42.1, "log")])
def test_the_scale_is_logarithmic_beyond_a_factor_of_twenty(unseen, scale):
    axes = named(CREEP, candidate("delay", fitted=3.0, unseen=unseen), best=CREEP).plot()  # the least is 2.1
    assert axes.get_xscale() == scale
    assert axes.get_xlim()[0] == pytest.approx(0.0 if scale == "linear" else 1.0)  # half of the noise


def test_without_noise_a_logarithmic_scale_begins_at_the_bars():
    naming = named(CREEP, candidate("delay", fitted=3.0, unseen=100.0), best=CREEP)
    assert replace(naming, noise=0.0).plot().get_xlim()[0] == pytest.approx(1.05)  # half of 2.1


def test_what_was_not_tried_is_said():
    axes = nothing_tried(BASE).plot()
    assert labels(axes) == ["base plant"]
    assert axes.get_title(loc="left") == "no effect was tried"
    failed = replace(named(LAG), failed=("mullins", "creep+delay")).plot().get_title(loc="left")
    assert failed == "no effect explains the recordings\n2 could not be tried"


def crowded() -> Naming:
    """Twelve rows, some with long names, and a title of several lines."""
    sets = [(a, "prestretch_relaxation", b) for a in ("permittivity_drift", "creep") for b in ("mullins", "leakage")]
    alternatives = tuple(candidate(*names, fitted=3.0, unseen=3.0) for names in sets)
    answer = candidate("permittivity_drift", "prestretch_relaxation", "dielectric_absorption", fitted=2.1, unseen=2.2)
    return replace(named(answer, *alternatives, *many(20), best=answer, alternatives=alternatives), failed=("delay",))


@pytest.mark.parametrize("naming", [crowded(), named(LAG, CREEP, best=CREEP), nothing_tried(BASE)])
def test_nothing_overlaps(naming):
    axes = naming.plot()
    figure = axes.figure
    figure.canvas.draw()
    legend, title = axes.get_legend().get_window_extent(), axes._left_title.get_window_extent()
    # within a pixel of each other from below: axes, legend, title, edge of the figure
    assert axes.get_window_extent().y1 <= legend.y0 + 1.0 < legend.y1 <= title.y0 + 1.0 < title.y1 <= figure.bbox.y1
    assert max(legend.x1, title.x1) <= figure.bbox.x1
    rows = [label.get_window_extent() for label in axes.get_yticklabels()]
    assert all(above.y0 >= below.y1 for above, below in pairwise(rows))
    assert min(row.x0 for row in rows) >= 0.0


def test_names_of_effects_are_not_torn_apart():
    written = [label.get_text() for label in crowded().plot().get_yticklabels()]
    assert "permittivity drift +\nprestretch relaxation +\ndielectric absorption" in written
    assert all("\u00a0" not in name for name in written)


def test_it_draws_into_given_axes():
    axes = plt.subplots()[1]
    assert named(CREEP, best=CREEP).plot(axes) is axes
    assert len(axes.containers) == 2
