"""The report of `deatwin identify --report`: the model compared with held-out data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import typer

from deatwin.app.identify_periodic import periodic_drawing
from deatwin.ident.look import BestLinearApproximation
from deatwin.ident.narx import NarxModel, NarxResponse, Unstable, Validation
from deatwin.ident.narx.linear import OutputError
from deatwin.ident.narx.variables import symbols_of
from deatwin.ident.narx.written import origins, shown_units
from deatwin.ident.nss import NonlinearStateSpace
from deatwin.plant.amplitudes import amplitude_unit, axis_label, written_amplitude
from deatwin.plant.drawing import envelope, plain_numbers
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording, label
from deatwin.plant.words import as_sentence, spaced
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import Drawing, Hue, draw
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, write_story
from deatwin.studies.report.tables import drawn_table
from deatwin.studies.voice import complain

NEXT = {
    True: "use the model for inputs within the recorded range and frequencies.",
    False: "try other lags, another `--degree` or another `--method`; the table below shows which goal the model misses.",
}
"""Advice, by whether all measures are reached."""
MOST = 6  # Most recordings that have a figure of their own
ROW = 0.3  # Height of a term's row, in inches


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """Recordings, with the parts to which a model is fitted and the held-out parts that judge it."""

    whole: Sequence[Recording]  # As recorded
    records: Sequence[Recording]  # Decimated, if that was requested
    training: Sequence[Recording]
    unseen: Sequence[Recording]
    notes: Sequence[str]  # Notes on the sampling
    periodic: BestLinearApproximation | None  # Set for periodic recordings


@dataclass(frozen=True, kw_only=True, eq=False)
class Tested:
    """Validation of a model on held-out data, or the reason why there is none."""

    validation: Validation | None = None
    why_not: str = ""
    unstable: Unstable | None = None  # Set if there are too few samples for a validation

    @property
    def pole(self) -> Unstable | None:
        """The unstable pole of the model, if it has one."""
        return self.unstable if self.validation is None else self.validation.unstable


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A model with the data on which it was judged."""

    model: NarxModel | NonlinearStateSpace
    told: str  # Kind, size and method of the model, in words
    data: Data
    tested: Tested
    complete: bool  # False if the search for terms was interrupted
    notes: Sequence[str]  # Notes on the fit
    input_lags: Sequence[int]  # Lags of the linear model with which this one is compared
    output_lags: int
    linear_as: str = "with the same lags"  # What that model has in common with this one

    @cached_property
    def linear(self) -> Sequence[float]:
        """Free-run error of a linear output-error model on each held-out part, SI; empty if there is no such model."""
        if self.tested.pole is not None or len(self.data.training[0].outputs) > 1:
            return []
        try:
            found = OutputError(nb=len(self.input_lags), nf=self.output_lags, nk=min(self.input_lags))
            model = found.fit(self.data.training).model_
            runs = [model.simulate(part) for part in self.data.unseen]
        except ModelError:
            return []
        return [run.rms_error for run in runs] if all(run.status.ok for run in runs) else []

    @property
    def scale(self) -> float:
        """SI size of the unit in which outputs are shown."""
        return written_amplitude(self.model.output_units[0])[1]

    @property
    def unit(self) -> str:
        """Unit in which outputs are shown; empty for a pure number."""
        shown = written_amplitude(self.model.output_units[0])[0]
        return "" if shown == "1" else shown

    @property
    def column(self) -> str:
        """Unit in the form of a column header's end."""
        name = amplitude_unit(self.model.output_units[0])[0]
        return "" if name in ("", "1") else f"_{name}"

    @property
    def steps(self) -> int | None:
        """Number of steps ahead on which an unstable model is judged; None if its free run is judged."""
        unstable = self.tested.pole
        return None if unstable is None else unstable.steps

    @property
    def judged(self) -> str:
        """Name of the prediction on which the model is judged."""
        return "free run" if self.steps is None else f"prediction {self.steps} steps ahead"

    def run(self, part: Recording) -> NarxResponse:
        """Run the prediction on which the model is judged over a recording."""
        return self.model.simulate(part) if self.steps is None else self.model.predict(part, steps=self.steps)

    def amount(self, value: float) -> str:
        """Write a size of an output with its unit."""
        return f"{value / self.scale:.3g} {self.unit}".rstrip()


