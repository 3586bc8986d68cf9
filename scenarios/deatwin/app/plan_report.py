"""Write the files of `deatwin plan`: the plan, its figure, a page, and the suggested input."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from deatwin.app.given import GivenPlant
from deatwin.ident.mismatch import INPUT_FILE, ExperimentPlan, Foreseen, plan_experiment
from deatwin.plant.amplitudes import amount, axis_label, written_unit
from deatwin.plant.prefixes import with_unit
from deatwin.plant.readoptions import ReadOptions
from deatwin.plant.words import as_sentence, listed, spaced
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.report.drawing import COLOURS, Drawing, draw, standalone
from deatwin.studies.report.quantities import raised, three_digits
from deatwin.studies.report.story import Note, StoryPage, Table, end_run, write_story
from deatwin.studies.voice import Progress


def write_plan(found: ExperimentPlan, folder: ResultFolder, record: RunRecord) -> None:
    """Write all files of a plan."""
    if found.waveform:
        folder.save(INPUT_FILE, found.save_input)
    write_story(folder, _page(found, list(_drawings(found, folder))), record)
    end_run(folder, record, "plan", found.to_dict())
    folder.remove_former(rf"{INPUT_FILE}|figures/visible\.(csv|svg)")


def _drawings(found: ExperimentPlan, folder: ResultFolder) -> Iterator[Drawing]:
    shown = [one for one in found.effects if one.smallest is not None]
    if not shown:
        return
    header = f"effect,found_from_{found.unit or '1'},typical_{found.unit or '1'}"
    rows = [f"{one.effect},{one.smallest_change:.6g},{one.change:.6g}" for one in shown]
    with draw((7.4, 1.2 + 0.24 * len(shown))) as figure:
        axes = found.plot(figure.add_subplot())
        for line, colour in zip(axes.get_lines(), ("after", "before", "measured"), strict=True):
            line.set_color(COLOURS[colour][0])  # the library's own colours do not suit dark mode
        axes.legend(markerscale=1, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        folder.text("figures/visible.svg", standalone(figure))
        caption = (
            "For each effect, the smallest change of the reading that is detected, and the change that the effect causes at its "
            "typical strength. If the smallest detected change is larger, this input does not reveal the effect at its "
            "typical strength."
        )
        yield Drawing.of(figure, "visible", "What the input would show", caption, "\n".join([header, *rows, ""]))


def _page(found: ExperimentPlan, drawings: list[Drawing]) -> StoryPage:
    unit = written_unit(found.unit)
    table = Table.of(
        "Effects",
        found.effects,
        {
            "effect": lambda one: spaced(one.effect),
            "smallest detected strength": _least,
            "typical strength": lambda one: raised(with_unit(one.typical, one.unit)),
            axis_label("change of the reading at the typical strength", f"{unit} rms" if unit else ""): lambda one: (
                three_digits(one.change)
            ),
            "at the typical strength": _outcome,
        },
    )
    tables = [table]
    if found.tried:
        tables.append(
            Table.of(
                "Inputs that were tried",
                sorted(found.tried.items(), key=lambda item: item[1]),
                {
                    "input": lambda item: item[0],
                    "mean probability of choosing a wrong effect": lambda item: f"{100 * item[1]:.1f} %",
                },
            )
        )
    if found.readings:
        tables.append(
            Table.of(
                "Readings that could be added",
                found.readings,
                {
                    "reading": lambda one: spaced(one.reading),
                    "noise": lambda one: f"{with_unit(one.noise, one.unit)} ({one.noise_source})",
                    "pairs of effects that this reading distinguishes": lambda one: (
                        ", ".join(" / ".join(map(spaced, pair)) for pair in one.tells) or "–"
                    ),
                },
            )
        )
    return StoryPage(
        title="plan",
        sentence=as_sentence(found.sentence),
        rows=[],
        notes=[Note(title="How this was computed", paragraphs=list(_said(found, unit)))],
        figures=drawings,
        tables=tables,
        next="record the response to this input if the input reveals the effects that you suspect; otherwise plan a larger or longer input.",
    )


def _said(found: ExperimentPlan, unit: str) -> Iterator[str]:
    noise, error = (amount(three_digits(value), unit) for value in (found.noise, found.model_error))
    yield (
        f"The plan uses the nominal model, linearised. The plan assumes sensor noise of {noise} rms and a model error of {error} rms. "
        "All parameters of the model are refitted together with each effect."
    )
    yield (
        "An effect counts as detected if a diagnosis would probably find it: its expected probability is at least 95 %, and the "
        "change of the reading that remains after all parameters are refitted is large enough to count as missing physics. Two "
        "effects count as not distinguished if the wrong effect, with suitable parameters, would fit better than the right effect "
        "in more than 2.3 % of all recordings."
    )
    if found.impossible:
        yield f"The model could not be simulated with {', '.join(map(spaced, found.impossible))}."


def _least(one: Foreseen) -> str:
    return "at no strength" if one.smallest is None else raised(with_unit(one.smallest, one.unit))


def _outcome(one: Foreseen) -> str:
    if not one.visible:
        return "not detected"
    return f"not distinguished from {listed(list(map(spaced, one.alike)))}" if one.alike else "detected"


def plan_into(
    folder: ResultFolder, command: Sequence[str], asked: Mapping[str, Any], progress: Progress
) -> ExperimentPlan:
    """Plan with the arguments of ``deatwin plan``, and write the results into the folder."""
    rig, commands, seed, jobs = asked["rig"], asked["commands"], asked["seed"], asked["jobs"]
    plant = GivenPlant.load(rig, ReadOptions.of(asked))
    record = None if commands is None else plant.commands(commands)
    files = [Path(name) for name in (rig, commands) if name is not None and Path(name).is_file()]
    run = RunRecord(command=command, inputs=hashes(files), seed=seed, jobs=jobs)
    found = plan_experiment(
        plant.model.plant, record, seconds=asked["seconds"], jobs=jobs, seed=seed, progress=progress
    )
    write_plan(found, folder, run)
    return found
