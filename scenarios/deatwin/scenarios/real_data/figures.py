"""The figures of the story: free runs against what was measured, and their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import NarxModel
from deatwin.scenarios.real_data.published import DOCUMENTED
from deatwin.studies.public.black_boxes import FRO, GROWN, LINEAR, REFINED, Outcome
from deatwin.studies.public.records import DataSet
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
Array = NDArray[np.float64]
WINDOW = 500  # Samples of a running root mean square
ZOOM = 120  # Samples around the largest output that are drawn


def _key(method: str) -> str:
    return method.replace(",", "").replace(" ", "_")


def _running(values: Array) -> Array:
    """Return the root mean square of each complete window."""
    count = values.size // WINDOW
    return np.sqrt(np.mean(values[: count * WINDOW].reshape(count, WINDOW) ** 2, axis=1))


def arrow_head(data: DataSet, outcomes: Mapping[str, Outcome]) -> Drawing:
    """Draw the Silverbox over its growing amplitude, with errors of a linear and of two nonlinear models."""
    measured, step = data.test.outputs[0] / data.scale, data.test.sample_time
    timepts = (np.arange(measured.size // WINDOW) + 0.5) * WINDOW * step
    learned = np.abs(data.train.outputs).max() / data.scale
    columns: dict[str, Array] = {"time_s": timepts, "output_rms_mV": _running(measured)}
    peak = int(np.argmax(np.abs(measured)))
    near = slice(max(peak - ZOOM // 2, 0), min(peak + ZOOM // 2, measured.size))
    with draw((9.6, 6.6)) as figure:
        top, middle, bottom = figure.subplots(3, 1, height_ratios=(2, 3, 3))
        top.plot(data.test.timepts[::4], measured[::4], color=Hue.MEASURED, linewidth=0.3)
        for side in (-1, 1):
            top.axhline(side * learned, color=Hue.INK, linestyle=":", linewidth=0.9)
        top.set(ylabel="output (mV)")
        for (method, colour), style in zip(_SHOWN, ("-", "-", "-"), strict=True):
            error = measured - outcomes[method].outputs / data.scale
            middle.semilogy(timepts, _running(error), style, color=colour, label=_said(outcomes[method]))
            columns[f"{_key(method)}_mV"] = _running(error)
            if method != FRO:
                shown = outcomes[method].outputs[near] / data.scale
                bottom.plot(data.test.timepts[near], shown, color=colour, linewidth=1.4)
        middle.semilogy(timepts, columns["output_rms_mV"], "--", color=Hue.MEASURED, label="output itself")
        middle.set(ylabel=f"rms of {WINDOW} samples (mV)", xlabel="time (s)")
        bottom.plot(data.test.timepts[near], measured[near], ".", color=Hue.INK, markersize=3.5)
        bottom.set(ylabel="output (mV)", xlabel="time (s)")
        legend_above(figure, middle, 2)
        return WORDS.drawing(figure, "arrow_head", columns)


_SHOWN = ((LINEAR, Hue.BEFORE), (FRO, Hue.MARK), (GROWN, Hue.AFTER))


def _said(outcome: Outcome) -> str:
    return f"{outcome.method}, {outcome.terms} parameters"


def converter(data: DataSet, outcomes: Mapping[str, Outcome]) -> Drawing:
    """Draw the buck converter's free run and that of the documented model."""
    name, terms = next(iter(DOCUMENTED.items()))
    theirs = NarxModel.from_terms(terms, sample_time=data.test.sample_time).simulate(data.test).outputs[0]
    runs = {LINEAR: outcomes[LINEAR].outputs, name: theirs, REFINED: outcomes[REFINED].outputs}
    return _runs(data, runs, "converter", method=REFINED)


def free_runs(data: DataSet, outcomes: Mapping[str, Outcome], methods: Sequence[str]) -> Drawing:
    """Draw free runs of some methods over the test recording, with their errors."""
    runs = {method: outcomes[method].outputs for method in methods if not outcomes[method].failure}
    return _runs(data, runs, "free_run", data.name, data=data.title, note=data.note)


def _runs(shown: DataSet, runs: Mapping[str, Array], name: str, called: str = "", **said: str) -> Drawing:
    measured, timepts = shown.test.outputs[0] / shown.scale, shown.test.timepts
    size, unit = (1e3, "ms") if name == "converter" and shown.test.sample_time < 1e-3 else (1.0, "s")
    columns: dict[str, Array] = {"time_s": timepts, "measured": measured}
    with draw((9.6, 4.8)) as figure:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        top.plot(size * timepts, measured, color=Hue.MEASURED, linewidth=1.8, label="measured")
        for (method, outputs), colour in zip(runs.items(), (Hue.BEFORE, Hue.MARK, Hue.AFTER), strict=False):
            top.plot(size * timepts, outputs / shown.scale, color=colour, label=method)
            bottom.plot(size * timepts, measured - outputs / shown.scale, color=colour)
            columns[_key(method)] = outputs / shown.scale
        top.set(ylabel=f"output ({shown.unit})")
        bottom.set(ylabel=f"error ({shown.unit})", xlabel=f"time ({unit})")
        legend_above(figure, top, 4)
        return WORDS.drawing(figure, name, columns, called, **said)