@contextmanager
def interruptible() -> Iterator[None]:
    """End the command if a fit is interrupted before it has a model."""
    try:
        yield
    except KeyboardInterrupt:
        complain("interrupted before a model was found; nothing was written")
        raise typer.Exit(130) from None


def write_identified(found: Identified, folder: ResultFolder, record: RunRecord) -> None:
    """Write figures' data, the report and the record."""
    data = found.data
    runs = [found.run(part) for part in data.unseen]
    pairs = enumerate(zip(data.unseen[:MOST], runs, strict=False), start=1)
    drawings = [_free_run(found, number, part, run) for number, (part, run) in pairs]
    tables, model = [], found.model
    if isinstance(model, NarxModel):
        drawings.append(_terms(model))
        tables.append(_table(model))
    if data.periodic is not None:
        drawings.append(periodic_drawing(data.periodic))
    if found.tested.validation is not None and found.tested.validation.tests:
        drawings.append(_tests(found.tested.validation))
    rows = _rows(found, runs)
    worst = max(runs, key=lambda run: run.rms_error)
    beside = f"; a linear model has an error of {found.amount(max(found.linear))} rms" if found.linear else ""
    sentence = (
        f"{found.told} has {'at most ' if len(runs) > 1 else ''}an error of {found.amount(worst.rms_error)} rms in its "
        f"{found.judged} on held-out data{beside}."
    )
    said = (
        found.tested.validation.status.value
        if found.tested.validation is not None
        else f"the residual was not tested: {found.tested.why_not}"
    )
    unstable = found.tested.pole
    more = [] if unstable is None else unstable.sentences(found.model.output_units)
    paragraphs = [as_sentence(text) for text in (said, *more)]
    notes = [Note(title="Residual", paragraphs=paragraphs)]
    if data.notes:
        notes.append(Note(title="Sampling", paragraphs=[f"{said}." for said in data.notes]))
    if not found.complete:
        notes.append(
            Note(title="Interrupted", paragraphs=["The search for terms was interrupted before it was complete."])
        )
    if found.notes:
        notes.append(Note(title="About the fit", paragraphs=[as_sentence(note) for note in found.notes]))
    if not tables:
        notes.append(
            Note(
                title="The model",
                paragraphs=["The signals in these equations are scaled and have no units."],
                code=str(model),
            )
        )
    page = StoryPage(
        title="identify",
        sentence=sentence,
        rows=rows,
        notes=notes,
        figures=drawings,
        tables=tables,
        next=NEXT[all(row.passed for row in rows)],
    )
    write_story(folder, page, record)
    folder.remove_former(r"figures/\w+\.csv")
    record.save(folder)


def _free_run(found: Identified, number: int, part: Recording, run: NarxResponse) -> Drawing:
    """Return measured and simulated output of a held-out part, residual and input."""
    name, title = f"free_run_{number}", f"{found.judged.capitalize()} on the held-out part of {label(part)}"
    timepts, measured, simulated = run.timepts, run.measured[0] / found.scale, run.outputs[0] / found.scale
    command = part.inputs[0][-timepts.size :]
    with draw((7.4, 5.0)) as figure:
        upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(3, 1.6, 1.3))
        upper.plot(*envelope(timepts, measured), color=Hue.MEASURED, linewidth=2.2, label="measured")
        upper.plot(*envelope(timepts, simulated), color=Hue.AFTER, linewidth=1.0, label=f"{found.judged} of the model")
        middle.plot(*envelope(timepts, measured - simulated), color=Hue.BEFORE, linewidth=0.8)
        middle.axhline(0, color=Hue.INK, linewidth=0.6)
        lower.plot(*envelope(timepts, command), color=Hue.INK, linewidth=0.8)
        upper.set_ylabel(axis_label(spaced(found.model.output_names[0]), found.unit))
        middle.set_ylabel(axis_label("residual", found.unit))
        lower.set(xlabel="time (s)", ylabel=axis_label(spaced(part.input_names[0]), part.input_units[0]))
        figure.align_ylabels()
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        given = (
            "the first measured outputs"
            if found.steps is None
            else f"the outputs measured at least {found.steps} samples earlier"
        )
        caption = (
            f"The model receives only the input and {given}. No parameter was fitted to this part of the recording."
        )
        outputs = {f"measured{found.column}": measured, f"model{found.column}": simulated}
        return Drawing.of(figure, name, title, caption, {"time_s": timepts, "input": command, **outputs})


def _terms(model: NarxModel) -> Drawing:
    """Return each parameter in units of its standard deviation; from two on it differs from zero."""
    spread = np.sqrt(np.maximum(model.theta_cov.diagonal(), 0.0))
    certainty = np.abs(model.theta) / np.where(spread > 0, spread, np.nan)
    order = np.argsort(np.nan_to_num(certainty))
    with draw((7.4, 1.1 + ROW * len(model.terms))) as figure:
        axes = figure.add_subplot()
        places = np.arange(order.size)
        axes.plot(certainty[order], places, "o", color=Hue.AFTER, markersize=5)
        axes.axvline(
            1.96, color=Hue.INK, linestyle=":", linewidth=1.1, label="left of this line: not significant (95 %)"
        )
        axes.set_yticks(places, [str(model.terms[i]) for i in order])
        axes.set(xscale="log", xlabel="|parameter| / standard deviation", ylim=(-0.6, order.size - 0.4))
        plain_numbers(axes.xaxis, 1.0, 2.0, 5.0)
        figure.legend(loc="outside upper left")
        caption = "Significance of each term of the model: the magnitude of its parameter, divided by the standard deviation of the parameter."
        return Drawing.of(figure, "terms", "Terms", caption, drawn_table(figure))


def _tests(validation: Validation) -> Drawing:
    drawn = [t for t in validation.tests if t.output == 0 and t.name != "ee'" and t.other in (None, 0)]
    with draw((6.4, 1.5 * len(drawn))) as figure:
        validation.plot(list(figure.subplots(len(drawn), 1, squeeze=False)[:, 0]))
        caption = (
            "Correlations of the one-step residual e with itself and with the input u. Ochre marks values outside the grey range; "
            "noise alone stays in this range at 95 % of the lags. A test judges all lags together, and may therefore pass although "
            "some values lie outside the grey range."
        )
        return Drawing.of(figure, "tests", "Residual tests", caption, drawn_table(figure))


def _rows(found: Identified, runs: Sequence[NarxResponse]) -> list[Measure]:
    rows = []
    for part, run in zip(found.data.unseen, runs, strict=True):
        moved = float(np.std(run.measured[0]))
        rows.append(
            Measure(
                f"{found.judged} on the held-out part of {label(part)}",
                f"below {found.amount(moved)} rms (the error of a model with constant output)",
                f"{found.amount(run.rms_error)} rms{'' if run.status.ok else ' until it diverged'}",
                run.status.ok and run.rms_error < moved,
            )
        )
    for part, run, linear in zip(found.data.unseen, runs, found.linear, strict=bool(found.linear)):
        rows.append(
            Measure(
                f"{found.judged} compared with a linear model, {label(part)}",
                f"below {found.amount(linear)} rms, the error of a linear output-error model {found.linear_as}",
                f"{found.amount(run.rms_error)} rms",
                run.status.ok and run.rms_error < linear,
            )
        )
    if found.tested.validation is not None and found.tested.validation.tests:
        failed = [test.name for test in found.tested.validation.failed]
        told = (
            f"{len(failed)} of {len(found.tested.validation.tests)} fail: {', '.join(failed)} (e: residual, u: input)"
            if failed
            else f"all {len(found.tested.validation.tests)} pass"
        )
        rows.append(Measure("correlation tests of the residual", "none fails", told, not failed))
    return rows


def _table(model: NarxModel) -> Table:
    shown, symbols = shown_units(model), symbols_of(model.input_names, model.output_names)
    half = 1.96 * np.sqrt(np.maximum(model.theta_cov.diagonal(), 0.0)) * shown.factors
    rows = [
        [term.written(symbols), f"{value:.6g}", f"± {width:.3g}"]
        for term, value, width in zip(model.terms, model.theta * shown.factors, half, strict=True)
    ]
    title = f"The model{origins(model)}".replace("\n", ", ") + (f", {shown.legend}" if shown.legend else "")
    return Table(title=title, columns=["term", "parameter", "95 % interval"], rows=rows)
